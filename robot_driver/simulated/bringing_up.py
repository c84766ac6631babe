"""A whole bring-up in simulated time: an emulated robot, a person with eyes, hands and failings, and the procedure."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random

from cmr.bus.process import Outgoing
from robot_driver.bringup import STEPS, Drivable, Known, Place, Procedure, Result, World
from robot_driver.driver import Driver
from robot_driver.emulator.device import Device
from robot_driver.emulator.devices import CONTROLLER_DEVICES, GYRO_DEVICES
from robot_driver.emulator.hand_device import HandDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.robot_in_time import RobotInTime
from robot_driver.emulator.sensors import MotionCapture, Pose
from robot_driver.emulator.settings import Settings
from robot_driver.guided import Kind, Scripted, Step
from robot_driver.host import Host
from robot_driver.settings import Settings as DriverSettings
from robot_driver.simulated.direct import HAND, DirectDriver, DirectHost
from robot_driver.simulated.drive import GYRO_PORT, MOTOR, OWN_USB
from robot_driver.simulated.host import SimulatedHost
from robot_driver.simulated.usb import OwnUsb, UsbAdapter

TURN = 0.02  # s of a turn of the driver's process
SEEN = 0.005  # turns of a wheel that a person sees
PULLING, PLUGGING = 0.6, 2.5  # s after which the cable is pulled, and plugged in again
DIRECTLY = tuple(step for step in STEPS if step not in ("devices", "stop"))  # without ports and cables
Action = Callable[[], None]


@dataclass(frozen=True)
class Person:
    """What the person knows and how well they do: ruler (m), data sheet (0: not known), battery, hands.

    `miscounts` is how often a wheel is turned once too often or less; `hand` the standard deviation (turns) with which
    a turn by hand ends.
    """

    wheel_radius: float
    base_width: float
    ticks: int
    battery: str = "lipo3"
    allows_more: bool = True
    miscounts: float = 0.0
    hand: float = 0.01
    has_gyro: bool = True
    measures_stop: bool = True


@dataclass
class Outcome:
    """How it ended, what is known, what was said, and the largest duty before the floor, with and without a yes."""

    results: list[Result]
    known: Known
    text: str
    largest_before_yes: float
    largest_before_floor: float
    seconds: float
    replies: list[tuple[str, str]] = field(default_factory=list)

    def of(self, step: str) -> Result:
        """Return how a step ended."""
        return next(result for result in self.results if result.step == step)


@dataclass(frozen=True)
class SimulatedBringup:
    """A robot and the person who brings it up; `others` are robots whose poses are seen, too: offset in number."""

    settings: Settings
    person: Person
    controller: str = "roboclaw"
    gyro: str | None = "dsp3000"
    pose_rate: float = 50.0
    own_number: int = 0  # of the robot, in the poses
    seed: int = 0

    def run(self, folder: Path, steps: tuple[str, ...] = STEPS, known: Known | None = None) -> Outcome:
        """Bring the robot up through driver, bytes and devices; its files are written to a folder."""
        host = SimulatedHost(self.seed)
        plant = _Watched(self.settings)
        world = _World(host)
        self._plug_in(host, plant, world)
        line = host.open_line(HAND, 0, lock_out=False)
        hands = _Hands(host, plant, self.person, Random(f"{self.seed} person"), world, line.write)
        ports = [GYRO_PORT, MOTOR] if self.gyro else [MOTOR]
        place = Place(host, world, lambda: ports, lambda settings: Driver(settings, host))
        outcome = self._outcome(hands, place, plant, folder, steps, known or Known())
        host.check()
        return outcome

    def run_directly(self, folder: Path, steps: tuple[str, ...] = DIRECTLY, known: Known | None = None) -> Outcome:
        """Bring it up without driver, bytes and devices: from the motors on, but for pulling the cable."""
        plant = _Watched(self.settings)
        world: _World

        def see(utime: int, pose: Pose) -> None:
            world.see(self.own_number, (utime, pose.x, pose.y, pose.theta))

        host = DirectHost(self.settings, plant, self.pose_rate, see)
        world = _World(host)
        hands = _Hands(host, plant, self.person, Random(f"{self.seed} person"), world, host.write_to_hands)
        board = self.controller in OWN_USB
        if known is None:
            known = Known({"port": MOTOR, "controller": self.controller})
            known.driver |= {"gyro": "board" if board else self.gyro, "gyro_port": GYRO_PORT if self.gyro else None}
            known.decide("devices")

        def driver(settings: DriverSettings) -> DirectDriver:
            return DirectDriver(settings, self.settings, host, has_gyro=self.gyro is not None or board)

        place = Place(host, world, lambda: [], driver)
        return self._outcome(hands, place, plant, folder, steps, known)

    def _outcome(
        self, hands: "_Hands", place: Place, plant: "_Watched", folder: Path, steps: tuple[str, ...], known: Known
    ) -> Outcome:
        procedure = Procedure(hands, place, 0, known, folder / "robot_0_driver.yaml", folder / "robot_0.yaml")
        results = procedure.run(steps)
        before_floor = max(plant.largest["before"], plant.largest["yes"])
        seconds = place.host.monotonic()
        return Outcome(
            results, procedure.known, hands.text, plant.largest["before"], before_floor, seconds, hands.answers
        )

    def _plug_in(self, host: SimulatedHost, plant: Plant, world: "_World") -> None:
        devices: dict[str, Device] = {MOTOR: CONTROLLER_DEVICES[self.controller](self.settings, plant)}
        if self.gyro is not None:
            devices[GYRO_PORT] = GYRO_DEVICES[self.gyro](self.settings, plant)
        devices[HAND] = HandDevice(self.settings, plant)
        adapters: dict[str, UsbAdapter | OwnUsb] = {}
        for name in devices:
            own_usb = name == HAND or (name == MOTOR and self.controller in OWN_USB)
            adapters[name] = OwnUsb() if own_usb else UsbAdapter(0.001, Random(f"{self.seed} adapter {name}"))

        def see(pose: Pose) -> None:
            host.follow_robot()
            world.see(self.own_number, (host.utime_of_robot(pose.time), pose.x, pose.y, pose.theta))

        capture = MotionCapture(self.settings, plant, self.pose_rate)
        robot = RobotInTime(plant, devices, host.arrive, adapters=adapters, motion_capture=capture, on_pose=see)
        host.plug_in(robot, adapters)


class _Watched(Plant):
    """A plant that notes the largest duties that reach it, by phase: before a yes, after it, on the floor."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.phase = "before"
        self.largest = {"before": 0.0, "yes": 0.0, "floor": 0.0}

    def command(self, first: float, second: float) -> None:
        largest = max(abs(first), abs(second))
        self.largest[self.phase] = max(self.largest[self.phase], largest)
        super().command(first, second)


class _World(World):
    """Time that passes, what happens in it, and the poses of all robots."""

    def __init__(self, host: Host) -> None:
        super().__init__()
        self.host = host
        self._actions: list[tuple[float, Action]] = []

    def turn(self, driver: Drivable | None) -> None:
        del driver
        self.wait(TURN)

    def publish(self, message: Outgoing) -> None:
        """Drop it."""

    def wait(self, seconds: float) -> None:
        """Let time pass, and do what is due."""
        self.host.sleep(seconds)
        now = self.host.monotonic()
        due = [action for moment, action in self._actions if moment <= now]
        self._actions = [entry for entry in self._actions if entry[0] > now]
        for action in due:
            action()

    def later(self, seconds: float, action: Action) -> None:
        """Have something happen after a while."""
        self._actions.append((self.host.monotonic() + seconds, action))


class _Hands(Scripted):
    """The person: answers by what they see, and turns things by hand."""

    def __init__(
        self,
        host: Host,
        plant: _Watched,
        person: Person,
        random: Random,
        world: _World,
        write: Callable[[bytes], None],
    ) -> None:
        super().__init__(
            {
                "lifted": lambda _step: self._hand("lift", "yes"),
                "motors.first.seen": self._seen,
                "motors.second.seen": self._seen,
                "motors.more": self._allow,
                "ticks.stated": str(person.ticks),
                "ticks.left.ten": lambda step: self._turned(step, "left", 10.0),
                "ticks.right.ten": lambda step: self._turned(step, "right", 10.0),
                "ticks.left.seven": lambda step: self._turned(step, "left", 7.0),
                "ticks.right.seven": lambda step: self._turned(step, "right", 7.0),
                "ticks.direction": "forward",
                "ticks.counted": "no",
                "ticks.usual": "unknown",
                "gyro.turn": lambda step: self._turned(step, "robot", 1.0),
                "gyro.none": "yes" if person.has_gyro else "none",
                "gyro.direction": "left",
                "battery.kind": person.battery,
                "stop.begin": "yes" if person.measures_stop else "no",
                "floor.radius": f"{1e3 * person.wheel_radius:.2f}",
                "floor.width": f"{1e3 * person.base_width:.1f}",
                "floor.fence": self._fence,
            }
        )
        self._host, self._plant, self._person, self._random, self._world = host, plant, person, random, world
        self._write = write
        self._angles = 0.0, 0.0
        self._until: float | None = None

    def show(self, step: Step) -> None:
        super().show(step)
        self._until = None
        if step.kind is Kind.MOTION:
            self._angles = self._plant.left.angle, self._plant.right.angle
        if step.name in ("gyro.standing", "floor.fence"):
            self._write(b"lower\n")
        elif step.name == "stop.turns":
            assert isinstance(self._host, SimulatedHost)
            self._world.later(PULLING, partial(self._host.unplug, MOTOR))
            self._world.later(PULLING + PLUGGING, partial(self._host.plug, MOTOR))

    def _hand(self, line: str, answer: str) -> str:
        self._write(f"{line}\n".encode())
        return answer

    def _allow(self, _step: Step) -> str:
        if self._person.allows_more:
            self._plant.phase = "yes"
        return "yes" if self._person.allows_more else "no"

    def _fence(self, _step: Step) -> str:
        self._plant.phase = "floor"
        return "yes"

    def _turned(self, step: Step, what: str, turns: float) -> str | None:
        """Turn something by hand; answer when it is done."""
        del step
        now = self._host.monotonic()
        if self._until is None:
            count = turns
            if turns > 1.0 and self._random.random() < self._person.miscounts:
                count += self._random.choice((-1.0, 1.0))
            count += self._random.gauss(0.0, self._person.hand)
            self._write(f"{what} {count:.4f}\n".encode())
            self._until = now + abs(count) * (0.25 if turns > 1.0 else 4.0) + 0.3
        return "done" if now >= self._until else None

    def _seen(self, _step: Step) -> str:
        """Say which wheel turned since the motion was announced."""
        left, right = (
            (now - then) / (2.0 * math.pi)
            for now, then in zip((self._plant.left.angle, self._plant.right.angle), self._angles, strict=True)
        )
        if max(abs(left), abs(right)) < SEEN:
            return "none"
        if min(abs(left), abs(right)) > 0.2 * max(abs(left), abs(right)):
            return "both"
        side, way = ("l", left) if abs(left) > abs(right) else ("r", right)
        return side + ("f" if way > 0.0 else "b")
