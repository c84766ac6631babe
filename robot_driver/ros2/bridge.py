"""Bridge of one real robot: the guarantees of a driver, for a robot commanded over ROS 2. Independent of rclpy.

The code of cmr-driver handles stale commands, the emergency stop, ownership, and ramps. It gives no guarantee if this
process is killed or its connection to the robot is cut: then the robot's own timeout stops it, if it has one
(`Base.command_timeout` of the profile).
"""

import math
from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType

from cmr.bus.claiming import Ownership
from cmr.bus.message import Message
from cmr.bus.process import Outgoing
from cmr.bus.streams import COMMAND_OWNER, ESTOP_LATCH, VELOCITY_COMMAND
from cmr.model.duty_ramp import Ramp
from cmr.msg import command_claim_t, command_owner_t, estop_latch_t, estop_t, velocity_command_t
from robot_driver.bus_stop import BusStop
from robot_driver.command_gate import CommandGate
from robot_driver.commanders import Commanders
from robot_driver.host import THIS_COMPUTER, Host
from robot_driver.ros2.messages import Velocity
from robot_driver.ros2.profile import Profile
from robot_driver.ros2.readings import Readings
from robot_driver.stop_file import StopFile, StopKeeper

SILENT = 1_000_000  # us without a message after which a topic is missing
STANDSTILL = Velocity(0.0, 0.0)


class RobotBridge:
    """The robot, as a context manager: inside, an engaged emergency stop is stored, so that it outlives the process.

    `handle` takes messages of the bus; `readings` those of ROS 2. `velocity` is the command to send to the robot now.
    """

    def __init__(
        self, robot_id: int, profile: Profile, host: Host = THIS_COMPUTER, stop_file: StopFile | None = None
    ) -> None:
        self.robot_id, self.profile = robot_id, profile
        self.gate = CommandGate(largest=math.inf)  # larger speeds are clipped
        self.readings = Readings(robot_id, profile, lambda: self.gate.drive(host.seconds_since_boot()).status)
        self.graph_problem = ""  # problem with the robot's topics, found by the node
        self._host = host
        self._keeper = StopKeeper(stop_file) if stop_file is not None else None
        self._bus_stop = BusStop(self.gate, robot_id, self._keeper)
        self._ownership, self._commanders = Ownership(robot_id, host), Commanders()
        self._ramp = Ramp(profile.command.ramp, longest_step=2.0 / profile.command.rate)
        self._commanded_on = VELOCITY_COMMAND.channel(robot_id)
        self._began = host.utime()
        self._inside = ExitStack()

    def __enter__(self) -> "RobotBridge":
        if self._keeper is not None:
            self._inside.enter_context(self._keeper)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._inside.close()

    def turn(self) -> None:
        """Record that the process is alive; to be called before messages are handled."""
        self.gate.note_turn(self._host.seconds_since_boot())

    def handle(self, utime: int, channel: str, message: Message, sender: int | None = None) -> bool:
        """Process a message of the bus; return whether it changes the velocity to send at once."""
        now = self._host.utime()
        if isinstance(message, velocity_command_t) and channel == self._commanded_on:
            if not self._ownership.takes(sender):
                return False
            self._commanders.take(utime, *self._shares(Velocity(message.v, message.omega)))
            return self.gate.offer(utime, message.v, message.omega, now=self._host.seconds_since_boot(), utime=now)
        if isinstance(message, estop_t):
            self._bus_stop.handle(message, utime, utime=now)
            return True
        if isinstance(message, command_claim_t) and message.robot_id == self.robot_id:
            self._ownership.claim(message, sender)
        return False

    def velocity(self) -> Velocity:
        """Return the velocity to send now: on a ramp to the command, at once zero if it must stop."""
        now, command = self._host.seconds_since_boot(), self.profile.command
        drive = self.gate.drive(now)
        if drive.status:
            self._ramp.reset()
            return STANDSTILL
        v, omega = self._ramp.towards(*self._shares(Velocity(drive.left, drive.right)), now)
        self._ramp.confirm()
        return Velocity(v * command.speed, omega * command.turn_rate)

    def stop(self) -> Velocity:
        """Discard the command in force; return the last velocity to send."""
        self.gate.clear()
        return self.velocity()

    def owner_reports(self) -> list[command_owner_t]:
        """Return the messages of COMMAND_OWNER_N to publish now: whose commands are accepted."""
        return self._ownership.reports()

    def stop_reports(self) -> list[estop_latch_t]:
        """Return the messages of ESTOP_LATCH_N to publish now: whether the emergency stop is engaged."""
        return self._bus_stop.reports(self._host.monotonic(), self._host.utime())

    def reports(self) -> Iterator[Outgoing]:
        """Yield both kinds of reports with their streams."""
        yield from ((COMMAND_OWNER, self.robot_id, report) for report in self.owner_reports())
        yield from ((ESTOP_LATCH, self.robot_id, report) for report in self.stop_reports())

    def news(self) -> Iterator[str]:
        """Yield events since the last call, as text for the user."""
        for news in (self._bus_stop.news, self._ownership.news):
            while news:
                yield f"robot {self.robot_id}: {news.pop(0)}"

    def problems(self) -> str:
        """Return what limits the robot's function, in sentences; "" if nothing does."""
        owners = self._ownership.problem() or self._commanders.problem(self._host.utime())
        found = [self.graph_problem, self._missing(), self._bus_stop.problem, owners]
        return " ".join(filter(None, found))

    def remarks(self) -> str:
        """Return further remarks for the user, in sentences."""
        remarks = [*self._bus_stop.remarks(), self.readings.clock.remark(), *self.gate.remarks()]
        refused = ", ".join(f"{why} {count}" for why, count in sorted(self.readings.refused.items()))
        remarks.append(f"Messages of the robot not used: {refused}." if refused else "")
        return " ".join(filter(None, remarks))

    def _shares(self, velocity: Velocity) -> tuple[float, float]:
        """Return a velocity as shares of the largest, clipped there."""
        command = self.profile.command
        v, omega = velocity.v / command.speed, velocity.omega / command.turn_rate
        return max(-1.0, min(1.0, v)), max(-1.0, min(1.0, omega))

    def _missing(self) -> str:
        """Return a sentence that names the silent topics."""
        profile, now = self.profile, self._host.utime()
        topics = {"wheels": profile.wheels.topic}
        if profile.gyro is not None:
            topics["gyro"] = profile.gyro.topic
        if profile.pose is not None:
            topics["pose"] = profile.pose.topic or f"tf ({profile.pose.frames})"
        heard = self.readings.heard
        silent = [topic for what, topic in topics.items() if now - heard.get(what, self._began) > SILENT]
        return f"Nothing is heard on {', '.join(silent)}." if silent else ""
