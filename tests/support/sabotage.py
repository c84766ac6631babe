"""Drivers, gates and devices that break a promise on purpose, each in one way; for tests of the acceptance protocol."""

import os
import re
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import serial

from cmr.model import duty_ramp
from robot_driver import asking, command_gate, gate, host, motors, port_thread, rhythm, serial_port
from robot_driver.controllers import BadReply
from tests.support.accepted_robot import NUMBERED
from tests.support.project import PROJECT


def start(broken: str) -> int:
    """Start cmr-driver, broken in this way, if in any."""
    from cmr.commands import driver

    serial_port.NUMBERED = re.compile(NUMBERED)
    if broken in DRIVERS:
        DRIVERS[broken]()
    return driver()


def _set(owner: Any, name: str, value: object) -> None:
    setattr(owner, name, value)


def _wrap(owner: Any, name: str, around: Callable[..., Any]) -> None:
    """Have `around(original, *arguments)` be called in place of a function."""
    original = getattr(owner, name)
    setattr(owner, name, lambda *arguments, **named: around(original, *arguments, **named))


def _gate(way: str) -> None:
    os.environ["CMR_BROKEN_GATE"], os.environ["CMR_BROKEN_GATE_PATH"] = way, str(PROJECT)
    gate.__file__ = str(Path(__file__).with_name("broken_gate") / "__init__.py")


# 1: pieces


def impatient() -> None:
    _set(serial_port, "REPLY_MARGIN", 0.003)


def waits_once_for_all_pieces() -> None:
    def read(original: Any, port: Any, most: int, timeout: float) -> bytes:
        if most == 4096:
            return bytes(original(port, most, timeout))
        port.give_up = getattr(port, "give_up", None) or time.monotonic() + timeout
        return bytes(original(port, most, min(timeout, port.give_up - time.monotonic())))

    def write(original: Any, port: Any, data: bytes) -> None:
        port.give_up = None
        original(port, data)

    _wrap(serial_port.SerialPort, "read", read)
    _wrap(serial_port.SerialPort, "write", write)


def takes_the_first_piece_for_all() -> None:
    from robot_driver.controllers.roboclaw import RoboClaw

    def read_encoders(original: Any, controller: Any) -> Any:
        def parse(reply: bytes) -> tuple[int, int]:
            whole = reply + bytes(10 - len(reply))
            return int.from_bytes(whole[:4], "big"), int.from_bytes(whole[4:8], "big")

        return replace(original(controller), missing=lambda reply: 0 if reply else 10, parse=parse)

    _wrap(RoboClaw, "read_encoders", read_encoders)


# 2: rhythm


def sulks_after_a_loss() -> None:
    def recover(original: Any, asker: Any) -> None:
        original(asker)
        time.sleep(0.1)

    _wrap(asking.Asking, "recover", recover)


def listens_long_after_a_loss() -> None:
    _set(serial_port, "PACKET_GAP", 0.08)


def connects_again_after_a_loss() -> None:
    def serve(original: Any, self: Any, connection: Any) -> None:
        try:
            original(self, connection)
        except BadReply as bad:
            raise serial_port.PortLost(str(bad)) from bad

    _wrap(motors.Motors, "_serve", serve)


# 3: damage


def checks_no_crc() -> None:
    from robot_driver.controllers import roboclaw

    _set(roboclaw, "_checked", lambda _header, reply: reply[:-2])


def takes_late_replies() -> None:
    _set(serial_port.SerialPort, "discard_strays", lambda _port: None)
    _set(serial_port.SerialPort, "resynchronise", lambda _port: None)


def believes_its_own_duties() -> None:
    def ask(original: Any, asker: Any, request: Any) -> Any:
        try:
            return original(asker, request)
        except BadReply:
            if request.data[1:2] != b"\x22":
                raise
            now = time.monotonic_ns()
            duties = [int.from_bytes(request.data[i : i + 2], "big", signed=True) / 32767 for i in (2, 4)]
            return serial_port.Answer(tuple(duties), now, now)

    _wrap(asking.Asking, "ask", ask)


# 4: deadline


def knows_no_wire() -> None:
    _set(serial_port.SerialPort, "wire_time", lambda _port, _count: 0.0)


def thinks_all_lines_are_fast() -> None:
    _set(serial_port.SerialPort, "wire_time", lambda _port, count: count / 11520)


def waits_as_for_a_slow_line() -> None:
    _set(serial_port, "REPLY_MARGIN", 0.2)


# 5: silence


def ends_when_a_device_is_silent() -> None:
    def silence(_original: Any, _asker: Any) -> str:
        os._exit(1)

    _wrap(asking.Asking, "silence", silence)


def forgets_counts_in_a_silence() -> None:
    _set(motors.Motors, "_count_on", lambda self, _controller, _stop: self._encoders.rebase())


def stays_away_after_a_silence() -> None:
    def leave(original: Any, self: Any) -> None:
        original(self)
        self.rest = 60.0

    _wrap(motors.Motors, "leave", leave)


# 6: death


def talks_to_the_deaf() -> None:
    def leave(original: Any, self: Any) -> None:
        original(self)
        self.rest = 0.0

    _wrap(motors.Motors, "leave", leave)


# 7: watchdog


def arms_blindly() -> None:
    def arm(_original: Any, self: Any, controller: Any, stop: Any) -> str:
        self._encoders.rebase()
        self._asking.insist(controller.set_watchdog(controller.watchdog_seconds), stop)
        return ""

    _wrap(motors.Motors, "_arm", arm)


def never_looks_at_the_watchdog_again() -> None:
    _set(motors.Motors, "_check_watchdog", lambda _self, _connection: None)


# 8: stale commands


def obeys_for_long() -> None:

    _set(command_gate, "COMMAND_LIFETIME", 2.0)
    _gate("lets commands live")


def jumps() -> None:
    _set(duty_ramp.Ramp, "towards", lambda _ramp, left, right, _now: (left, right))


def obeys_old_commands() -> None:
    def offer(original: Any, self: Any, _decided: int, *duties: float, now: float, utime: int) -> bool:
        return bool(original(self, utime, *duties, now=now, utime=utime))

    _wrap(command_gate.CommandGate, "offer", offer)


# 9: signals


def leaves_the_motors_on() -> None:
    _set(motors.Motors, "leave", lambda self: setattr(self, "_connection", None))
    _gate("stops nothing at its end")


def ignores_signals() -> None:
    from cmr.bus.process import Process

    _set(Process, "_note_signal", lambda *_: None)


def asks_once_for_zero() -> None:
    def leave(_original: Any, self: Any) -> None:
        if self._connection is not None:
            with suppress(BadReply):
                self._port.exchange(self._connection.controller.drive(0.0, 0.0))
        self._connection = None

    _wrap(motors.Motors, "leave", leave)
    _gate("stops nothing at its end")


# 10: unplugging


def reports_late() -> None:
    def problem(original: Any, thread: Any) -> str:
        said = str(original(thread))
        thread.since = getattr(thread, "since", None) or time.monotonic() if said else None
        return said if said and time.monotonic() > thread.since + 1.2 else ""

    original = vars(port_thread.PortThread)["problem"].fget
    _set(port_thread.PortThread, "problem", property(lambda thread: problem(original, thread)))


def tries_rarely() -> None:
    _set(port_thread, "FIRST_PAUSE", 4.0)
    _set(port_thread, "LONGEST_PAUSE", 8.0)


def reports_nothing() -> None:
    _set(port_thread.PortThread, "problem", property(lambda _thread: ""))


# 11: names


def warns_of_nothing() -> None:
    from robot_driver import driver

    _set(driver, "numbering_warning", lambda _path: "")


def warns_on_the_terminal_alone() -> None:
    from robot_driver import driver

    def remarks(original: Any, self: Any) -> str:
        return str(original(self)).replace(self.warnings, "")

    _wrap(driver.Driver, "remarks", remarks)


def warns_of_everything() -> None:
    from robot_driver import driver

    _set(driver, "numbering_warning", lambda path: f"{path} belongs to another device tomorrow.")


# 12: two drivers


def locks_nothing() -> None:
    def opened(original: Any, *arguments: Any, **named: Any) -> Any:
        return original(*arguments, **{**named, "exclusive": None})

    _wrap(serial, "Serial", opened)


def gives_its_lock_up() -> None:
    import fcntl

    def opened(original: Any, terminal: Any, *arguments: Any, **named: Any) -> None:
        original(terminal, *arguments, **named)
        fcntl.flock(terminal.fileno(), fcntl.LOCK_UN)

    _wrap(host.Terminal, "__init__", opened)


def waits_for_the_port() -> None:
    def enter(original: Any, thread: Any) -> Any:
        try:
            return original(thread)
        except serial_port.PortLost:
            thread._thread.start()
            return thread

    _wrap(port_thread.PortThread, "__enter__", enter)


# 13: counts


def knows_no_wrap() -> None:
    from robot_driver import encoders

    _set(encoders, "signed_step", lambda before, after: after - before)


def counts_jumps() -> None:
    from robot_driver import encoders

    def update(original: Any, self: Any, counts: Any, moment: int, _fastest: float) -> Any:
        return original(self, counts, moment, 1e12)

    _set(encoders, "FASTEST_WHEEL", 1e12)
    _wrap(encoders.WheelEncoders, "update", update)


def takes_a_reset_for_a_jump() -> None:
    from robot_driver import encoders

    def update(original: Any, self: Any, *arguments: Any) -> Any:
        try:
            return original(self, *arguments)
        except encoders.CountersReset:
            self.jumps += 1
            return None

    _wrap(encoders.WheelEncoders, "update", update)


# 14: stamps


def goes_back_in_time() -> None:
    from robot_driver import clock, feedback, gyro_device

    class Backwards(clock.Stamps):
        count = 0

        def next(self, moment: int) -> int:
            self.count += 1
            return super().next(moment) - (50_000 if self.count % 20 == 0 else 0)

    _set(feedback, "Stamps", Backwards)
    _set(gyro_device, "Stamps", Backwards)


def stamps_on_arrival() -> None:
    from robot_driver.gyro_device import GyroDevice

    def measured(original: Any, self: Any, readings: Any, arrived: int) -> list[int]:
        original(self, readings, arrived)
        return [arrived] * len(readings)

    _wrap(GyroDevice, "_measured", measured)


def stamps_late() -> None:
    from robot_driver.gyro_device import GyroDevice

    def measured(original: Any, self: Any, readings: Any, arrived: int) -> list[int]:
        return [moment + 30_000_000 for moment in original(self, readings, arrived)]

    _wrap(GyroDevice, "_measured", measured)


# 15: rates


def takes_all_readings_for_valid() -> None:
    from robot_driver.gyros import dsp3000

    def reading(original: Any, line: bytes, *arguments: int) -> Any:
        return original(re.sub(rb"0(\r?\n)$", rb"1\1", line), *arguments)

    _wrap(dsp3000, "_reading", reading)


def mends_damaged_lines() -> None:
    from robot_driver.gyros.dsp3000 import Dsp3000

    def feed(original: Any, self: Any, data: bytes) -> Any:
        return original(self, bytes(byte for byte in data if byte < 128))

    _wrap(Dsp3000, "feed", feed)


def repeats_the_last_rate() -> None:
    from robot_driver.gyro_device import GyroDevice
    from robot_driver.gyros import GyroReading

    def turn(original: Any, self: Any, stop: Any) -> None:
        count = self._count
        original(self, stop)
        if self._count == count and count:
            now = time.monotonic_ns()
            self._publish(self._message(GyroReading(0.0123, True), now, now))

    _wrap(GyroDevice, "turn", turn)


# 16: battery


def warns_of_no_battery() -> None:
    from robot_driver.battery import BatteryGuard

    def take(original: Any, self: Any, *arguments: float) -> None:
        original(self, *arguments)
        self.low = False

    _wrap(BatteryGuard, "take", take)


def forgives_a_battery() -> None:
    from robot_driver.battery import BatteryGuard
    from robot_driver.command_gate import Stop
    from robot_driver.health import Health

    def take(original: Any, self: Any, voltage: float, now: float) -> None:
        original(self, voltage, now)
        self.empty = self.empty and voltage < self._thresholds.stop

    def decide(original: Any, self: Any, stop: Any, *, hold: bool, release: bool) -> None:
        original(self, stop, hold=hold, release=not hold if stop is Stop.BATTERY else release)

    _wrap(BatteryGuard, "take", take)
    _wrap(Health, "_decide", decide)


def trusts_an_unknown_battery() -> None:
    from robot_driver.health import Health

    def missing(original: Any, self: Any, now: float) -> set[str]:
        return set(original(self, now)) - {"battery_voltage"}

    _wrap(Health, "missing", missing)


# 17: status


def states_nothing() -> None:
    _set(rhythm.Rhythm, "sentence", lambda _rhythm: "")


def states_what_was_asked_for() -> None:
    def sentence(original: Any, measured: Any) -> str:
        return re.sub(r"at [\d.]+ Hz", "at 100.0 Hz", original(measured))

    _wrap(rhythm.Rhythm, "sentence", sentence)


def states_a_fast_device() -> None:
    def sentence(original: Any, measured: Any) -> str:
        return re.sub(r"answers in .*", "answers in 1.0 ms (99 % within 1.2 ms).", original(measured))

    _wrap(rhythm.Rhythm, "sentence", sentence)


# 18: emergency stop


def goes_on_after_a_release() -> None:
    def hold(original: Any, self: Any, stop: Any) -> None:
        original(self, stop)
        self._zero_first = False

    def offer(original: Any, self: Any, *arguments: Any, **named: Any) -> bool:
        self._zero_first = False
        return bool(original(self, *arguments, **named))

    _wrap(command_gate.CommandGate, "hold", hold)
    _wrap(command_gate.CommandGate, "offer", offer)


def obeys_before_it_listens() -> None:
    from robot_driver import bus_stop

    _set(command_gate, "LISTENING_TIME", 0.0)
    begun = time.monotonic()

    def handle(original: Any, self: Any, *arguments: Any, **named: Any) -> None:
        if time.monotonic() > begun + 2.5:
            original(self, *arguments, **named)

    _wrap(bus_stop.BusStop, "handle", handle)


def takes_old_releases() -> None:
    def take(original: Any, self: Any, engaged: bool, decided: int, *, utime: int) -> bool:
        return bool(original(self, engaged, decided if engaged else utime, utime=utime))

    _wrap(command_gate.CommandGate, "take_estop", take)


# 19: the stop that lasts


def keeps_no_stop() -> None:
    from robot_driver import stop_file

    _set(stop_file.StopKeeper, "keep", lambda _self, _stop: None)


def takes_releases_without_a_name() -> None:
    from robot_driver import bus_stop

    _set(bus_stop.BusStop, "_objection", lambda _self, _release: "")


def reads_no_stop() -> None:
    from robot_driver import stop_file

    def path(original: Any, *arguments: Any, **named: Any) -> None:
        original(*arguments, **named)
        arguments[0].path.unlink(missing_ok=True)

    _wrap(stop_file.StopFile, "__init__", path)


# devices


def ignores_silence(device: Any, _gyro: Any) -> None:
    device._motor_deadline = lambda: float("inf")


def keeps_no_watchdog(device: Any, _gyro: Any) -> None:
    board = type(device.board)
    device.board.__class__ = type("Board", (board,), {"timeout": property(lambda _: 0.0, lambda _, __: None)})


DEVICES: dict[str, Callable[[Any, Any], None]] = {
    "6 ignores silence": ignores_silence,
    "7 keeps none": keeps_no_watchdog,
}
DRIVERS: dict[str, Callable[[], None]] = {
    f"{promise} {way.__name__.replace('_', ' ')}": way
    for promise, ways in {
        1: (impatient, waits_once_for_all_pieces, takes_the_first_piece_for_all),
        2: (sulks_after_a_loss, listens_long_after_a_loss, connects_again_after_a_loss),
        3: (checks_no_crc, takes_late_replies, believes_its_own_duties),
        4: (knows_no_wire, thinks_all_lines_are_fast, waits_as_for_a_slow_line),
        5: (ends_when_a_device_is_silent, forgets_counts_in_a_silence, stays_away_after_a_silence),
        6: (talks_to_the_deaf,),
        7: (arms_blindly, never_looks_at_the_watchdog_again),
        8: (obeys_for_long, jumps, obeys_old_commands),
        9: (leaves_the_motors_on, ignores_signals, asks_once_for_zero),
        10: (reports_late, tries_rarely, reports_nothing),
        11: (warns_of_nothing, warns_on_the_terminal_alone, warns_of_everything),
        12: (locks_nothing, gives_its_lock_up, waits_for_the_port),
        13: (knows_no_wrap, counts_jumps, takes_a_reset_for_a_jump),
        14: (goes_back_in_time, stamps_on_arrival, stamps_late),
        15: (takes_all_readings_for_valid, mends_damaged_lines, repeats_the_last_rate),
        16: (warns_of_no_battery, forgives_a_battery, trusts_an_unknown_battery),
        17: (states_nothing, states_what_was_asked_for, states_a_fast_device),
        18: (goes_on_after_a_release, obeys_before_it_listens, takes_old_releases),
        19: (keeps_no_stop, takes_releases_without_a_name, reads_no_stop),
    }.items()
    for way in ways
}
DRIVERS["6 its gate stops nothing when it dies"] = lambda: _gate("stops nothing at its end")
DRIVERS["6 its gate never stops anything"] = lambda: _gate("never stops anything")
ALL = (*DRIVERS, *DEVICES)


def promise_of(way: str) -> int:
    """Return the promise that is broken."""
    return int(way.split()[0])
