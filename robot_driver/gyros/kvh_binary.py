"""KVH 1725, 1750 and 1775 IMUs and DSP-1760 gyros, with one of their three axes as the robot's yaw axis.

What a device is set to (rate or angle, unit, messages a second) is not visible in its messages, and every change of it
is kept in the device's non-volatile memory, which a driver must not wear out or surprise other users with. So the
driver changes nothing: it asks, and reads what comes accordingly. It asks again after every gap, and when a
self-test shows that the device was switched on.
Sources: KVH 1775 IMU technical manual 56-0298 Rev. B, sections 5, 7 and 8; queries as in ros_kvh1750, src/imu.cpp.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from robot_driver.gyros.gyro import Gyro, GyroReading
from robot_driver.gyros.kvh_messages import Answer, Sample, SelfTest, Stream

LARGEST_RATE = math.radians(1000.0)  # rad/s; no device of the family measures more
LEAST_RATE = 5  # messages a second; with fewer, a working device looks silent
SEQUENCE = 128  # messages after which the sequence numbers begin again
# A line end first: it finishes what noise may have left in the device. In configuration mode a device sends no data.
ENTER_CONFIGURATION, LEAVE_CONFIGURATION = b"\r\n=CONFIG,1\r\n", b"=CONFIG,0\r\n"
QUERIES = ("ROTFMT", "ROTUNITS", "DR", "MSYNC", "AXES")
UNITS = {"RAD": 1.0, "DEG": math.radians(1.0)}
DATA_RATES = ("1", "5", "10", "25", "50", "100", "250", "500", "750", "1000", "3600", "5000")
X, Y, Z = range(3)


class Unreadable(Exception):  # noqa: N818 - not an error: the owner may choose such settings
    """The device's settings do not allow rates to be read; the text says why and what to do."""


@dataclass(frozen=True)
class Reading:
    """How to read the messages: rad/s for one unit in the message, and the status bits that must be set.

    `per_period` is as in GyroReading.
    """

    scale: float
    vouching: int
    per_period: bool


class Interview:
    """Asks a device in configuration mode for its settings, twice: answers have no checksum, so two must agree."""

    def __init__(self) -> None:
        self._answers: list[str] = []

    @property
    def is_complete(self) -> bool:
        """Return whether all questions are answered."""
        return len(self._answers) == 2 * len(QUERIES)

    @property
    def agreed(self) -> dict[str, str] | None:
        """The answers by query, "" where the device does not know the query; None if the two do not agree."""
        first, second = self._answers[: len(QUERIES)], self._answers[len(QUERIES) :]
        return dict(zip(QUERIES, first, strict=True)) if first == second else None

    @property
    def question(self) -> bytes:
        """The next question to send."""
        return f"?{self._asked}\r\n".encode()

    def hear(self, answer: Answer) -> bool:
        """Process an answer; return whether it belongs to the question."""
        unknown = answer == Answer("INVALID", f"?{self._asked}")
        if answer.name != self._asked and not unknown:
            return False
        self._answers.append("" if unknown else answer.value)
        return True

    @property
    def _asked(self) -> str:
        return QUERIES[len(self._answers) % len(QUERIES)]


class KvhBinary(Gyro):
    """A device whose axis `axis` points up."""

    baud_rate = 921600
    unnoticed = SEQUENCE
    axis = Z

    def __init__(self) -> None:
        self._stream = Stream()
        self._interview: Interview | None = None
        self._reading: Reading | None = None  # None: unknown, so that no message can be read
        self._sequence: int | None = None
        self._request = b""

    @property
    def wake_up(self) -> bytes:
        """The command to enter configuration mode, whose answer begins the interview."""
        return ENTER_CONFIGURATION

    @property
    def farewell(self) -> bytes:
        """The command to leave configuration mode, unless readings have come since the interview."""
        return b"" if self._sequence is not None else b"\r\n" + LEAVE_CONFIGURATION

    @property
    def unanswered(self) -> bytes:
        """The current step of the interview, after a line end that terminates what is left of a line."""
        if self._interview is not None:
            return b"\r\n" + self._interview.question
        if self._reading is None:
            return b"" if self.problem else ENTER_CONFIGURATION
        return self.farewell

    def feed(self, data: bytes) -> list[GyroReading]:
        """Process the next bytes; return the readings completed by them. Damaged messages are skipped."""
        readings = []
        for said in self._stream.feed(data):
            if isinstance(said, Sample):
                if self._reading is not None:
                    readings.append(_reading(said, self.axis, self._reading, self._lost_before(said.sequence)))
            elif isinstance(said, SelfTest):
                self._forget()
                self._request = ENTER_CONFIGURATION
            else:
                self._hear(said)
        return readings

    def next_request(self) -> bytes:
        """Return the next line of the interview, once."""
        request, self._request = self._request, b""
        return request

    def _hear(self, answer: Answer) -> None:
        if answer == Answer("CONFIG", "1"):
            self._forget()
            self._ask_all()
        elif self._interview is not None and self._interview.hear(answer):
            if self._interview.is_complete:
                self._conclude(self._interview.agreed)
            else:
                self._request = self._interview.question

    def _conclude(self, settings: Mapping[str, str] | None) -> None:
        """Make the device send data if its settings are known; else ask again."""
        if settings is None:
            self._ask_all()
            return
        self._interview, self._request = None, LEAVE_CONFIGURATION
        try:
            self._reading = Reading(_scale(settings), _vouching(settings, self.axis), settings["ROTFMT"] == "DELTA")
            self.nominal_rate = float(settings["DR"]) if settings["MSYNC"] != "EXT" else 0.0
        except Unreadable as unreadable:
            self.problem = str(unreadable)

    def _ask_all(self) -> None:
        self._interview = Interview()
        self._request = self._interview.question

    def _forget(self) -> None:
        """Treat the device as unknown."""
        self._interview, self._reading, self._sequence, self.nominal_rate = None, None, None, 0.0

    def _lost_before(self, sequence: int) -> int:
        """Return how many messages are missing before this one."""
        before, self._sequence = self._sequence, sequence
        return 0 if before is None else (sequence - before - 1) % SEQUENCE


class KvhBinaryX(KvhBinary):
    """A device whose x axis points up."""

    axis = X


class KvhBinaryY(KvhBinary):
    """A device whose y axis points up."""

    axis = Y


def _reading(sample: Sample, axis: int, how: Reading, lost_before: int) -> GyroReading:
    rate = sample.rotation[axis] * how.scale
    # NaN is also invalid: the comparison is false for it.
    valid = sample.status & how.vouching == how.vouching and abs(rate) <= LARGEST_RATE
    rate = rate if valid else math.nan
    return GyroReading(rate, valid, sample.bytes_since, None, lost_before, how.per_period)


def _scale(settings: Mapping[str, str]) -> float:
    """Return the number of rad/s per unit of a message.

    Raises Unreadable.
    """
    unit = UNITS.get(settings["ROTUNITS"])
    form, rate, clock = settings["ROTFMT"], settings["DR"], settings["MSYNC"]
    if unit is None or form not in ("RATE", "DELTA") or rate not in DATA_RATES:
        raise _unknown(settings)
    if clock != "EXT" and int(rate) < LEAST_RATE:
        raise Unreadable(f"The gyro sends {rate} message a second. Set its =DR to 100.")
    if form == "RATE":
        return unit
    if clock == "EXT":
        raise Unreadable(
            "The gyro sends angles whenever its MSYNC input asks, so there are no rates. Set its =ROTFMT to RATE."
        )
    return unit * int(rate)


def _vouching(settings: Mapping[str, str], axis: int) -> int:
    """Return the status bits of the sensors that contribute to an axis, which the matrix of =AXES may rotate.

    Raises Unreadable.
    """
    if not settings["AXES"]:
        return 1 << axis
    try:
        matrix = [float(text) for text in settings["AXES"].split(",")]
    except ValueError:
        raise _unknown(settings) from None
    sensors = [sensor for sensor, share in enumerate(matrix[3 * axis : 3 * axis + 3]) if share != 0.0]
    if len(matrix) != 9 or not sensors:
        raise _unknown(settings)
    return sum(1 << sensor for sensor in sensors)


def _unknown(settings: Mapping[str, str]) -> Unreadable:
    answers = ", ".join(f"{name} {value or 'not known'}" for name, value in settings.items())
    return Unreadable(f"The gyro's settings make no sense ({answers}). Is it a KVH 1725, 1750, 1775 or DSP-1760?")
