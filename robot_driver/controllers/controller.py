"""The interface of a request-response motor controller."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypedDict, TypeVar

from cmr.msg import motor_feedback_t
from robot_driver.gyros.gyro import Gyro

T = TypeVar("T")
COUNTER_RANGE = 2**32  # encoder counters wrap at this value, both ways


class BadReply(Exception):  # noqa: N818 - noise on a line is an everyday event, not a failure of the program
    """A reply is damaged, or does not belong to the request; its contents must not be used."""


class Telemetry(TypedDict, total=False):
    """Measurements other than encoders; keys without a sensor are absent."""

    battery_voltage: float  # V
    currents: tuple[float, float]  # A, first and second channel
    temperature: float  # deg C
    status: int  # sum of the STATUS constants of motor_feedback_t that the controller reports
    conditions: tuple[str, ...]  # problems reported by the controller, in words; otherwise ()


WORDS = {
    motor_feedback_t.STATUS_ESTOP: "its emergency stop is engaged",
    motor_feedback_t.STATUS_TEMPERATURE: "it is too hot, or will be soon",
    motor_feedback_t.STATUS_BATTERY: "the battery voltage is too high or too low, or will be soon",
    motor_feedback_t.STATUS_MOTOR_FAULT: "a motor takes too much current, or its output has failed",
}


def conditions_of(telemetry: Telemetry) -> tuple[str, ...]:
    """Return the problems reported by the controller: in its own words, otherwise from its status bits."""
    status = telemetry.get("status", 0)
    return telemetry.get("conditions", ()) or tuple(words for bit, words in WORDS.items() if status & bit)


@dataclass(frozen=True)
class Request(Generic[T]):
    """One exchange with a controller: the bytes to write, the end of the reply, and its parser.

    `data` is written at once. `longest_reply` (bytes) determines the deadline. `missing` returns the least number of
    bytes still to come (0: the reply is complete). `parse` returns the contents of a reply, or raises BadReply.
    `ends_in_silence`: a reply shorter than `longest_reply` may be complete; only silence shows. `measured` returns,
    after `parse`, when the device took the reading (monotonic ns), if its clock is known. `then` makes a further
    request from the reply, to be sent at once; its answer is the answer to both; if it only `confirms`, the request had
    been carried out before this reply. `otherwise` is sent if there is no good reply, which still counts as a failure:
    another device on the line must receive it, whatever the answer. Nothing is sent after `not_after` (s since boot),
    when it would be out of date.
    """

    name: str
    data: bytes
    longest_reply: int
    missing: Callable[[bytes], int]
    parse: Callable[[bytes], T]
    ends_in_silence: bool = False
    measured: Callable[[], int] | None = None
    then: "Callable[[T], Request[T]] | None" = None
    confirms: bool = False
    otherwise: "Request[T] | None" = None
    not_after: float = math.inf


class Controller(ABC):
    """The protocol of a controller with two motor channels; it does no I/O.

    Each connection has a new object, so it may store what it learned about the device. The two channels have the
    controller's own order and sign; the driver maps them to sides. `link` is the required setting of the device, for
    messages. `watchdog_seconds` is the silence after which the device must stop the motors by itself. `essential` are
    keys of Telemetry that every such device reports, and that are required for driving. `streams`: the device sends
    continuously. `gyro` is the gyro on the same board; it receives all incoming bytes. `other_baud_rates` are tried if
    the device does not answer at the default one. `monotonic_ns` is the driver's clock, which some devices receive.
    `objection` is a sentence on why the device must not be driven, as soon as its messages show that; otherwise "".
    """

    default_baud_rate: int
    other_baud_rates: tuple[int, ...] = ()
    link = "serial commands"
    watchdog_seconds = 0.5
    essential: frozenset[str] = frozenset()
    streams = False
    gyro: type[Gyro] | None = None
    objection = ""
    monotonic_ns: Callable[[], int] = staticmethod(time.monotonic_ns)

    @abstractmethod
    def identify(self) -> Request[str]:
        """Request the name and version of the device."""

    @abstractmethod
    def learn(self) -> list[Request[None]]:
        """Return the requests to make once after connecting, from which this object learns dialects."""

    @abstractmethod
    def set_watchdog(self, seconds: float) -> Request[None]:
        """Set the time of silence after which the device stops the motors by itself."""

    @abstractmethod
    def read_watchdog(self) -> Request[float]:
        """Read the time set with `set_watchdog` (s)."""

    @abstractmethod
    def drive(self, first: float, second: float) -> Request[tuple[float, float]]:
        """Set the duty of both channels (-1 to 1); the answer is the duty sent, with the wire's rounding."""

    def stops(self) -> list[Request[tuple[float, float]]]:
        """Return the requests that stop all motors; each is sent independently of the others."""
        return [self.drive(0.0, 0.0)]

    @abstractmethod
    def read_encoders(self) -> Request[tuple[int, int]]:
        """Read both encoder counts (ticks, modulo 2^32, 0 to 2^32 - 1)."""

    @abstractmethod
    def read_telemetry(self) -> list[Request[Telemetry]]:
        """Return the requests for everything else, to be sent one per cycle."""


def signed_step(before: int, after: int) -> int:
    """Return the difference of two raw counts, modulo 2^32, in the shorter direction (ticks)."""
    return (after - before + COUNTER_RANGE // 2) % COUNTER_RANGE - COUNTER_RANGE // 2
