"""Roboteq controllers with two channels (SDC, HDC, MDC, FBL and their kin): lines of text.

A line is a command and a carriage return. Actions (!) and settings (^) are answered with `+` or, refused, with `-`;
queries of readings (?) and settings (~) with `NAME=value:value`. By default the device repeats whatever it receives
before it answers. There is no checksum: an answer counts only if it is, to the last character, one that the device
can give to this very question; and a duty counts only if the device, asked which is in force, reports the same. Source:
Roboteq "Advanced Digital Motor Controller User Manual", serial commands.

The watchdog is fed by actions alone. After it has stopped the motors, the next action resumes the former duties; but
`!M`, the only action used here, sets both channels. Nothing here is kept when the device is switched off (% commands).
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from itertools import chain
from operator import or_
from typing import TypeVar

from cmr.msg import motor_feedback_t
from robot_driver.controllers.controller import BadReply, Controller, Request, Telemetry
from robot_driver.gate.wire_roboteq import DONE, END, FULL_DUTY

T = TypeVar("T")

REFUSED = b"-\r"
LONGEST_IDENTITY = 80  # bytes; real ones have some 40
LONGEST_VALUE = 11  # characters: -2147483648
LONGEST_WATCHDOG = 65000  # ms
COUNTS = range(-(2**31), 2**31)
DUTIES = range(-FULL_DUTY, FULL_DUTY + 1)
TENTHS_OF_VOLT = range(1501)  # no device takes more than 150 V
TENTHS_OF_AMPERE = range(-10000, 10001)
DEGREES = range(-60, 201)

_ESTOP = motor_feedback_t.STATUS_ESTOP
_TEMPERATURE = motor_feedback_t.STATUS_TEMPERATURE
_BATTERY = motor_feedback_t.STATUS_BATTERY
_MOTOR_FAULT = motor_feedback_t.STATUS_MOTOR_FAULT

Flags = tuple[tuple[int, int, str], ...]  # bits, the STATUS constant they stand for, text for the user
Found = list[tuple[int, str]]  # the last two of these, for each bit that is set

FAULT_FLAGS: Flags = (
    (0x01, _TEMPERATURE, "the controller is overheated"),
    (0x02, _BATTERY, "the battery voltage is too high"),
    (0x04, _BATTERY, "the battery voltage is too low"),
    (0x08, _MOTOR_FAULT, "a motor output is short-circuited"),
    (0x10, _ESTOP, "the emergency stop of the controller is engaged"),
    (0x20, _MOTOR_FAULT, "a sensor of a motor has failed"),
    (0x40, _MOTOR_FAULT, "a power transistor has failed"),
    (0x80, _MOTOR_FAULT, "the controller has lost its configuration and runs on default values"),
    (0xFF00, _MOTOR_FAULT, "the controller reports a fault that its display or its manual names"),
)
# Limit switches (0x10, 0x20) are not faults.
MOTOR_FLAGS: Flags = (
    (0x01, _MOTOR_FAULT, "takes as much current as it may"),
    (0x02, _MOTOR_FAULT, "is stalled"),
    (0x04, _MOTOR_FAULT, "does not follow its speed"),
    (0x08, _ESTOP, "is held by the safety stop"),
    (0x40, _MOTOR_FAULT, "has taken too much current"),
)
# Settings that must be 0, else `!M` would not set the duty of each channel; and the meaning of 0. A device that has no
# such setting refuses the query.
MODES = {
    "MMOD 1": "open loop",
    "MMOD 2": "open loop",
    "MXMD": "separate channels",
    "CLIN 1": "linear commands",
    "CLIN 2": "linear commands",
}
LONGEST_MODE = 12  # bytes of an answer
_WHOLE_NUMBER = re.compile(rb"0|-?[1-9][0-9]{0,9}")


class Roboteq(Controller):
    """One Roboteq with two channels in open loop; it refuses a device that was restarted meanwhile.

    A restart restores the settings in the flash, perhaps without a watchdog, and usually the echo, which was switched
    off. From then on this object sends zeros and accepts no answer, so that the driver connects and arms again.
    """

    default_baud_rate = 115200
    link = "text commands on its serial port (RS232 or USB)"
    essential = frozenset({"status"})

    def __init__(self) -> None:
        self._echo_is_off = False
        self._restarted = False
        self._found: dict[str, Found] = {}  # by query

    def identify(self) -> Request[str]:
        """Read the firmware's name, for example "Roboteq v1.6 RCB500 05/01/2016"."""

        def parse(answer: bytes) -> str:
            match = re.fullmatch(rb"FID=([ -~]+)\r", answer)
            if not match:
                raise BadReply(f"{answer!r} is no identity.")
            return match[1].decode("ascii").strip()

        return self._request("?FID", LONGEST_IDENTITY, parse)

    def learn(self) -> list[Request[None]]:
        """Switch the echo off, which is not kept over power-off; check that a command will be taken as a duty."""

        def echo_is_off(answer: bytes) -> None:
            _acknowledged(answer)
            self._echo_is_off = True

        return [
            self._request("^ECHOF 1", len(DONE), echo_is_off),
            *(self._request(f"~{mode}", LONGEST_MODE, _mode_parser(mode)) for mode in MODES),
        ]

    def set_watchdog(self, seconds: float) -> Request[None]:
        """Stop the motors when no action has come for 0.001 to 65 s. Not kept over power-off.

        Raises ValueError for another time.
        """
        milliseconds = round(1000 * seconds)
        if not 1 <= milliseconds <= LONGEST_WATCHDOG:
            raise ValueError(f"A watchdog of {seconds:g} s cannot be set; 0.001 to 65 s can.")
        return self._request(f"^RWD {milliseconds}", len(DONE), _acknowledged)

    def read_watchdog(self) -> Request[float]:
        """Read the time after which the motors stop (s)."""
        return self._query("~RWD", 1, range(LONGEST_WATCHDOG + 1), lambda milliseconds: milliseconds / 1000)

    def drive(self, first: float, second: float) -> Request[tuple[float, float]]:
        """Set the duty of channels 1 and 2, in steps of 0.001, and read back which are in force.

        A command line damaged in transmission may be another duty, and is acknowledged all the same. Zero is accepted:
        the line may have been lost, or the controller may hold the motors by itself, which its status reports. Raises
        ValueError for a duty outside [-1, 1].
        """
        steps = round(first * FULL_DUTY), round(second * FULL_DUTY)
        if max(map(abs, steps)) > FULL_DUTY:
            raise ValueError(f"A duty must be between -1 and 1, not {first}, {second}.")
        if self._restarted:
            steps = 0, 0
        duty = steps[0] / FULL_DUTY, steps[1] / FULL_DUTY

        def parse(answer: bytes) -> tuple[float, float]:
            _acknowledged(answer)
            return duty

        def confirm(*reported: int) -> tuple[float, float]:
            if reported not in (steps, (0, 0)):
                raise BadReply(f"The duty {steps} was sent, but the controller reports {reported}.")
            return duty if reported == steps else (0.0, 0.0)

        sent = self._request(f"!M {steps[0]} {steps[1]}", len(DONE), parse)
        return replace(sent, then=lambda _: self._query("?M", len(steps), DUTIES, confirm), confirms=True)

    def read_encoders(self) -> Request[tuple[int, int]]:
        """Read both encoder counts, which the device sends as signed numbers."""
        return self._query("?C", 2, COUNTS, lambda first, second: (first % 2**32, second % 2**32))

    def read_telemetry(self) -> list[Request[Telemetry]]:
        """Read voltages, motor currents, temperatures, faults, and flags of the motors."""
        return [
            self._query("?V", 3, range(65536), _battery),
            self._query("?A", 2, TENTHS_OF_AMPERE, _currents),
            # The controller's own, then that of each power stage: the hottest matters.
            self._query("?T", (1, 5), DEGREES, lambda *degrees: Telemetry(temperature=float(max(degrees)))),
            self._query("?FF", 1, range(65536), lambda word: self._health("?FF", _read(FAULT_FLAGS, "", word))),
            self._query("?FM", (1, 2), range(65536), self._health_of_motors),
        ]

    def _health_of_motors(self, *words: int) -> Telemetry:
        found = [_read(MOTOR_FLAGS, f"motor {number} ", word) for number, word in enumerate(words, start=1)]
        return self._health("?FM", list(chain.from_iterable(found)))

    def _health(self, query: str, found: Found) -> Telemetry:
        """Return the health reported by this query and the latest others."""
        self._found[query] = found
        everything = list(chain.from_iterable(self._found.values()))
        return Telemetry(
            status=reduce(or_, (status for status, _ in everything), 0),
            conditions=tuple(words for _, words in everything),
        )

    def _query(
        self, command: str, count: int | tuple[int, int], allowed: range, convert: Callable[..., T]
    ) -> Request[T]:
        """Return a request whose answer is `convert` of `count` (or from, to) values, each in the `allowed` range."""
        least, most = (count, count) if isinstance(count, int) else count

        def parse(answer: bytes) -> T:
            return convert(*_values(command[1:], answer, range(least, most + 1), allowed))

        return self._request(command, len(command) + most * (LONGEST_VALUE + 1), parse, least)

    def _request(
        self, command: str, longest_answer: int, parse: Callable[[bytes], T], least_values: int = 0
    ) -> Request[T]:
        """Return a request for one line, with or without echo before its answer."""
        line = command.encode("ascii")
        name, longest = line[1:] + b"=", len(line) + len(END) + longest_answer

        def missing(reply: bytes) -> int:
            answer = _without_echo(line, reply) if reply.startswith(line) else reply
            if answer.endswith(END) or len(reply) >= longest:
                return 0
            if least_values and answer.startswith(name):
                return min(_missing_of_values(answer, len(name), least_values), longest - len(reply))
            return 1 if answer else len(DONE)

        def checked(reply: bytes) -> T:
            answer = _without_echo(line, reply)
            self._restarted |= self._echo_is_off and answer != reply
            if self._restarted:
                raise BadReply("The controller was restarted: it repeats what it receives again.")
            return parse(answer)

        return Request(command, line + END, longest, missing, checked)


def _without_echo(line: bytes, reply: bytes) -> bytes:
    """Return a reply without the request in front of it; no answer begins like a request."""
    return reply[len(line) :].removeprefix(END) if reply.startswith(line) else reply


def _missing_of_values(answer: bytes, begin: int, least: int) -> int:
    """Return how many bytes are missing, at least, for at least `least` values from `begin` on: digits, colons, the
    end.
    """
    values = least - 1 - answer.count(b":", begin)
    last_is_empty = len(answer) == begin or answer.endswith((b":", b"-"))
    return (2 * values if values > 0 else 0) + last_is_empty + len(END)


def _acknowledged(answer: bytes) -> None:
    if answer != DONE:
        raise BadReply("It was refused." if answer == REFUSED else f"{answer!r} is no acknowledgement.")


def _values(name: str, answer: bytes, count: range, allowed: range) -> list[int]:
    """Return the values of an answer to the query `name`.

    Raises BadReply unless its format is exactly the device's: no other name, no leading zeros, no blanks.
    """
    prefix, end = name.encode("ascii") + b"=", answer[-len(END) :]
    texts = answer[len(prefix) : -len(END)].split(b":")
    if not answer.startswith(prefix) or end != END or len(texts) not in count:
        raise BadReply(f"{answer!r} is no answer to the query {name}.")
    if not all(map(_WHOLE_NUMBER.fullmatch, texts)):
        raise BadReply(f"{answer!r} does not consist of whole numbers.")
    values = [int(text) for text in texts]
    if not all(value in allowed for value in values):
        raise BadReply(f"{answer!r} is out of range.")
    return values


def _mode_parser(mode: str) -> Callable[[bytes], None]:
    """Return a parser that refuses a device in a wrong mode."""

    def parse(answer: bytes) -> None:
        if answer != REFUSED and any(_values(mode.split()[0], answer, range(1, 3), range(100))):
            raise BadReply(f"Set the controller to {MODES[mode]} ({mode} 0) with the maker's program.")

    return parse


def _battery(_driver_stage: int, main: int, _logic: int) -> Telemetry:
    """Return the second of three voltages (0.1 V, 0.1 V, mV)."""
    if main not in TENTHS_OF_VOLT:
        raise BadReply(f"A battery of {main / 10} V is out of range.")
    return Telemetry(battery_voltage=main / 10)


def _currents(first: int, second: int) -> Telemetry:
    """Convert currents from steps of 0.1 A."""
    return Telemetry(currents=(first / 10, second / 10))


def _read(flags: Flags, subject: str, word: int) -> Found:
    """Return the conditions for the bits of `word`."""
    return [(status, subject + words) for bits, status, words in flags if word & bits]
