"""All steps in order: each uses known results, adds its findings, and reports changes with reasons."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from robot_driver.bringup.bench import Bench, CannotTell, Opener, World, opened
from robot_driver.bringup.devices import find_devices
from robot_driver.bringup.floor import Body
from robot_driver.bringup.ground import Ground, find_on_the_ground
from robot_driver.bringup.known import Known, Plain
from robot_driver.bringup.motors import Side, find_motors
from robot_driver.bringup.parameters import ParametersFound, write_parameters
from robot_driver.bringup.stopping import find_stop_time
from robot_driver.bringup.supply import find_battery
from robot_driver.bringup.turning import GyroFound, find_gyro
from robot_driver.bringup.turns import find_turns
from robot_driver.guided import Choice, Front, Guide
from robot_driver.host import Host
from robot_driver.serial_port import PortLost

GENTLE = 2.0  # duty/s; how fast duty grows during bring-up
RATE = 50.0  # Hz; supported by all adapters
WITH_GYRO = ("gyro", "floor")
LIFT = "Put the robot on a box so that its wheels are off the floor and turn freely. They will turn. Is it lifted?"
LIFTED = (Choice("yes", "its wheels are off the floor, and nothing can get caught in them"),)


@dataclass(frozen=True)
class Result:
    """The result of a step: `decided`, or the reason why not."""

    step: str
    decided: bool
    text: str


@dataclass(frozen=True)
class Place:
    """The environment: the computer, the bus, the ports, and the robot's driver."""

    host: Host
    world: World
    ports: Callable[[], Sequence[str]]
    driver: Opener


class Procedure:
    """Brings up one robot; results are in `known`, and in files after each step."""

    def __init__(self, front: Front, place: Place, robot: int, known: Known, settings: Path, parameters: Path) -> None:
        self.known = known
        self._guide, self._place, self._robot = Guide(front, self._wait), place, robot
        self._bench_now: Bench | None = None
        self._settings, self._parameters = settings, parameters
        self._lifted = False
        self._steps: dict[str, Callable[[], str]] = {
            "devices": self._devices,
            "motors": self._motors,
            "ticks": self._ticks,
            "stop": self._stop,
            "battery": self._battery,
            "gyro": self._gyro,
            "floor": self._floor,
        }

    def run(self, steps: Sequence[str]) -> list[Result]:
        """Perform these steps; undecided ones are reported, and the others continue."""
        results = []
        for step in steps:
            before = dict(self.known.driver)
            self._guide.say(step, f"== Step {step} ==")
            try:
                text = self._steps[step]()
                self.known.decide(step)
                results.append(Result(step, True, text))
                self._guide.say(f"{step}.found", f"{step}: {text}.{self._changes(before)}")
            except (CannotTell, PortLost) as unknown:
                self.known.driver = before
                for doubted in (step, *(unknown.doubts if isinstance(unknown, CannotTell) else ())):
                    self.known.doubt(doubted)
                text = f"cannot tell, because {str(unknown).rstrip('.')}"
                results.append(Result(step, False, text))
                self._guide.say(f"{step}.unknown", f"{step}: {text}.")
            self.known.save(self._settings)
        return results

    def _changes(self, before: dict[str, Plain]) -> str:
        """Return the changes of the driver's settings."""
        changed = [
            f"{name}: {_said(before.get(name))} -> {_said(value)}"
            for name, value in self.known.driver.items()
            if before.get(name) != value
        ]
        return f" Settings of the driver: {', '.join(changed)}." if changed else " No setting of the driver changes."

    def _devices(self) -> str:
        found = find_devices(self._guide, self._place.host, self._place.ports())
        self.known.driver |= found
        return ", ".join(f"{name} {value}" for name, value in found.items() if value is not None)

    def _motors(self) -> str:
        self._lift()
        neutral = dict.fromkeys(WIRING, False)
        with self._bench("motors", **neutral) as bench:
            found = find_motors(bench, self._guide)
        self.known.driver |= dict(zip(WIRING, found.wiring, strict=True))
        self.known.found |= {"dead_encoders": [side.value for side in found.dead], "duty": found.duty}
        dead = "".join(f"; the {side.value} encoder never counts: check its cable and power" for side in found.dead)
        return f"both motors were seen to turn{dead}"

    def _ticks(self) -> str:
        self._need("motors")
        self._lift()
        sides = [side for side in Side if side.value not in self._dead]
        with self._bench("ticks") as bench:
            found = find_turns(bench, self._guide, sides, str(self.known.driver["controller"]))
        self.known.driver["ticks_per_turn"] = found.ticks_per_turn
        return f"{found.ticks_per_turn} counts per turn of a wheel: {found.why}"

    def _stop(self) -> str:
        self._need("motors", "ticks")
        self._lift()
        with self._bench("stop") as bench:
            found = find_stop_time(bench, self._guide, self.known.number("duty"))
        if found.seconds is None:
            return found.why
        self.known.found["stop_time"] = round(found.seconds, 3)
        return f"with the cable pulled, the wheels stop after at most {found.seconds:.2f} s"

    def _battery(self) -> str:
        with self._bench("battery", battery_warn=0.0, battery_stop=0.0) as bench:
            found = find_battery(bench, self._guide)
        self.known.driver |= {"battery_warn": found.warn, "battery_stop": found.stop}
        volts = f"{found.voltage:.1f} V" if math.isfinite(found.voltage) else "not measured"
        return f"{volts}; warns below {found.warn:g} V, stops below {found.stop:g} V" if found.warn else volts

    def _gyro(self) -> str:
        self._lifted = False
        with self._bench("gyro", invert_gyro=False) as bench:
            found = find_gyro(bench, self._guide)
        if found.scale > 1.0:
            raise CannotTell("the gyro shows 720 degrees for a turn, which no setting corrects. Check how it is set")
        self.known.driver["invert_gyro"] = found.inverted
        self.known.found |= {"gyro": found.present, "gyro_scale": found.scale, "gyro_bias": round(found.bias, 5)}
        if found.scale != 1.0:
            return f"{found.text}; the parameter file will have gyro_scale {found.scale - 1.0:g}"
        return found.text

    def _floor(self) -> str:
        self._need("motors", "ticks", "gyro")
        if self._dead:
            raise CannotTell(f"the {' and '.join(self._dead)} encoder never counts, and a drive is held by both wheels")
        self._lifted = False
        body = self._body()
        present = bool(self.known.found.get("gyro"))
        inverted = bool(self.known.driver.get("invert_gyro"))
        gyro = GyroFound(present, inverted, self.known.number("gyro_scale"), self.known.number("gyro_bias"))
        with self._bench("floor") as bench, self._place.world.collect() as seen:
            found = find_on_the_ground(bench, self._guide, body, gyro, seen, self._robot)
        return self._keep(body, found)

    def _keep(self, body: Body, found: Ground) -> str:
        """Write the parameter file, if the drive left nothing open; return a text on results and corrections."""
        if found.poses is None:
            raise CannotTell(found.problem)
        self.known.found |= {"wheel_radius": body.wheel_radius, "base_width": round(found.base_width, 4)}
        self.known.found |= {f"poses_{name}": value for name, value in asdict(found.poses).items()}
        scale = self.known.number("gyro_scale") if self.known.found.get("gyro") else 1.0
        wanted = ParametersFound(body.wheel_radius, found.base_width, found.motors, scale, found.poses)
        changes = write_parameters(self._parameters, self._robot, wanted)
        todo = [f"To correct: {text}." for text in found.poses.corrections(self._robot)]
        words = " ".join(todo) or "The poses fit the wheels."
        unclear = f" But {found.poses.unclear}." if found.poses.unclear else ""
        return f"{words}{unclear} {self._parameters}: {changes}".rstrip(".")

    def _body(self) -> Body:
        radius, width = self.known.number("wheel_radius"), self.known.number("base_width")
        if not radius > 0.0:
            text = "How large is the radius of a drive wheel? Half its diameter, by a calliper."
            radius = self._guide.number("floor.radius", text, "mm", 5.0, 1000.0) / 1000.0
        if not width > 0.0:
            text = "How far are the drive wheels apart, from the middle of one to that of the other?"
            width = self._guide.number("floor.width", text, "mm", 20.0, 5000.0) / 1000.0
        ticks = self.known.driver["ticks_per_turn"]
        assert isinstance(ticks, int)
        return Body(radius, width, ticks)

    @property
    def _dead(self) -> list[str]:
        dead = self.known.found.get("dead_encoders")
        return dead if isinstance(dead, list) else []

    def _wait(self, seconds: float) -> None:
        """Let time pass; a running driver continues."""
        end = self._place.host.monotonic() + seconds
        while self._place.host.monotonic() < end:
            if self._bench_now is not None:
                self._bench_now.turn()
            else:
                self._place.world.turn(None)

    @contextmanager
    def _bench(self, step: str, **changed: bool | float | None) -> Iterator[Bench]:
        """Open the robot with known wiring, and some settings changed."""
        self._need("devices")
        if step not in WITH_GYRO:
            changed |= {"gyro_port": None, "gyro_baud": None, "gyro": None}
        settings = self.known.settings(self._robot, acceleration=GENTLE, rate=RATE, **changed)
        with opened(settings, self._place.host, self._place.world, self._place.driver) as bench:
            self._bench_now = bench
            try:
                yield bench
            finally:
                self._bench_now = None

    def _need(self, *steps: str) -> None:
        """Raise CannotTell if one of these steps is still undecided."""
        missing = [step for step in steps if step in self.known.undecided]
        if missing:
            raise CannotTell(f"the step {missing[0]} has to come first (cmr bringup {missing[0]})")

    def _lift(self) -> None:
        if not self._lifted:
            self._guide.ask("lifted", LIFT, LIFTED)
            self._lifted = True


WIRING = ("swap", "invert_left", "invert_right", "swap_encoders", "invert_left_encoder", "invert_right_encoder")
STEPS = ("devices", "motors", "ticks", "stop", "battery", "gyro", "floor")


def _said(value: Plain) -> str:
    return "unset" if value is None else {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
