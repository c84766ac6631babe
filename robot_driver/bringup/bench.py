"""The robot during bring-up: driven through cmr-driver's own path, so that all promises of the driver hold.

Each command passes the driver's gate, its ramp and the last gate; an emergency stop, a lost port and 0.5 s without a
command stop the motors as usual. In addition no command exceeds `limit`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Protocol

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import MOTOR_COMMAND
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t
from robot_driver.guided import Guide
from robot_driver.host import Host
from robot_driver.settings import Settings

FIRST_LIMIT = 0.10  # duty; limit of motions before the floor step, unless confirmed
LIMIT = 0.20  # duty; limit of confirmed motions
BELOW = 0.999  # of the desired duty: rounding by the controller may not exceed the limit
COMMANDED = 0.02  # s between commands
SILENCE = 0.6  # s without feedback, after which the controller counts as gone
ZERO_FIRST = 0.6  # s of zero before a motion; a driver that has just started accepts nothing else for 0.4 s
COASTING = 0.4  # s after a motion in which wheels come to rest
BITS = motor_feedback_t
WHY_HELD = {
    BITS.STATUS_ESTOP: "an emergency stop is engaged. Release it (cmr estop release, or the button), then run the step "
    "again",
    BITS.STATUS_BATTERY: "the controller finds the battery too low or too high, or its voltage is not known",
    BITS.STATUS_MOTOR_FAULT: "the controller reports a fault of a motor",
    BITS.STATUS_NOT_ARMED: "the controller's watchdog cannot be set, so nothing would stop the motors if this computer "
    "failed",
}


class CannotTell(Exception):  # noqa: N818 - it ends a step, as one of its results
    """A step cannot be decided; the text continues after "because". `doubts` are other steps to repeat."""

    def __init__(self, why: str, doubts: Sequence[str] = ()) -> None:
        super().__init__(why)
        self.doubts = doubts


class Drivable(Protocol):
    """The part of a Driver's interface used by bring-up."""

    def turn(self) -> None:
        """Signal that the process is alive."""

    def handle(self, utime: int, channel: str, message: Message, sender: int | None = None) -> None:
        """Handle a message."""

    def outgoing(self) -> Iterator[Outgoing]:
        """Yield measurements."""

    def news(self) -> Iterator[str]:
        """Yield events."""

    def problems(self) -> str:
        """Return problems that limit the service."""


SeenPose = tuple[int, float, float, float]  # stamp [us], x [m], y [m], theta [rad]
Opener = Callable[[Settings], AbstractContextManager[Drivable]]


@dataclass
class Readings:
    """Messages of the robot collected while listening."""

    feedback: list[motor_feedback_t] = field(default_factory=list)
    gyro: list[gyro_t] = field(default_factory=list)


class World(ABC):
    """The driver's surroundings: time, which passes in turns, the recipient of its messages, and the poses of all
    robots.

    `turn` waits for the next cycle, some 5 ms after the last one, passes messages (such as an emergency stop) to the
    driver, if one runs, and raises the exception that ends the procedure, if any.
    """

    def __init__(self) -> None:
        self._seen: dict[int, list[SeenPose]] | None = None

    @abstractmethod
    def turn(self, driver: Drivable | None) -> None:
        """Wait for one cycle."""

    @abstractmethod
    def publish(self, message: Outgoing) -> None:
        """Pass on a message of the driver."""

    def see(self, robot: int, pose: SeenPose) -> None:
        """Add a pose of a robot; it is dropped unless somebody collects."""
        if self._seen is not None:
            self._seen.setdefault(robot, []).append(pose)

    @contextmanager
    def collect(self) -> Iterator[Mapping[int, list[SeenPose]]]:
        """Collect poses within the context, by robot."""
        self._seen = {}
        try:
            yield self._seen
        finally:
            self._seen = None


class Bench:
    """A robot whose driver runs during `run`; made by `opened`."""

    def __init__(self, driver: Drivable, host: Host, robot_id: int, world: World) -> None:
        self.limit = FIRST_LIMIT
        self.host = host
        self.latest: motor_feedback_t | None = None
        self._driver, self._robot_id, self._world = driver, robot_id, world
        self._channel = MOTOR_COMMAND.channel(robot_id)
        self._wanted = 0.0, 0.0
        self._commanded = self._heard_at = host.monotonic()
        self._listeners: list[Readings] = []

    def want(self, left: float, right: float) -> None:
        """Set the duties to drive while time passes.

        Raises ValueError for a duty beyond `limit`: bring-up must not request it.
        """
        if not max(abs(left), abs(right)) <= self.limit + 1e-9:
            raise ValueError(f"A duty of {left:g}, {right:g} is beyond {self.limit:g}.")
        self._wanted = BELOW * left, BELOW * right

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end = self.host.monotonic() + seconds
        while self.host.monotonic() < end:
            self.turn()

    def turn(self) -> None:
        """Let one cycle of the driver pass."""
        self._world.turn(self._driver)
        self._driver.turn()
        now = self.host.monotonic()
        if now >= self._commanded + COMMANDED:
            self._commanded = now
            left, right = self._wanted
            command = make(motor_command_t, utime=self.host.utime(), robot_id=self._robot_id, left=left, right=right)
            self._driver.handle(command.utime, self._channel, command)
        for outgoing in self._driver.outgoing():
            self._hear(outgoing[2])
            self._world.publish(outgoing)
        list(self._driver.news())  # each step reports by itself
        self._driver.problems()  # raises the error that ended a thread

    @contextmanager
    def listening(self) -> Iterator[Readings]:
        """Collect the robot's messages."""
        heard = Readings()
        self._listeners.append(heard)
        try:
            yield heard
        finally:
            self._listeners.remove(heard)

    @property
    def silent_for(self) -> float:
        """Duration of the controller's silence (s)."""
        return self.host.monotonic() - self._heard_at

    @property
    def ticks(self) -> tuple[int, int]:
        """The total ticks of both sides now. Raises CannotTell if the controller is silent."""
        if self.latest is None or self.silent_for > SILENCE:
            raise CannotTell(f"the motor controller does not answer. {self._driver.problems()}".strip())
        return int(self.latest.ticks_left), int(self.latest.ticks_right)

    def check(self) -> None:
        """Raise CannotTell if something holds the motors at zero, or the controller does not answer."""
        self.ticks  # noqa: B018 - raises
        assert self.latest is not None
        for bit, why in WHY_HELD.items():
            if self.latest.status & bit:
                raise CannotTell(why)

    def move(self, guide: Guide, name: str, text: str, duties: tuple[float, float], seconds: float) -> bool:
        """Announce a motion and perform it; return whether a key ended it. At the end the wheels rest."""
        return self.steer(guide, name, text, lambda _elapsed: duties, seconds)

    def steer(
        self,
        guide: Guide,
        name: str,
        text: str,
        duties_at: Callable[[float], tuple[float, float] | None],
        seconds: float,
    ) -> bool:
        """Perform a motion with the duties `duties_at` as a function of time; None ends it early."""
        self.want(0.0, 0.0)
        self.run(ZERO_FIRST)
        self.check()
        motion = guide.motion(name, text, seconds)
        try:
            with motion:
                start = self.host.monotonic()
                while not motion.ended(elapsed := self.host.monotonic() - start):
                    duties = duties_at(elapsed)
                    if duties is None:
                        break
                    self.want(*duties)
                    self.turn()
                    self.check()
        finally:
            self.want(0.0, 0.0)
        self.run(COASTING)
        return motion.by_person

    def _hear(self, message: object) -> None:
        if isinstance(message, motor_feedback_t):
            self.latest, self._heard_at = message, self.host.monotonic()
        for heard in self._listeners:
            if isinstance(message, motor_feedback_t):
                heard.feedback.append(message)
            elif isinstance(message, gyro_t):
                heard.gyro.append(message)


@contextmanager
def opened(settings: Settings, host: Host, world: World, driver: Opener) -> Iterator[Bench]:
    """Open the robot's ports; at the end the motors are stopped.

    Raises PortLost if one cannot be opened, CannotTell if the controller does not answer.
    """
    with driver(settings) as running:
        bench = Bench(running, host, settings.robot, world)
        end = host.monotonic() + CONNECTING
        while bench.latest is None and host.monotonic() < end:
            bench.turn()
        bench.ticks  # noqa: B018 - raises
        yield bench


CONNECTING = 5.0  # s; an MBot board is first tested for how long it continues without time messages
