"""The test bench: relays on the ports, the driver as a separate process, its commands, and everything that it
publishes.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from cmr.bus.bus import Bus
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, ESTOP_LATCH, GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PROCESS_STATUS
from cmr.cli.errors import CommandError
from cmr.cli.options import arguments_of
from cmr.msg import estop_latch_t, estop_t, gyro_t, motor_command_t, motor_feedback_t, process_status_t
from robot_driver.acceptance.dialects import DIALECTS, Dialect
from robot_driver.acceptance.filter import Filter, GyroFilter
from robot_driver.acceptance.record import Record, Span, Wire
from robot_driver.acceptance.relay import Relay
from robot_driver.clock import utime_at
from robot_driver.controllers import CONTROLLERS
from robot_driver.gyros import GYROS
from robot_driver.serial_port import PortLost
from robot_driver.settings import Settings

COMMAND_PERIOD = 0.02  # s
ESTOP_PERIOD = 0.05  # s
READY = 10.0  # s until a driver must be ready
ENDING = 3.0  # s
SOURCE = "cmr accept"
DRIVER = (sys.executable, "-c", "import sys; from cmr.commands import driver; sys.exit(driver())")
STOPPED_BY = "ESTOP was engaged by {}: {}. Nothing moves any more; start again when it is released."

Duty = tuple[float, float]


class Ended(CommandError):  # noqa: N818 - no fault: somebody wanted it
    """A person, or an emergency stop, ended the protocol."""


@dataclass
class Setup:
    """The robot under test: how its driver is started, the bus, and a temporary folder.

    `command` starts cmr-driver; tests use deliberately broken ones.
    """

    settings: Settings
    folder: Path
    url: str | None = None
    duty: float = 0.1
    command: Sequence[str] = DRIVER

    @property
    def dialect(self) -> Dialect | None:
        """The protocol of this controller, if the filter supports it."""
        kind = DIALECTS.get(self.settings.controller)
        return kind() if kind else None


@dataclass
class Bench:
    """The resources of the protocol's steps. `ended` is called continuously, and raises Ended."""

    setup: Setup
    look: Callable[[], None] = lambda: None
    record: Record = field(default_factory=Record)
    process: "subprocess.Popen[bytes] | None" = None
    filter: Filter | None = None
    gyro: GyroFilter | None = None
    relay: Relay | None = None
    gyro_relay: Relay | None = None

    def __post_init__(self) -> None:
        self.bus = Bus(self.setup.url)
        robot = self.setup.settings.robot
        for stream in (MOTOR_FEEDBACK, GYRO, ESTOP_LATCH):
            self.bus.subscribe(stream, robot, every=True)
        self.bus.subscribe(PROCESS_STATUS, every=True)
        self.bus.subscribe(ESTOP, every=True)
        self._command_due = self._estop_due = 0.0
        self.commanded = 0  # time of the last command other than zero (ns)
        self.estop: bool | None = None  # whether to engage the stop continuously; None: send nothing
        self._estop_decided = 0
        self._drivers = 0
        self.is_ready = False

    @contextmanager
    def relayed(self) -> Iterator[None]:
        """Insert filters between the driver and the ports."""
        settings, dialect = self.setup.settings, self.setup.dialect
        assert dialect is not None
        with ExitStack() as stack:
            self.filter = Filter(dialect)
            baud = settings.baud or CONTROLLERS[settings.controller].default_baud_rate
            self.relay = stack.enter_context(Relay(settings.port, baud, self._link("motor"), self.filter))
            self.gyro = None
            if settings.gyro_port:
                self.gyro = GyroFilter()
                baud = settings.gyro_baud or GYROS[settings.gyro or "dsp3000"].baud_rate
                self.gyro_relay = stack.enter_context(Relay(settings.gyro_port, baud, self._link("gyro"), self.gyro))
            try:
                yield
            finally:
                self.relay = None
                self.end()

    def _link(self, name: str) -> Path:
        self.setup.folder.mkdir(parents=True, exist_ok=True)
        return self.setup.folder / name

    def start(self, *, direct: str = "", state: str = "state", **changes: object) -> None:
        """Start the driver, on the filters or `direct`ly on a port, with other settings if given."""
        settings: Settings = replace(self.setup.settings, state=self.setup.folder / state, **changes)  # type: ignore[arg-type]
        if direct:
            settings = replace(settings, port=direct)
        else:
            gyro = str(self._link("gyro")) if settings.gyro_port else None
            settings = replace(settings, port=str(self._link("motor")), gyro_port=gyro)
        self.process = self.other_driver(settings)
        self.record.offset = 1000 * utime_at(time.monotonic_ns()) - time.monotonic_ns()

    def other_driver(self, settings: Settings) -> "subprocess.Popen[bytes]":
        """Start a driver; its stderr goes to a file, see `errors`."""
        self._drivers += 1
        command = [*self.setup.command, *arguments_of(settings), "--lcm-url", self.bus.url]
        with self.errors_path(self._drivers).open("wb") as errors:
            return subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=errors, start_new_session=True)

    def errors_path(self, number: int) -> Path:
        """Return the file with a driver's stderr."""
        return self._link(f"driver-{number}.txt")

    def errors(self) -> str:
        """Return the stderr of the driver that was started last."""
        return self.errors_path(self._drivers).read_text(errors="replace")

    def end(self, number: int = signal.SIGTERM) -> int | None:
        """End the driver by a signal; return its exit code, None if it did not end."""
        process, self.process = self.process, None
        if process is None:
            return None
        with suppress(ProcessLookupError):
            process.send_signal(number)
            process.send_signal(signal.SIGCONT)
        end = time.monotonic() + ENDING
        while process.poll() is None and time.monotonic() < end:
            self.turn(None, look=False)
        code = process.poll()
        if code is None:
            process.kill()
            process.wait()
        return code

    def gate_pid(self) -> int | None:
        """Return the process of the last gate, the driver's only child."""
        assert self.process is not None
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        found: list[str] = []
        with suppress(OSError):
            for tasks in children.parent.parent.glob("*/children"):
                found += tasks.read_text().split()
        return int(found[0]) if found else None

    def turn(self, duty: Duty | None, *, look: bool = True) -> None:
        """Command a duty if due (None: nothing), send the stop state, and listen briefly."""
        now = time.monotonic()
        if duty is not None and now >= self._command_due:
            self._command_due = max(self._command_due + COMMAND_PERIOD, now)
            self.command(*duty)
        if self.estop is not None and now >= self._estop_due:
            self._estop_due = now + ESTOP_PERIOD
            utime = now_utime() if self.estop else self._estop_decided
            message = make(estop_t, utime=utime, engaged=self.estop, source=SOURCE, reason="a test of promise 18 or 19")
            self.bus.publish(ESTOP, message)
        self._hear(0.01)
        if self.relay is not None and self.relay.problem:
            raise PortLost(self.relay.problem)
        if look:
            self.look()

    def command(self, left: float, right: float, age: float = 0.0) -> None:
        """Command a duty, as of `age` seconds ago."""
        utime, robot = now_utime() - round(1e6 * age), self.setup.settings.robot
        self.bus.publish(
            MOTOR_COMMAND, make(motor_command_t, utime=utime, robot_id=robot, left=left, right=right), robot
        )
        if (left or right) and not age:
            self.commanded = time.monotonic_ns()

    def set_estop(self, engaged: bool) -> int:
        """Engage or release the stop from now on; return the time (ns)."""
        self.estop, self._estop_decided, self._estop_due = engaged, now_utime(), 0.0
        self.turn(None)
        return self.record.moment(self._estop_decided)

    def release(self, age: float = 0.0, name: str = SOURCE) -> None:
        """Release the stop once, as `name`, as of `age` seconds ago."""
        utime = now_utime() - round(1e6 * age)
        self.bus.publish(ESTOP, make(estop_t, utime=utime, engaged=False, source=name, reason="a test of promise 18"))

    def go_on(
        self, seconds: float, duty: Callable[[float], Duty] | None, until: Callable[[], object] = lambda: False
    ) -> Span:
        """Command `duty` for some seconds, or until a condition holds; return start and end."""
        begin = time.monotonic_ns()
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0.0 and not until():
            self.turn(duty(seconds - remaining) if duty else None)
        return Span(begin, time.monotonic_ns())

    def until_ready(self) -> bool:
        """Command zero until the driver is ready; return whether it is."""
        assert self.process is not None
        process = self.process
        heard = len(self.record.statuses)

        def ready() -> bool:
            recent = self.record.statuses[heard:]
            return process.poll() is not None or any(
                one.state == process_status_t.RUNNING and one.pid == process.pid for one in recent
            )

        self.go_on(READY, lambda _: (0.0, 0.0), ready)
        self.go_on(2 * COMMAND_PERIOD, lambda _: (0.0, 0.0))
        self.is_ready = process.poll() is None and bool(ready())
        return self.is_ready

    def until_served(self) -> None:
        """Command zero until the motors are served again, and the driver's earlier state has expired."""

        def served() -> bool:
            now = self.record.offset + time.monotonic_ns()
            fresh = [one for one in self.record.feedback[-8:] if now - 1000 * one.utime < 400_000_000]
            return len(fresh) == 8 and not any(one.status for one in fresh)

        self.go_on(READY, lambda _: (0.0, 0.0), served)

    def wire(self) -> Wire:
        """Return the data that have passed the filter so far."""
        assert self.filter is not None
        return Wire(self.filter.dialect, self.setup.settings.wiring, self.filter.exchanges)

    def ask_counts(self, seconds: float) -> None:
        """Read the encoders for some time while no driver runs."""
        assert self.filter is not None
        assert self.relay is not None
        line, end = self.filter, time.monotonic() + seconds
        while time.monotonic() < end:
            self.relay.hand_over(lambda now: line.own_request(line.dialect.ask_counts, now))
            self.go_on(0.02, None)

    def _hear(self, seconds: float) -> None:
        for received in self.bus.receive(seconds):
            message = received.message
            if isinstance(message, motor_feedback_t):
                self.record.feedback.append(message)
            elif isinstance(message, gyro_t):
                self.record.gyro.append(message)
            elif isinstance(message, process_status_t) and self._is_ours(message):
                self.record.statuses.append(message)
            elif isinstance(message, estop_latch_t):
                self.record.latches.append(message)
            elif isinstance(message, estop_t) and message.engaged and message.source != SOURCE:
                raise Ended(STOPPED_BY.format(message.source, message.reason))

    def _is_ours(self, status: process_status_t) -> bool:
        return self.process is not None and status.pid == self.process.pid


def kill(*pids: int | None) -> int:
    """Kill processes; return the time (ns)."""
    at = time.monotonic_ns()
    for pid in pids:
        if pid is not None:
            os.kill(pid, signal.SIGKILL)
    return at
