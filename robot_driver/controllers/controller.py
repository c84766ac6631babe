"""What the driver asks of a motor controller that answers when it is spoken to."""

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
    """A reply that is damaged, or is not the one asked for; nothing in it may be used."""


class Telemetry(TypedDict, total=False):
    """What a controller measures besides its encoders; a key is absent where the controller has no such sensor."""

    battery_voltage: float  # V
    currents: tuple[float, float]  # A, first and second channel
    temperature: float  # deg C
    status: int  # sum of the STATUS constants of motor_feedback_t that the controller reports
    conditions: tuple[str, ...]  # what is wrong by the controller's own account, in words for a person; else ()


WORDS = {
    motor_feedback_t.STATUS_ESTOP: "its emergency stop is engaged",
    motor_feedback_t.STATUS_TEMPERATURE: "it is too hot, or will be soon",
    motor_feedback_t.STATUS_BATTERY: "the battery voltage is too high or too low, or will be soon",
    motor_feedback_t.STATUS_MOTOR_FAULT: "a motor takes too much current, or its output has failed",
}


def conditions_of(telemetry: Telemetry) -> tuple[str, ...]:
    """Return what is wrong by the controller's account: in its own words, else in those of its status bits."""
    status = telemetry.get("status", 0)
    return telemetry.get("conditions", ()) or tuple(words for bit, words in WORDS.items() if status & bit)


@dataclass(frozen=True)
class Request(Generic[T]):
    """One exchange with a controller: what to write, where the reply ends, and what it says.

    `data` is written in one go. `longest_reply` (bytes) is what the deadline is computed from. `missing` returns how
    many bytes at least are still to come after those given (0: the reply is complete). `parse` turns a reply into
    what it says, or raises BadReply. `ends_in_silence`: a reply shorter than `longest_reply` may be complete; only
    silence shows. `measured` returns, once `parse` has returned, when the device took the reading (monotonic ns), where
    its own clock says so. `then` makes, from what the reply says, a further request to be made at once; what that
    is answered is the answer to both; where that only `confirms`, what was asked for was done before this reply.
    `otherwise` is made when there is no good reply, which stays a failure all the same: somebody else on the line must
    hear it, whatever it is answered. Nothing of it is sent after `not_after` (s since the computer was started): then
    it is out of date.
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

    A new object is made for each connection, so it may remember what it learned about the device. The two channels
    are in the controller's own order and sign; which is left is the driver's business. `link` names, for a person, what
    the device must be set to so that it answers. `watchdog_seconds` is after what silence of ours it is to stop the
    motors by itself. `essential`: the keys of Telemetry that every such device reports, and without which the motors
    must not turn. `streams`: the device talks all the time, asked or not. `gyro` is the gyro on the same board; it
    overhears all that comes. `other_baud_rates` are those at which such a device is looked for if it does not answer at
    the default one. `monotonic_ns` is the driver's clock, which some devices are sent. `objection` is a sentence on
    why the device must not be driven, as soon as what it says
    shows that; else "".
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
        """Ask for the name and version of the device."""

    @abstractmethod
    def learn(self) -> list[Request[None]]:
        """Return the requests, to be made once after connecting, from whose replies this object learns dialects."""

    @abstractmethod
    def set_watchdog(self, seconds: float) -> Request[None]:
        """Have the device stop the motors by itself when it has heard nothing for this time."""

    @abstractmethod
    def read_watchdog(self) -> Request[float]:
        """Ask for the time set with `set_watchdog` (s)."""

    @abstractmethod
    def drive(self, first: float, second: float) -> Request[tuple[float, float]]:
        """Set the duty of both channels (-1 to 1); the answer is the duty really sent, rounded as the wire rounds."""

    def stops(self) -> list[Request[tuple[float, float]]]:
        """Return the requests that stop all motors; each is made for itself, whether the others are answered or not."""
        return [self.drive(0.0, 0.0)]

    @abstractmethod
    def read_encoders(self) -> Request[tuple[int, int]]:
        """Ask for both encoder counts (ticks, modulo 2^32, 0 to 2^32 - 1)."""

    @abstractmethod
    def read_telemetry(self) -> list[Request[Telemetry]]:
        """Return the requests for everything else, to be made in turn, one in a cycle."""


def signed_step(before: int, after: int) -> int:
    """Return the step from one raw count to another, modulo 2^32, as the smaller of the two ways round (ticks)."""
    return (after - before + COUNTER_RANGE // 2) % COUNTER_RANGE - COUNTER_RANGE // 2
