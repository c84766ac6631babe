"""The last gate as a process: whatever becomes of the driver, the motors stop; and if the gate dies, so do they."""

import os
import signal
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import pytest

from cmr.bus.process import EXIT_INTERRUPTED
from robot_driver import gate
from robot_driver.controllers import CONTROLLERS
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.devices import CONTROLLER_DEVICES
from robot_driver.emulator.settings import load_settings
from robot_driver.gate.messages import (
    REPORT_LENGTH,
    SECOND,
    WORD_LENGTH,
    Kind,
    Malformed,
    Reason,
    Report,
    Word,
    packed_word,
    report_in,
)
from robot_driver.gate.process import now
from robot_driver.gate.wire_roboclaw import packet
from robot_driver.terminals.pseudo_terminal import Ports
from tests.robot_driver.golden_vectors import ROBOCLAW_STOP
from tests.robot_driver.test_every_device import NotedPlant
from tests.support.driver_bench import DriverProcess, PunctualEngine, Robot, driving, wait_for
from tests.support.gates import gate_of, gates_of, is_gone

pytestmark = pytest.mark.real_time

LIMIT = 0.5 + 0.01  # s; and a cycle
HELD_UP = 0.15  # s; this machine's, not the promise's
FOLDER = Path(gate.__file__).parent
MOST_LINES = 1_000  # what a person reads in an hour
START = [sys.executable, "-I", "-S", str(FOLDER / "__main__.py")]


def noted_zeros(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return a list that takes when the robot hears a zero (s), from whomever."""
    heard: list[float] = []
    receive = robot.device.receive

    def noted(data: bytes, moment: float) -> list[Transmission]:
        if ROBOCLAW_STOP in data:
            heard.append(time.monotonic())
        return receive(data, moment)

    monkeypatch.setattr(robot.device, "receive", noted)
    return heard


def test_6_a_driver_that_is_stopped_leaves_the_gate_stopping_the_motors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with driving(tmp_path) as (robot, driver):
        heard = noted_zeros(robot, monkeypatch)
        driver.command(0.5, 0.5)
        commanded = time.monotonic()
        driver.process.send_signal(signal.SIGSTOP)
        wait_for(lambda: robot.device.duty == [0, 0])
        stopped = robot.drives[-1][0]
        assert stopped - commanded < LIMIT + HELD_UP
        assert heard, "the controller's own watchdog was not needed"
        assert heard[0] - stopped < HELD_UP
        driver.process.send_signal(signal.SIGCONT)
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        driver.command_until(lambda: any("Stopped by the last gate: 1." in s.message for s in driver.statuses))
        _, terminal = driver.end()
        assert "the last gate stopped the motors" in terminal


def test_6_a_driver_that_is_killed_leaves_the_gate_stopping_the_motors_and_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with driving(tmp_path) as (robot, driver):
        heard = noted_zeros(robot, monkeypatch)
        process = gate_of(driver.process.pid)
        driver.process.kill()
        killed = time.monotonic()
        wait_for(lambda: robot.device.duty == [0, 0])
        assert robot.drives[-1][0] - killed < HELD_UP
        wait_for(lambda: is_gone(process))
        assert time.monotonic() - killed < LIMIT + HELD_UP
        assert len(heard) == 2, "acknowledged, and not by an answer to what was sent before"


def test_6_a_driver_that_is_killed_with_its_gate_leaves_the_controller_stopping_the_motors(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        process = gate_of(driver.process.pid)
        driver.process.send_signal(signal.SIGSTOP)
        os.kill(process, signal.SIGKILL)
        driver.process.kill()
        killed = time.monotonic()
        wait_for(lambda: robot.device.duty == [0, 0])
        assert 0.4 < robot.drives[-1][0] - killed < 0.5 + HELD_UP


@pytest.mark.parametrize("kind", sorted(CONTROLLERS))
def test_6_the_gate_stops_every_kind_of_controller(tmp_path: Path, kind: str) -> None:
    emulated = load_settings().ideal()
    plant = NotedPlant(emulated)
    device = CONTROLLER_DEVICES[kind](emulated, plant)
    with Ports(tmp_path, ("motor",)) as ports, PunctualEngine(plant, {"motor": device}, ports.terminals):
        driver = DriverProcess(tmp_path, "--controller", kind)
        try:
            driver.command_until(lambda: min(plant.driven) > 0.45)
            process = gate_of(driver.process.pid)
            driver.process.kill()
            killed = time.monotonic()
            wait_for(lambda: plant.driven == (0.0, 0.0))
            assert time.monotonic() - killed < HELD_UP, "well before the controller's own watchdog"
            wait_for(lambda: is_gone(process))
        finally:
            driver.end(signal.SIGKILL)


# A driver without a bus that drives until a byte comes, and then does something bad.
BAD_DRIVER = """
import select, sys, time
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import MOTOR_COMMAND
from cmr.msg import motor_command_t
from robot_driver.driver import Driver
from robot_driver.settings import Settings
from tests.support.driver_bench import open_gate_of, wait_for

with Driver(Settings(port=sys.argv[1])) as driver:
    wait_for(lambda: not driver.problems())
    open_gate_of(driver)
    while not select.select([sys.stdin], [], [], 0.005)[0]:
        driver.turn()
        command = make(motor_command_t, utime=now_utime(), robot_id=0, left=0.5, right=0.5)
        driver.handle(command.utime, MOTOR_COMMAND.channel(0), command)
{bad}
"""
HANG = "    import itertools; print('now', flush=True); max(itertools.repeat(0, 10**12))"
MEMORY = """    import resource
    used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2**20, used + 2**20))
    print('now', flush=True)
    kept = []
    while True:
        try:
            kept.append(bytes(1000))
        except MemoryError:
            pass"""
EXCEPTION = """    print('now', flush=True)
    driver._motors._drive = driver._motors.leave = None
    time.sleep(100.0)"""
SLEEP = "    print('now', flush=True); time.sleep(100.0)"


@pytest.mark.parametrize("bad", [HANG, MEMORY, EXCEPTION, SLEEP], ids=["hang", "memory", "exception", "deaf"])
def test_6_a_driver_that_hangs_or_has_no_memory_or_fails_leaves_the_gate_stopping_the_motors(
    tmp_path: Path, bad: str
) -> None:
    robot = Robot(tmp_path)
    command = [sys.executable, "-c", BAD_DRIVER.replace("{bad}", bad), str(tmp_path / "motor")]
    driver = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert driver.stdin is not None
    assert driver.stdout is not None
    try:
        wait_for(lambda: robot.device.duty == [16384, 16384])
        driver.stdin.write(b"x")
        driver.stdin.flush()
        assert driver.stdout.readline() == b"now\n"
        began = time.monotonic()
        wait_for(lambda: robot.device.duty == [0, 0])
        assert robot.drives[-1][0] - began < LIMIT + HELD_UP
        time.sleep(0.3)
        assert robot.device.duty == [0, 0]
    finally:
        driver.kill()
        driver.wait()
        driver.stdin.close()
        driver.stdout.close()
        robot.unplug()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["dies", "hangs"])
def test_a_gate_that_dies_or_hangs_stops_the_motors_too_and_is_started_again(tmp_path: Path, number: int) -> None:
    with driving(tmp_path) as (robot, driver):
        first, count = gate_of(driver.process.pid), len(robot.drives)
        os.kill(first, number)
        ended = time.monotonic()
        wait_for(lambda: robot.device.duty == [0, 0])
        assert robot.drives[-1][0] - ended < LIMIT + HELD_UP
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        assert time.monotonic() - ended < 2.0
        assert (0, 0) in [drive[1:] for drive in robot.drives[count:]]
        assert gate_of(driver.process.pid) != first
        code, terminal = driver.end()
        assert "the last gate was started again" in terminal
        assert "The last gate, the process that writes to the motors' port" in terminal or number == signal.SIGSTOP
        assert code == EXIT_INTERRUPTED


def test_a_computer_that_stood_still_does_not_cost_the_gate_its_life(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        gate_process, both = gate_of(driver.process.pid), (driver.process.pid, gate_of(driver.process.pid))
        for process in both:
            os.kill(process, signal.SIGSTOP)
        time.sleep(1.5)  # nearly twice as long as a gate may be silent
        os.kill(both[0], signal.SIGCONT)
        time.sleep(0.1)
        os.kill(both[1], signal.SIGCONT)
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        assert gate_of(driver.process.pid) == gate_process
        _, terminal = driver.end()
        assert "the last gate was started again" not in terminal


def test_19_after_the_death_of_the_gate_the_emergency_stop_is_still_in_force(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.estop(True)
        driver.command_until(lambda: robot.device.duty == [0, 0])
        first, count = gate_of(driver.process.pid), len(robot.drives)
        os.kill(first, signal.SIGKILL)
        driver.command_until(lambda: [one for one in gates_of(driver.process.pid) if one != first])
        end = time.monotonic() + 1.5
        driver.command_until(lambda: time.monotonic() > end)
        assert {drive[1:] for drive in robot.drives[count:]} <= {(0, 0)}
        driver.estop(False)
        driver.command(0.0, 0.0)
        driver.command_until(lambda: robot.device.duty == [16384, 16384])


def test_6_signals_of_a_terminal_or_a_service_leave_the_gate_alone(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        process = gate_of(driver.process.pid)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP, signal.SIGQUIT, signal.SIGPIPE):
            os.kill(process, number)
        assert os.getsid(process) == process != os.getsid(driver.process.pid)
        count = len(robot.drives)
        end = time.monotonic() + 0.5
        driver.command_until(lambda: time.monotonic() > end)
        assert {drive[1:] for drive in robot.drives[count:]} <= {(16384, 16384)}
        assert driver.end()[0] == EXIT_INTERRUPTED
        assert is_gone(process)


class Peer:
    """The driver's end of the socket of a gate, which has a port that goes nowhere."""

    def __init__(self, parent: int) -> None:
        self.link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [*START, str(theirs.fileno()), "roboclaw", "000", str(SECOND // 100), "", str(parent)]
        self.process = subprocess.Popen(command, pass_fds=[theirs.fileno()], stderr=subprocess.PIPE)
        theirs.close()
        self.link.settimeout(5.0)
        self.sequence = 0

    def send(self, kind: Kind, data: bytes = b"", descriptor: int | None = None) -> None:
        self.sequence += 1
        word = Word(kind, self.sequence, now(), False, False, 0.5, 0.5, now() + SECOND // 4, data)
        descriptors = [] if descriptor is None else [descriptor]
        socket.send_fds(self.link, [packed_word(word)], descriptors)

    def report(self, wanted: Callable[[Report], bool]) -> Report:
        end = time.monotonic() + 5.0
        while time.monotonic() < end:
            report = report_in(self.link.recv(REPORT_LENGTH + 1))
            if wanted(report):
                return report
        raise AssertionError("waited in vain")


@contextmanager
def peer() -> Iterator[Peer]:
    result = Peer(os.getpid())
    try:
        yield result
    finally:
        result.link.close()
        _, errors = result.process.communicate(timeout=5.0)
        assert errors == b""
        assert result.process.returncode == 0


def test_malformed_bytes_on_the_pipe_are_refused_and_the_gate_goes_on(silent_port: str) -> None:
    chance = Random(1)
    with peer() as driver:
        driver.report(lambda _: True)
        files = Path(f"/proc/{driver.process.pid}/fd")
        before, sent = len(list(files.iterdir())), 0
        port = os.open(silent_port, os.O_RDWR | os.O_NOCTTY)
        driver.send(Kind.OPEN, descriptor=port)
        for length in (0, 1, WORD_LENGTH, WORD_LENGTH + 1, 60_000):
            for _ in range(20):
                socket.send_fds(driver.link, [chance.randbytes(length)], [port] * chance.randrange(4))
                sent += 1
        driver.send(Kind.OPEN)  # without a port
        driver.send(Kind.FEED, descriptor=port)  # with one
        sequence, driver.sequence = driver.sequence, 0
        driver.send(Kind.WRITE, ROBOCLAW_STOP)  # of before
        driver.sequence = sequence
        driver.send(Kind.WRITE, b"\x80\x23 anything else")
        report = driver.report(lambda report: report.refused[Reason.FOREIGN] == 1)
        assert report.refused[Reason.MALFORMED] == sent + 3
        assert report.has_port
        assert len(list(files.iterdir())) == before + 1
        os.close(port)


def test_a_device_that_is_gone_does_not_hold_up_the_gate() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    with peer() as driver:
        driver.send(Kind.OPEN, descriptor=slave)
        driver.send(Kind.WRITE, packet(b"\x80\x0e", b"\x05"))  # its watchdog
        driver.send(Kind.WRITE, packet(b"\x80\x22", b"\x10\x00\x10\x00"))
        wait_for(lambda: len(os.read(master, 100)) > 0)
        os.close(master)
        os.close(slave)
        driver.send(Kind.CLOSE)
        began = time.monotonic()
        driver.report(lambda report: report.sequence == driver.sequence)
        assert time.monotonic() - began < HELD_UP


def test_a_gate_whose_parent_is_another_ends() -> None:
    with peer() as driver:
        driver.report(lambda _: True)
        assert driver.process.poll() is None
    orphan = Peer(1 if os.getpid() != 1 else 2)
    assert orphan.process.wait(5.0) == 0
    orphan.link.close()
    assert orphan.process.stderr is not None
    orphan.process.stderr.close()


def test_a_silent_controller_does_not_keep_a_gate_whose_driver_is_gone(silent_port: str) -> None:
    port = os.open(silent_port, os.O_RDWR | os.O_NOCTTY)
    with peer() as driver:
        driver.send(Kind.OPEN, descriptor=port)
        driver.report(lambda report: report.has_port)
        os.close(port)
        began = time.monotonic()
    assert time.monotonic() - began < 1.0


def test_reports_are_told_from_other_messages() -> None:
    with pytest.raises(Malformed):
        report_in(bytes(REPORT_LENGTH))


def test_the_gate_imports_nothing_but_itself_and_a_little_of_the_standard_library() -> None:
    said = subprocess.run([*START, "--modules"], capture_output=True, text=True, timeout=20.0, check=True)
    modules = {line.split()[0] for line in said.stdout.splitlines()}
    ours = {name for name in modules if name.partition(".")[0] in ("cmr", "robot_driver")}
    assert ours == {"robot_driver", "robot_driver.gate", *(f"robot_driver.gate.{path.stem}" for path in python_files())}
    others = {name.partition(".")[0] for name in modules - ours} - {"__main__"}
    assert others <= set(sys.stdlib_module_names)
    assert not others & {"lcm", "yaml", "numpy", "serial", "threading", "subprocess", "json", "pickle", "importlib"}


def python_files() -> list[Path]:
    return [path for path in sorted(FOLDER.glob("*.py")) if not path.stem.startswith("__")]


def test_all_of_the_gate_can_be_read_in_an_hour() -> None:
    lines = {path.name: len(path.read_text("utf-8").splitlines()) for path in sorted(FOLDER.rglob("*.py"))}
    assert set(lines) == {
        "__init__.py",
        "__main__.py",
        "guard.py",
        "messages.py",
        "process.py",
        "wire.py",
        "wire_mbot.py",
        "wire_roboclaw.py",
        "wire_roboteq.py",
    }
    assert sum(lines.values()) <= MOST_LINES, lines
