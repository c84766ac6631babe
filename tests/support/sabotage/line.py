"""Drivers that break promises about the line to the device: 1 to 7, and the ports, 10 to 12."""

import os
import time
from dataclasses import replace
from typing import Any

import serial

from robot_driver import asking, host, motors, port_thread, serial_port
from robot_driver.controllers import BadReply
from tests.support.sabotage.replacing import replace_with, wrap

# 1: pieces


def impatient() -> None:
    replace_with(serial_port, "REPLY_MARGIN", 0.003)


def waits_once_for_all_pieces() -> None:
    def read(original: Any, port: Any, most: int, timeout: float) -> bytes:
        if most == 4096:
            return bytes(original(port, most, timeout))
        port.give_up = getattr(port, "give_up", None) or time.monotonic() + timeout
        return bytes(original(port, most, min(timeout, port.give_up - time.monotonic())))

    def write(original: Any, port: Any, data: bytes) -> None:
        port.give_up = None
        original(port, data)

    wrap(serial_port.SerialPort, "read", read)
    wrap(serial_port.SerialPort, "write", write)


def takes_the_first_piece_for_all() -> None:
    from robot_driver.controllers.roboclaw import RoboClaw

    def read_encoders(original: Any, controller: Any) -> Any:
        def parse(reply: bytes) -> tuple[int, int]:
            whole = reply + bytes(10 - len(reply))
            return int.from_bytes(whole[:4], "big"), int.from_bytes(whole[4:8], "big")

        return replace(original(controller), missing=lambda reply: 0 if reply else 10, parse=parse)

    wrap(RoboClaw, "read_encoders", read_encoders)


# 2: rhythm


def sulks_after_a_loss() -> None:
    def recover(original: Any, asker: Any) -> None:
        original(asker)
        time.sleep(0.1)

    wrap(asking.Asking, "recover", recover)


def listens_long_after_a_loss() -> None:
    replace_with(serial_port, "PACKET_GAP", 0.08)


def connects_again_after_a_loss() -> None:
    def serve(original: Any, self: Any, connection: Any) -> None:
        try:
            original(self, connection)
        except BadReply as bad:
            raise serial_port.PortLost(str(bad)) from bad

    wrap(motors.Motors, "_serve", serve)


# 3: damage


def checks_no_crc() -> None:
    from robot_driver.controllers import roboclaw

    replace_with(roboclaw, "_checked", lambda _header, reply: reply[:-2])


def takes_late_replies() -> None:
    replace_with(serial_port.SerialPort, "discard_strays", lambda _port: None)
    replace_with(serial_port.SerialPort, "resynchronise", lambda _port: None)


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

    wrap(asking.Asking, "ask", ask)


# 4: deadline


def knows_no_wire() -> None:
    replace_with(serial_port.SerialPort, "wire_time", lambda _port, _count: 0.0)


def thinks_all_lines_are_fast() -> None:
    replace_with(serial_port.SerialPort, "wire_time", lambda _port, count: count / 11520)


def waits_as_for_a_slow_line() -> None:
    replace_with(serial_port, "REPLY_MARGIN", 0.2)


# 5: silence


def ends_when_a_device_is_silent() -> None:
    def silence(_original: Any, _asker: Any) -> str:
        os._exit(1)

    wrap(asking.Asking, "silence", silence)


def forgets_counts_in_a_silence() -> None:
    replace_with(motors.Motors, "_count_on", lambda self, _controller, _stop: self._encoders.rebase())


def stays_away_after_a_silence() -> None:
    def leave(original: Any, self: Any) -> None:
        original(self)
        self.rest = 60.0

    wrap(motors.Motors, "leave", leave)


# 6: death


def talks_to_the_deaf() -> None:
    def leave(original: Any, self: Any) -> None:
        original(self)
        self.rest = 0.0

    wrap(motors.Motors, "leave", leave)


# 7: watchdog


def arms_blindly() -> None:
    def arm(_original: Any, self: Any, controller: Any, stop: Any) -> str:
        self._encoders.rebase()
        self._asking.insist(controller.set_watchdog(controller.watchdog_seconds), stop)
        return ""

    wrap(motors.Motors, "_arm", arm)


def never_looks_at_the_watchdog_again() -> None:
    replace_with(motors.Motors, "_check_watchdog", lambda _self, _connection: None)


# 10: unplugging


def reports_late() -> None:
    def problem(original: Any, thread: Any) -> str:
        said = str(original(thread))
        thread.since = getattr(thread, "since", None) or time.monotonic() if said else None
        return said if said and time.monotonic() > thread.since + 1.2 else ""

    original = vars(port_thread.PortThread)["problem"].fget
    replace_with(port_thread.PortThread, "problem", property(lambda thread: problem(original, thread)))


def tries_rarely() -> None:
    replace_with(port_thread, "FIRST_PAUSE", 4.0)
    replace_with(port_thread, "LONGEST_PAUSE", 8.0)


def reports_nothing() -> None:
    replace_with(port_thread.PortThread, "problem", property(lambda _thread: ""))


# 11: names


def warns_of_nothing() -> None:
    from robot_driver import driver

    replace_with(driver, "numbering_warning", lambda _path: "")


def warns_on_the_terminal_alone() -> None:
    from robot_driver import driver

    def remarks(original: Any, self: Any) -> str:
        return str(original(self)).replace(self.warnings, "")

    wrap(driver.Driver, "remarks", remarks)


def warns_of_everything() -> None:
    from robot_driver import driver

    replace_with(driver, "numbering_warning", lambda path: f"{path} belongs to another device tomorrow.")


# 12: two drivers


def locks_nothing() -> None:
    def opened(original: Any, *arguments: Any, **named: Any) -> Any:
        return original(*arguments, **{**named, "exclusive": None})

    wrap(serial, "Serial", opened)


def gives_its_lock_up() -> None:
    import fcntl

    def opened(original: Any, terminal: Any, *arguments: Any, **named: Any) -> None:
        original(terminal, *arguments, **named)
        fcntl.flock(terminal.fileno(), fcntl.LOCK_UN)

    wrap(host.Terminal, "__init__", opened)


def waits_for_the_port() -> None:
    def enter(original: Any, thread: Any) -> Any:
        try:
            return original(thread)
        except serial_port.PortLost:
            thread._thread.start()
            return thread

    wrap(port_thread.PortThread, "__enter__", enter)


WAYS = {
    1: (impatient, waits_once_for_all_pieces, takes_the_first_piece_for_all),
    2: (sulks_after_a_loss, listens_long_after_a_loss, connects_again_after_a_loss),
    3: (checks_no_crc, takes_late_replies, believes_its_own_duties),
    4: (knows_no_wire, thinks_all_lines_are_fast, waits_as_for_a_slow_line),
    5: (ends_when_a_device_is_silent, forgets_counts_in_a_silence, stays_away_after_a_silence),
    6: (talks_to_the_deaf,),
    7: (arms_blindly, never_looks_at_the_watchdog_again),
    10: (reports_late, tries_rarely, reports_nothing),
    11: (warns_of_nothing, warns_on_the_terminal_alone, warns_of_everything),
    12: (locks_nothing, gives_its_lock_up, waits_for_the_port),
}
