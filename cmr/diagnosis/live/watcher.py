"""Monitor all real robots on the bus. Independent of bus and clock: messages in, sentences out.

All decisions depend only on the messages' time stamps, so a log gives the same sentences at any speed, as long as
messages arrive less than LATEST after wheel feedback with the same stamp.
"""

import math
from collections.abc import Callable

from cmr.bus.message import Message
from cmr.bus.streams import MOTOR_FEEDBACK, PARAMETERS, identify
from cmr.diagnosis.live.hearing import Hearing
from cmr.diagnosis.live.robot import RobotWatch
from cmr.diagnosis.live.second import AROUND, SECOND, observe
from cmr.diagnosis.live.twin import Twin
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController
from cmr.msg import gyro_t, motor_feedback_t, parameters_t, pose_xyt_t
from cmr.parameters.file import ParameterFileError
from cmr.parameters.following import ParameterFollower
from cmr.recordings.commanding import COMMANDS, duties_of

MOST_WATCHED = 1_000  # robots; senders may use any number of ids
LATEST = 1_000_000  # us by which messages may be late
LONGEST_GAP = 3_000_000  # us without feedback, or by which its clock goes back, that start a new drive
SILENT = 3_000_000  # us
LINGERING = 10_000_000  # us for which a past event, such as the end of a suspicion, stays visible


class Watcher:
    """All robots that send MOTOR_FEEDBACK_N, or the one of `robot_id`.

    `follow` makes the parameter follower of a robot id. `ready` says whether robots with certain parameters can be
    simulated without delay; until then, nothing is monitored.
    """

    def __init__(
        self,
        follow: Callable[[int], ParameterFollower],
        robot_id: int | None = None,
        ready: Callable[[RobotParameters], bool] = lambda _parameters: True,
    ) -> None:
        self._follow = follow
        self._ready = ready
        self._robot_id = robot_id
        self._robots: dict[int, _Robot] = {}
        self._now = 0
        if robot_id is not None:
            self._robot(robot_id)

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle one message from the bus or from a log."""
        stream, robot_id = identify(channel) or (None, None)
        if robot_id is None or self._robot_id not in (None, robot_id):
            return
        if robot_id not in self._robots and len(self._robots) >= MOST_WATCHED:
            return
        if isinstance(message, motor_feedback_t):
            self._robot(robot_id).roll(utime, message)
        elif robot_id in self._robots or stream is PARAMETERS:
            self._robot(robot_id).take(utime, channel, message)

    def advance(self, utime: int) -> list[str]:
        """Advance to `utime`, check for replaced parameter files, and return the sentences since the last call."""
        self._now = utime
        for robot in self._robots.values():
            robot.look_for_parameters()
        return [sentence for robot_id in sorted(self._robots) for sentence in self._robots[robot_id].tell(utime)]

    @property
    def problem(self) -> str:
        """What prevents robots from being monitored; empty if nothing does."""
        return " ".join(problem for robot in self._robots.values() if (problem := robot.problem))

    @property
    def parameters_sha256(self) -> str:
        """The parameter files in use, as in process_status_t."""
        return ",".join(robot.follower.sha256 for _, robot in sorted(self._robots.items()) if robot.follower.sha256)

    @property
    def alarms(self) -> str:
        """Current suspicions and recent news; empty without any. Changes only when there is news."""
        alarms = [(robot.robot_id, robot.alarm(self._now)) for _, robot in sorted(self._robots.items())]
        return " ".join(f"Robot {robot_id}: {alarm}" for robot_id, alarm in alarms if alarm)

    def status(self) -> str:
        """Return one line: suspicions and recent news, or what is being monitored."""
        lines = [robot.status(self._now) for _, robot in sorted(self._robots.items()) if robot.heard]
        who = "a robot" if self._robot_id is None else f"robot {self._robot_id}"
        channel = f"{MOTOR_FEEDBACK.name}_{'N' if self._robot_id is None else self._robot_id}"
        return " ".join(lines) or f"Waiting for {who}: nothing received on {channel}."

    def _robot(self, robot_id: int) -> "_Robot":
        if robot_id not in self._robots:
            self._robots[robot_id] = _Robot(robot_id, self._follow(robot_id), self._ready)
        return self._robots[robot_id]


class _Robot:
    """The state of one robot: its recent messages, and the monitor that uses their time stamps."""

    def __init__(self, robot_id: int, follower: ParameterFollower, ready: Callable[[RobotParameters], bool]) -> None:
        self.robot_id = robot_id
        self.follower = follower
        self.heard = 0  # us, of the newest feedback
        self._ready = ready
        self._hearing = Hearing()
        self._begin = 0  # us, of the next second
        self._parameters: RobotParameters | None = None
        self._sha256 = ""
        self._incomplete = ""
        self._controller: VelocityController | None = None
        self._twin: Twin | None = None
        self._watch: RobotWatch | None = None
        self._news: list[str] = []
        self._said: list[str] = []  # the last sentences
        self._said_at = 0  # us
        self.look_for_parameters()

    def roll(self, utime: int, message: motor_feedback_t) -> None:
        """Take a MOTOR_FEEDBACK_N; its time stamps are the monitor's clock."""
        if not -LATEST <= utime - self.heard <= LONGEST_GAP:
            self._hearing, self._twin = Hearing(), None
            self.heard = utime
            self._begin = (utime // SECOND + 1) * SECOND
        self.heard = max(self.heard, utime)
        row = (message.psi_left, message.psi_right, message.applied_left, message.applied_right)
        self._hearing.take("wheels", utime, (*row, message.battery_voltage, message.status))
        while self.heard >= self._begin + SECOND + LATEST:
            self._watch_second()
            self._begin += SECOND
            self._hearing.keep(self._begin - AROUND, self.heard + LONGEST_GAP)

    def take(self, utime: int, channel: str, message: Message) -> None:
        """Take any other message of the robot."""
        if isinstance(message, parameters_t):
            self.follower.handle(utime, channel, message)
            self.look_for_parameters()
        elif isinstance(message, COMMANDS):
            duties = duties_of(message, self._controller)
            if duties is not None:
                self._hearing.take("commands", utime, duties)
        elif isinstance(message, gyro_t) and message.valid:
            self._hearing.take("gyro", utime, (message.yaw_rate,))
        elif isinstance(message, pose_xyt_t):
            self._hearing.take("poses", utime, (message.x, message.y, message.theta))

    def look_for_parameters(self) -> None:
        """Use the newest parameters; if they have changed, start monitoring again."""
        self.follower.poll()
        if self.follower.parameters is None or self.follower.sha256 == self._sha256:
            return
        self._incomplete = ""
        try:
            parameters = self.follower.parameters.robot_parameters
            controller = self.follower.parameters.velocity_controller
        except ParameterFileError as error:
            self._incomplete = f"its parameters are incomplete: {error}. Calibrate it with cmr-calibrate."
            return
        if not self._ready(parameters):
            return
        if self._watch is not None:
            self._say("The parameters have changed: monitoring starts again.")
        self._sha256, self._parameters, self._controller = self.follower.sha256, parameters, controller
        self._watch, self._twin = RobotWatch(), None

    def tell(self, utime: int) -> list[str]:
        """Return the sentences to report since the last call."""
        news, self._news = self._news, []
        if news:
            self._said, self._said_at = news, utime
        return [f"Robot {self.robot_id}: {sentence}" for sentence in news]

    def alarm(self, utime: int) -> str:
        """Return suspicions, each sentence once, and for a while the last news; empty without any."""
        suspected = self._watch.suspected if self._watch else []
        recent = self._said if utime - self._said_at < LINGERING else []
        return " ".join(dict.fromkeys([*recent, *suspected]))

    def status(self, utime: int) -> str:
        """Return suspicions, or the current activity."""
        if self.problem or self._watch is None:
            return self.problem or f"Robot {self.robot_id}: its model is loading."
        if utime - self.heard > SILENT:
            return f"Robot {self.robot_id}: no motor feedback for {(utime - self.heard) * 1e-6:.0f} s."
        return f"Robot {self.robot_id}: {self.alarm(utime) or self._watch.activity()}"

    @property
    def problem(self) -> str:
        """What prevents the robot from being monitored; empty if nothing does."""
        channel = PARAMETERS.channel(self.robot_id)
        if self.follower.parameters is None:
            why = self.follower.message or f"none are announced on {channel}."
            return f"Robot {self.robot_id}: its parameters are missing: {why}"
        problem = self._incomplete or self.follower.message
        return f"Robot {self.robot_id}: {problem}" if problem else ""

    def _watch_second(self) -> None:
        """Process the next second."""
        if self._watch is None or self._parameters is None:
            return
        if self._twin is None:
            self._twin = self._new_twin(self._parameters)
        top_speed = self._controller.top_wheel_speed if self._controller else math.nan
        second = observe(self._hearing, self._twin, self._parameters, self._begin, top_speed) if self._twin else None
        if second is None:
            self._twin = None
            return
        for sentence in self._watch.add(second):
            self._say(sentence)

    def _new_twin(self, parameters: RobotParameters) -> Twin | None:
        """Return a twin with the robot's current wheel speeds; None if these are unknown."""
        wheels = self._hearing.between("wheels", self._begin - AROUND, self._begin + AROUND, self._begin)
        if not len(wheels):
            return None
        newest = wheels[wheels[:, 0] <= 0.0][-1:] if (wheels[:, 0] <= 0.0).any() else wheels[:1]
        return Twin(parameters, float(newest[0, 1]), float(newest[0, 2]))

    def _say(self, sentence: str) -> None:
        self._news.append(sentence)
