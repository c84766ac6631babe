"""The port's thread keeps its promises on a real pseudo-terminal, against a tiny device written here."""

import math
import os
import select
import struct
import threading
import time
import tty
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import now_utime
from cmr.model.duty_ramp import Limits
from cmr.msg import motor_feedback_t
from cmr.priority import go_first
from robot_driver.battery import Thresholds
from robot_driver.clock import seconds_since_boot
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.encoders import Wiring
from robot_driver.motors import Motors
from robot_driver.port_thread import PortThread
from robot_driver.serial_port import PortLost, SerialPort
from tests.support.driver_bench import open_gate
from tests.support.exchanges import Exchanges

pytestmark = pytest.mark.real_time

NOT_ARMED, STALE = motor_feedback_t.STATUS_NOT_ARMED, motor_feedback_t.STATUS_COMMAND_STALE
ACKNOWLEDGED = b"\xff"
LENGTHS = {14: 5, 15: 2, 21: 2, 24: 2, 34: 8, 49: 2, 78: 2, 82: 2, 90: 2}  # of requests, in bytes


class TinyRoboClaw:
    """Answers what the driver asks; `tamper(command, reply)` may change, shorten or drop (b"") a reply."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.duties: list[tuple[int, int]] = []
        self.counts = [0, 0]
        self.step = [0, 0]
        self.watchdog_reads: int | None = None
        self.piece, self.pause = 1000, 0.0
        self.tamper: Callable[[int, bytes], bytes] = lambda _command, reply: reply
        self._watchdog = 0
        self._plug_in()

    def _plug_in(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(self.slave))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(self.master, self._stop), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        self._stop.set()
        self._thread.join()
        self.link.unlink(missing_ok=True)
        os.close(self.master)
        os.close(self.slave)

    def plug_in_again(self) -> None:
        self._watchdog = 0
        self._plug_in()

    def _serve(self, master: int, stop: threading.Event) -> None:
        go_first()
        waiting = b""
        while not stop.is_set():
            if not select.select([master], [], [], 0.02)[0]:
                waiting = b""  # as the real device: a pause within a packet drops it
                continue
            with suppress(OSError):
                waiting += os.read(master, 1000)
            while len(waiting) >= 2 and len(waiting) >= LENGTHS[waiting[1]]:
                packet, waiting = waiting[: LENGTHS[waiting[1]]], waiting[LENGTHS[waiting[1]] :]
                reply = self.tamper(packet[1], self._reply(packet))
                for start in range(0, len(reply), self.piece):
                    os.write(master, reply[start : start + self.piece])
                    time.sleep(self.pause)

    def _reply(self, packet: bytes) -> bytes:
        command = packet[1]
        if command in (14, 34) and crc_hqx(packet, 0) != 0:
            return b""
        if command == 14:
            self._watchdog = packet[2]
            return ACKNOWLEDGED
        if command == 34:
            self.duties.append(struct.unpack(">hh", packet[2:6]))
            return ACKNOWLEDGED
        if command == 78:
            self.counts = [(count + step) % 2**32 for count, step in zip(self.counts, self.step, strict=True)]
        watchdog = self._watchdog if self.watchdog_reads is None else self.watchdog_reads
        data = {
            15: bytes((watchdog,)),
            21: b"Tiny v1\n\0",
            24: struct.pack(">H", 245),
            49: struct.pack(">hh", 150, 250),
            78: struct.pack(">II", *self.counts),
            82: struct.pack(">H", 300),
            90: struct.pack(">H", 0),
        }[command]
        return data + struct.pack(">H", crc_hqx(packet[:2] + data, 0))


class Bench:
    """A tiny device, the driver's thread on it, and what that publishes."""

    def __init__(self, device: TinyRoboClaw) -> None:
        self.device = device
        self.gate = open_gate()
        self.feedback: list[Any] = []
        self.duties: list[Any] = []

    def running(self) -> AbstractContextManager[PortThread]:
        port = SerialPort(str(self.device.link), 115200)
        self.motors = Motors(
            port,
            RoboClaw,
            self.gate,
            robot_id=0,
            rate_hz=100.0,
            ticks_per_turn=2048,
            wiring=Wiring(),
            limits=Limits(),
            thresholds=Thresholds(),
            publish=self.feedback.append,
            publish_duty=self.duties.append,
        )
        return PortThread(port, self.motors)

    def command(self, left: float, right: float) -> None:
        self.gate.offer(now_utime(), left, right, now=seconds_since_boot(), utime=now_utime())

    def more_feedback(self, count: int) -> list[Any]:
        """Wait for so many new messages and return them."""
        seen = len(self.feedback)
        wait_for(lambda: len(self.feedback) >= seen + count)
        return self.feedback[seen : seen + count]


def wait_for(condition: Callable[[], object], seconds: float = 10.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    device = TinyRoboClaw(tmp_path / "motor")
    yield Bench(device)
    with suppress(OSError):
        device.unplug()


def test_it_begins_with_zero_and_ends_with_zero_acknowledged(bench: Bench) -> None:
    with bench.running():
        bench.more_feedback(2)
        bench.command(0.5, 0.5)
        wait_for(lambda: (16384, 16384) in bench.device.duties)
    assert bench.device.duties[0] == (0, 0)
    assert bench.device.duties[-1] == (0, 0)


def test_the_last_zero_is_repeated_until_it_is_acknowledged(bench: Bench) -> None:
    losses = iter([b""] * 3)
    with bench.running():
        bench.more_feedback(2)
        bench.command(0.5, 0.5)
        wait_for(lambda: (16384, 16384) in bench.device.duties)
        count = len(bench.device.duties)
        bench.device.tamper = lambda command, reply: next(losses, reply) if command == 34 else reply
        wait_for(lambda: len(bench.device.duties) > count)
    assert bench.device.duties[-1] == (0, 0)
    assert next(losses, None) is None


def test_feedback_says_what_was_applied_and_measured(bench: Bench) -> None:
    bench.device.step = [2, 2**32 - 1]
    with bench.running() as thread:
        bench.more_feedback(2)
        bench.command(0.5, -0.25)
        wait_for(lambda: bench.feedback[-1].applied_left != 0.0)
        bench.more_feedback(8)
        assert thread.problem == ""
        last, previous = bench.feedback[-1], bench.feedback[-2]
    assert (last.applied_left, last.applied_right) == (16384 / 32767, -8192 / 32767)
    assert (last.ticks_left - previous.ticks_left, last.ticks_right - previous.ticks_right) == (2, -1)
    seconds = (last.utime - previous.utime) / 1e6
    assert last.psi_left == pytest.approx(2 * 2 * math.pi / 2048 / seconds, rel=0.05)
    assert (last.battery_voltage, last.current_left, last.current_right, last.temperature) == (24.5, 1.5, 2.5, 30.0)
    assert last.status == 0
    assert last.utime <= last.received_utime


def test_replies_in_pieces_lose_nothing(bench: Bench, exchanges: Exchanges) -> None:
    bench.device.piece, bench.device.pause, bench.device.step = 1, 0.0005, [1, 1]
    with bench.running():
        messages = bench.more_feedback(30)
        exchanges.assert_only_stalls_failed()
        failures = bench.motors.faults
    steps = [after.ticks_left - before.ticks_left for before, after in pairwise(messages)]
    assert min(steps) == 1
    assert sum(steps) <= len(steps) + failures


def test_lost_damaged_and_foreign_replies_never_become_data(bench: Bench) -> None:
    replies = 0

    def tamper(_command: int, reply: bytes) -> bytes:
        nonlocal replies
        replies += 1
        if replies % 7:
            return reply
        return [b"", reply[:-1], reply + b"\xff", bytes((reply[0] ^ 4,)) + reply[1:]][replies // 7 % 4]

    bench.device.step = [3, 5]
    with bench.running() as thread:
        bench.more_feedback(5)
        bench.device.tamper = tamper
        bench.more_feedback(60)
        assert bench.motors.faults > 5
        assert thread.problem == ""
    for message in bench.feedback:
        assert message.ticks_left * 5 == message.ticks_right * 3
        assert message.ticks_left % 3 == 0
        assert message.status & ~STALE == 0


def test_an_encoder_jump_is_told_but_not_counted(bench: Bench) -> None:
    with bench.running():
        bench.more_feedback(3)
        bench.device.counts[0] = 1_000_000
        # Only one message tells it, which may be the last for a moment only.
        wait_for(lambda: any(message.status & motor_feedback_t.STATUS_ENCODER_JUMP for message in bench.feedback))
        bench.more_feedback(2)
    assert bench.feedback[-1].ticks_left == 0
    assert max(abs(message.psi_left) for message in bench.feedback) == 0.0
    assert sum(bool(message.status & motor_feedback_t.STATUS_ENCODER_JUMP) for message in bench.feedback) == 1


def test_a_stale_command_becomes_zero_without_any_other_thread(bench: Bench) -> None:
    with bench.running():
        bench.more_feedback(2)
        bench.command(0.5, 0.5)
        began = time.monotonic()
        wait_for(lambda: bench.feedback[-1].applied_left > 0.0)
        wait_for(lambda: bench.feedback[-1].applied_left == 0.0)
        assert 0.4 < time.monotonic() - began < 1.0
        assert bench.more_feedback(1)[0].status == STALE


@pytest.mark.parametrize("watchdog", [0, 50])
def test_7_it_never_drives_when_the_watchdog_does_not_read_back(bench: Bench, watchdog: int) -> None:
    bench.device.watchdog_reads = watchdog
    with bench.running() as thread:
        bench.more_feedback(2)
        bench.command(0.5, 0.5)
        messages = bench.more_feedback(20)
        assert "watchdog" in thread.problem
    assert set(bench.device.duties) == {(0, 0)}
    assert all(message.status & NOT_ARMED for message in messages)


def test_7_it_never_drives_when_the_watchdog_cannot_be_set(bench: Bench) -> None:
    bench.device.tamper = lambda command, reply: b"" if command == 14 else reply
    with bench.running() as thread:
        bench.more_feedback(2)
        bench.command(0.5, 0.5)
        assert all(message.status & NOT_ARMED for message in bench.more_feedback(10))
        assert "watchdog" in thread.problem
    assert set(bench.device.duties) == {(0, 0)}


def test_7_a_device_that_was_reset_in_mid_run_is_armed_anew_from_zero(bench: Bench) -> None:
    bench.device.counts, bench.device.step = [2**31, 2**31], [3, 4]
    with bench.running() as thread:
        bench.more_feedback(10)
        bench.command(0.5, 0.5)
        wait_for(lambda: bench.device.duties[-1][0] > 0)
        before = bench.feedback[-1].ticks_left
        assert before > 20
        bench.device.counts, bench.device._watchdog = [0, 0], 0  # as after a dip of its supply
        count = len(bench.device.duties)
        wait_for(lambda: "was reset" in thread.problem)
        wait_for(lambda: thread.problem == "")
        assert bench.device._watchdog == 5
        wait_for(lambda: len(bench.device.duties) > count + 8)
        assert set(bench.device.duties[-4:]) == {(0, 0)}
        assert bench.more_feedback(2)[-1].ticks_left >= before


def test_7_a_watchdog_that_is_lost_in_mid_run_is_noticed(bench: Bench) -> None:
    with bench.running() as thread:
        bench.more_feedback(10)
        bench.device._watchdog = 0
        wait_for(lambda: "watchdog reads 0 s" in thread.problem)
        wait_for(lambda: thread.problem == "")
        assert bench.device._watchdog == 5


def test_a_reading_that_the_firmware_does_not_know_is_given_up(bench: Bench) -> None:
    asked: list[int] = []

    def tamper(command: int, reply: bytes) -> bytes:
        asked.append(command)
        return b"" if command == 82 else reply

    bench.device.tamper = tamper
    with bench.running():
        bench.more_feedback(90)
    assert asked.count(82) == 5
    assert 82 not in asked[len(asked) // 2 :]
    assert math.isnan(bench.feedback[-1].temperature)
    assert bench.feedback[-1].battery_voltage == 24.5


def test_a_silent_device_is_waited_for_and_needs_a_new_command(bench: Bench) -> None:
    with bench.running() as thread:
        bench.more_feedback(2)
        bench.device.tamper = lambda _command, _reply: b""
        wait_for(lambda: "does not answer" in thread.problem)
        bench.command(0.5, 0.5)
        count = len(bench.device.duties)
        bench.device.tamper = lambda _command, reply: reply
        bench.more_feedback(5)
        assert thread.problem == ""
    assert set(bench.device.duties[count:]) == {(0, 0)}


def test_an_unplugged_device_is_found_again_behind_its_name_and_armed_again(bench: Bench) -> None:
    with bench.running() as thread:
        bench.more_feedback(2)
        bench.device.unplug()
        wait_for(lambda: thread.problem)
        bench.device.plug_in_again()
        bench.more_feedback(5)
        assert thread.problem == ""
        assert bench.feedback[-1].status == STALE
        bench.command(0.25, 0.25)
        wait_for(lambda: bench.feedback[-1].applied_left > 0.2)
    assert bench.device.duties[-1] == (0, 0)


def test_a_fault_of_the_program_stops_the_motors_and_is_not_hidden(bench: Bench) -> None:
    with bench.running() as thread:
        bench.more_feedback(2)
        bench.command(0.5, 0.5)
        wait_for(lambda: (16384, 16384) in bench.device.duties)
        bench.motors.fastest_wheel = None  # type: ignore[assignment]
        wait_for(lambda: thread.failure is not None)
        with pytest.raises(TypeError):
            _ = thread.problem
        wait_for(lambda: bench.device.duties[-1] == (0, 0))


def test_a_port_in_use_is_refused_with_a_sentence(bench: Bench) -> None:
    with bench.running():
        bench.more_feedback(1)
        with pytest.raises(PortLost, match="Another program is using"), bench.running():
            pass


def test_a_port_that_the_last_gate_of_a_killed_driver_still_has_is_waited_for(bench: Bench) -> None:
    before = SerialPort(str(bench.device.link), 115200)
    before.open()
    letting_go = threading.Timer(0.3, before.close)
    letting_go.start()
    with bench.running():
        bench.more_feedback(1)
    letting_go.join()


def test_a_missing_port_is_refused_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(PortLost, match="There is no serial port"):
        SerialPort(str(tmp_path / "nothing"), 115200).open()
