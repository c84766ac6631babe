"""Promises 10, 11 and 12: ports come and go, have two kinds of names, and belong to one driver."""

import fcntl
import sys
import threading
import time
from pathlib import Path

import pytest

from cmr.bus.messages import now_utime
from cmr.msg import process_status_t
from robot_driver import port_thread, serial_port
from robot_driver.controllers import Request
from robot_driver.driver import Driver
from robot_driver.host import Terminal
from robot_driver.port_thread import Device, PortThread
from robot_driver.serial_port import PortLost, SerialPort, numbering_warning
from robot_driver.settings import Settings
from robot_driver.stream_port import PATIENCE, StreamPort
from tests.support.driver_bench import DriverProcess, driving

pytestmark = pytest.mark.real_time

TIOCGEXCL = 0x80045440  # of Linux: whether TIOCEXCL holds


def test_10_12_unplugging_is_told_at_once_and_the_robot_starts_from_zero_behind_the_same_name(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        second = DriverProcess(tmp_path)
        assert second.process.wait(20.0) == 1
        assert "Another program is using" in second.end()[1]

        unplugged = now_utime()
        robot.unplug()
        driver.statuses.clear()
        driver.command_until(lambda: any(status.state == process_status_t.DEGRADED for status in driver.statuses))
        told = next(status for status in driver.statuses if status.state == process_status_t.DEGRADED)
        assert "gone" in told.message
        assert told.utime - unplugged < 500_000

        robot.drives.clear()
        robot.plug_in()
        driver.statuses.clear()
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        assert robot.drives[0][1:] == (0, 0)
        driver.command_until(lambda: driver.statuses and driver.statuses[-1].state == process_status_t.RUNNING)


class CountedPauses(threading.Event):
    """Notes how long it is to be waited for, and does not wait; set after eight times."""

    def __init__(self) -> None:
        super().__init__()
        self.pauses: list[float | None] = []

    def wait(self, timeout: float | None = None) -> bool:
        self.pauses.append(timeout)
        if len(self.pauses) == 8:
            self.set()
        return self.is_set()


class Elusive(Device):
    """A device that can be connected to at the fourth attempt, once, and is lost again at once."""

    def __init__(self) -> None:
        self.attempts = 0

    def connect(self, stop: threading.Event) -> None:  # noqa: ARG002 - as of any device
        self.attempts += 1
        if self.attempts != 4:
            raise PortLost("not there")

    def turn(self, stop: threading.Event) -> None:  # noqa: ARG002 - as of any device
        raise PortLost("lost")

    def leave(self) -> None:
        pass


def test_10_between_attempts_to_get_a_device_back_the_pauses_grow_to_a_second(silent_port: str) -> None:
    thread = PortThread(SerialPort(silent_port, 115200), Elusive())
    thread._stop = pauses = CountedPauses()
    with thread:
        thread._thread.join(10.0)
    assert pauses.pauses == [0.1, 0.2, 0.4, 0.1, 0.2, 0.4, 0.8, 1.0]


class Leaving(Device):
    """Does nothing but leave, and notes that; where there is another, not before that one has left."""

    def __init__(self, after: "Leaving | None" = None) -> None:
        self.has_left = threading.Event()
        self.came_after: bool | None = None
        self._after = after

    def connect(self, stop: threading.Event) -> None:
        pass

    def turn(self, stop: threading.Event) -> None:
        stop.wait()

    def leave(self) -> None:
        self.came_after = self._after.has_left.wait(2.0) if self._after else None
        self.has_left.set()


def test_9_the_gyro_is_left_while_the_motors_are_still_being_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_thread, "STOP_TIMEOUT", 10.0)
    driver = Driver(Settings(port=str(tmp_path / "motor"), gyro_port=str(tmp_path / "gyro")))
    gyro = Leaving()
    motors = Leaving(after=gyro)
    for thread, device in zip(driver._threads, (motors, gyro), strict=True):
        thread.device = device
        monkeypatch.setattr(thread.port, "open", lambda: None)
    with driver:
        pass
    assert motors.came_after


class Failing(Leaving):
    """Fails as it is left, by a fault of the program."""

    def leave(self) -> None:
        raise ZeroDivisionError


def test_a_fault_of_the_program_while_a_device_is_left_is_not_hidden(silent_port: str) -> None:
    port = SerialPort(silent_port, 115200)
    with PortThread(port, Failing()) as thread:
        thread.ask_to_stop()
        thread._thread.join()
        with pytest.raises(ZeroDivisionError):
            _ = thread.problem
    with pytest.raises(PortLost, match="not open"):
        port.write(b"x")


def is_exclusive(port: SerialPort) -> bool:
    line = port._opened()
    assert isinstance(line, Terminal)
    return bool(int.from_bytes(fcntl.ioctl(line.fileno(), TIOCGEXCL, bytes(4)), sys.byteorder))


def test_12_the_kernel_refuses_a_port_to_all_others_but_not_a_pseudo_terminal(
    silent_port: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = SerialPort(silent_port, 115200)
    port.open()
    assert not is_exclusive(port)
    port.close()
    monkeypatch.setattr(serial_port, "PSEUDO_TERMINALS", "/nowhere/")  # as if this were a port of hardware
    port.open()
    assert is_exclusive(port)
    port.close()


@pytest.mark.parametrize(("late", "believed"), [(0.01, True), (-0.001, False), (0.2, False)])
def test_14_a_time_by_a_boards_clock_that_cannot_be_is_not_believed(
    silent_port: str, late: float, believed: bool
) -> None:
    port = StreamPort(silent_port, 115200)
    told = 0

    def measured() -> int:
        nonlocal told
        told = time.monotonic_ns() - round(1e9 * late)
        return told

    port.open()
    answer = port.exchange(Request("time", b"", 0, lambda _reply: 0, lambda _reply: None, measured=measured))
    port.close()
    assert answer.measured == (told if believed else answer.arrived)


class Busy(StreamPort):
    """A port at which something waits; nothing more comes."""

    def __init__(self, waiting: list[bytes]) -> None:
        super().__init__("", 115200)
        self.waiting = waiting

    def write(self, data: bytes) -> None:
        pass

    def read(self, most: int, timeout: float) -> bytes:  # noqa: ARG002 - pieces are as long as they came
        return self.waiting.pop(0) if self.waiting else b""


@pytest.mark.parametrize("ends_in_silence", [False, True])
def test_what_waits_when_the_process_was_held_up_is_heard_before_a_board_counts_as_silent(
    ends_in_silence: bool,
) -> None:
    port = Busy([b"a", b"b", b"c"])

    def missing(reply: bytes) -> int:
        time.sleep(1.2 * PATIENCE)
        return 3 - len(reply)

    assert port.exchange(Request("", b"", 0, missing, bytes, ends_in_silence)).value == b"abc"


@pytest.fixture
def stable_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(serial_port, "STABLE_NAMES", tmp_path)
    return tmp_path


def test_11_a_numbered_path_draws_a_warning_that_names_the_stable_one(stable_names: Path) -> None:
    assert "udev rule" in numbering_warning("/dev/ttyACM3")
    (stable_names / "usb-Basicmicro_RoboClaw-if00").symlink_to("/dev/ttyACM3")
    assert f"Use {stable_names}/usb-Basicmicro_RoboClaw-if00." in numbering_warning("/dev/ttyACM3")
    warned = Driver(Settings(port="/dev/ttyACM3", gyro_port="/dev/ttyUSB0"))
    assert "/dev/ttyACM3 belongs to another device" in warned.remarks()
    assert "/dev/ttyUSB0 belongs to another device" in warned.remarks()


@pytest.mark.parametrize("path", ["/dev/serial/by-id/usb-Basicmicro_RoboClaw-if00", "/dev/cmr-motor", "/dev/ttyS0"])
def test_11_a_path_that_stays_draws_none(path: str) -> None:
    assert numbering_warning(path) == ""
