"""An emulated robot for the acceptance protocol, with the hand of a person at its cable and at its switch."""

import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from robot_driver import serial_port
from robot_driver.acceptance import direct
from robot_driver.acceptance.bench import Setup
from robot_driver.acceptance.findings import PROMISES
from robot_driver.acceptance.protocol import run_protocol
from robot_driver.acceptance.report import Report
from robot_driver.acceptance.running import SHORT, Pace
from robot_driver.emulator.dsp3000_device import Dsp3000Device
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.faults import Faults, FaultyLine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.settings import load_settings
from robot_driver.guided import Guide, Kind, Scripted, Step
from robot_driver.settings import Settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.private_bus import private_url

HAND_TAKES = 0.5  # s
PORTS = ("ttyUSB0", "gyro")
STABLE = "by-id-robot"  # a name that leads to the numbered one
NUMBERED = r"(/dev|.*)/tty(USB|ACM)[0-9]+"  # as on a real computer, and in the folder of a test
Breaking = Callable[[RoboclawDevice, Dsp3000Device], None]
START = "import sys; from tests.support.sabotage import start; sys.exit(start(sys.argv.pop(1)))"


class LastingEngine(Engine):
    """An engine that goes on in the time of one before it."""

    def __init__(self, begun: float | None, *arguments: object) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self._begun = begun

    def __enter__(self) -> "LastingEngine":
        super().__enter__()
        if self._begun is not None:
            self._start = self._begun
        return self


class AcceptedRobot:
    """A RoboClaw with a gyro, behind ports in `folder`. `break_device` may change it before it is switched on."""

    def __init__(
        self, folder: Path, break_device: Callable[[RoboclawDevice, Dsp3000Device], None] | None = None
    ) -> None:
        self.folder = folder
        settings = replace(load_settings(), seed=3)
        self._plant = Plant(settings)
        self.device, self.gyro = RoboclawDevice(settings, self._plant), Dsp3000Device(settings, self._plant)
        if break_device is not None:
            break_device(self.device, self.gyro)
        self.line = FaultyLine(self.device, Faults())
        self._begun: float | None = None
        self._plugged: ExitStack | None = None
        self.plug_in()
        (folder / STABLE).symlink_to(folder / PORTS[0])

    def plug_in(self) -> None:
        """Have the ports be there."""
        with ExitStack() as stack:
            ports = stack.enter_context(Ports(self.folder, PORTS))
            devices = {PORTS[0]: self.line, PORTS[1]: self.gyro}
            engine = LastingEngine(self._begun, self._plant, devices, ports.terminals)
            stack.enter_context(engine)
            self._begun = engine._start
            self._engine = engine
            self._plugged = stack.pop_all()

    def unplug(self) -> None:
        """Have the ports vanish; the robot goes on."""
        if self._plugged is not None:
            self._plugged.close()
            self._plugged = None

    def switch(self, on: bool) -> None:
        """Switch the battery of the motors off, so that nothing answers, or on."""
        if on:
            self.device.board.switch_on()
        else:
            self.device.board.stop()
        self.line.faults = Faults(silent=not on, deaf=not on)


class Hand:
    """What a person does at the robot, step by step; each takes a moment."""

    def __init__(self, robot: AcceptedRobot) -> None:
        self._robot = robot
        self._since: dict[str, float] = {}
        self._done: set[str] = set()

    def person(self) -> Scripted:
        """Return who answers, and does what is asked for."""
        return Scripted(
            {
                "hand-cable": "ready",
                "hand-pull": lambda step: self._does(step, self._robot.unplug),
                "hand-plug": lambda step: self._done_by(step, self._robot.plug_in),
                "hand-switch": "ready",
                "hand-off": lambda step: self._does(step, lambda: self._robot.switch(False)),
                "hand-on": lambda step: self._done_by(step, lambda: self._robot.switch(True)),
            }
        )

    def _done_by(self, step: Step, what: Callable[[], None]) -> str:
        """Do something, and say so."""
        self._does(step, what)
        return "done"

    def _does(self, step: Step, what: Callable[[], None]) -> None:
        """Do something once, after a moment; the answer to a motion would end it, so there is none."""
        if step.name in self._done:
            return
        begun = self._since.setdefault(step.name, time.monotonic())
        if step.kind is Kind.QUESTION or time.monotonic() - begun > HAND_TAKES:
            self._done.add(step.name)
            what()


def accept(
    folder: Path,
    broken: str = "",
    *,
    wanted: Sequence[int] = tuple(PROMISES),
    break_device: Breaking | None = None,
    hands: bool = True,
    pace: Pace = SHORT,
) -> Report:
    """Run the protocol against an emulated robot, with a driver that is `broken` in that way."""
    robot = AcceptedRobot(folder, break_device)
    settings = Settings(port=str(folder / STABLE), gyro_port=str(folder / PORTS[1]))
    setup = Setup(settings, folder / "bench", private_url(), command=(sys.executable, "-c", START, broken))
    person = Hand(robot).person()
    with numbered_ports():
        try:
            return run_protocol(setup, lambda wait: Guide(person, wait), pace=pace, wanted=wanted, hands=hands)
        finally:
            robot.unplug()


@contextmanager
def numbered_ports() -> Iterator[None]:
    """Have the ports of emulated robots count as numbered ones."""
    before, numbered = serial_port.NUMBERED, re.compile(NUMBERED)
    for module in (serial_port, direct):
        setattr(module, "NUMBERED", numbered)  # noqa: B010 - one of them only imports it
    try:
        yield
    finally:
        for module in (serial_port, direct):
            setattr(module, "NUMBERED", before)  # noqa: B010


class Busy:
    """A core that is busy, as a context manager."""

    def __enter__(self) -> "Busy":
        self._process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
