"""KVH DSP-3000 fibre-optic gyro, 100 Hz asynchronous digital interface: one ASCII line a reading.

A line is a rate in deg/s and a validity digit, `       0.015733   1` CR LF. There is no checksum. Seen from above an
upright sensor counts clockwise positive. Source: KVH 54-0215 Rev C, pages 7, 12 and 13.
"""

import math
import re
from collections import deque
from dataclasses import replace

from robot_driver.gyros.gyro import Gyro, GyroReading

LARGEST_RATE = 500.0  # deg/s; beyond it the output is unreliable whatever the validity digit says
SETTLING = 10  # readings after a mode letter that may still be of another mode
ASKING = (10, 8, 6)  # remaining readings at which the letter is sent: any one may be lost
LONGEST_LINE = 64  # bytes; real lines have 21, longer ones are another protocol or noise
RATE_MODE = b"R"
LARGEST_LEAP = 50.0  # deg/s from one reading to the next; 5000 deg/s^2 is more than wheels give
# deg/s from which a fall to a fiftieth, from one reading to the next, is hardly due to a robot that stops
CLEAR_RATE = 2.0
FALL = 50.0
SMOOTHEST = 0.001  # deg/s; see Doubts
SMOOTH_READINGS = 8

_LINE = re.compile(rb"[ \t]*(-?[0-9]{1,9}(?:\.[0-9]{0,9})?)[ \t]+([01])[ \t]*\r?\n")


class Dsp3000(Gyro):
    """A DSP-3000 in rate mode, mounted upright.

    It does not say which mode it is in. So the letter is sent again when its readings become valid: at the first one,
    when nobody knows how long it has been on, and whenever it may just have been switched on; and when their values
    raise doubts. A letter may be lost, so it is sent again, twice. Readings are reported as not valid until they are
    sure to be rates.
    """

    baud_rate = 38400
    nominal_rate = 100.0

    def __init__(self) -> None:
        self._line = b""
        self._at_line_start = False  # the first bytes may be the rest of a line
        self._damaged = 0  # lines since the last reading
        self._was_valid = False
        self._doubts = Doubts()
        self._unsettled = 0
        self._request = b""

    @property
    def wake_up(self) -> bytes:
        """The letter of the rate mode; three times, because one may be lost and nothing answers."""
        return RATE_MODE * 3

    def feed(self, data: bytes) -> list[GyroReading]:
        """Take the next bytes; return the readings completed by them. Lines that make no sense are skipped."""
        readings = []
        *complete, rest = (self._line + data).split(b"\n")
        remaining = len(rest) + sum(len(line) + 1 for line in complete)
        for line in complete:
            is_whole = self._at_line_start and len(line) <= LONGEST_LINE
            reading = _reading(line + b"\n", remaining, self._damaged) if is_whole else None
            self._damaged = 0 if reading is not None else self._damaged + self._at_line_start
            self._at_line_start = True
            remaining -= len(line) + 1
            if reading is not None:
                readings.append(self._settled(reading))
        if len(rest) > LONGEST_LINE:
            self._damaged += self._at_line_start
            self._at_line_start, rest = False, b""
        self._line = rest
        return readings

    def next_request(self) -> bytes:
        """Return the letter of the rate mode, three times, when it is to be sent after readings have become valid."""
        request, self._request = self._request, b""
        return request

    def _settled(self, reading: GyroReading) -> GyroReading:
        """Return the reading, marked invalid if it may not be a rate."""
        doubtful = self._doubts.raised_by(reading)
        if reading.valid and (doubtful or not self._was_valid):
            self._unsettled = SETTLING
        self._was_valid = reading.valid
        if not self._unsettled:
            return reading
        if self._unsettled in ASKING:
            self._request = self.wake_up
        self._unsettled -= 1
        return replace(reading, yaw_rate=math.nan, valid=False)


class Doubts:
    """Detects in the values that they may have become angles; a false alarm costs SETTLING readings.

    The angle turned since the last reading (mode A) is a hundredth of the rate: values fall. The angle turned since
    the beginning (mode P) may be any: values leap. When the robot hardly turns they may do neither, but then angles are
    too smooth: the sensor's random walk, some 0.05 deg/sqrt(h), scatters rates by 0.01 deg/s and angles by a hundredth
    of that. What a robot's turning adds to the second differences of its rates is never negative, so only a change of
    mode while it turns slowly and unsteadily stays unseen. The Earth's rate, 0.004 deg/s, shows nothing: the bias may
    be as large.
    """

    def __init__(self) -> None:
        self._rates: deque[float] = deque(maxlen=3)  # deg/s
        self._smooth = 0  # consecutive readings

    def raised_by(self, reading: GyroReading) -> bool:
        """Process the next reading; return whether it raises doubts: at once, or once at the end of a smooth
        stretch.
        """
        if not reading.valid:
            self._rates.clear()
            return False
        self._rates.append(math.degrees(reading.yaw_rate))
        before, rate = self._rates[max(len(self._rates) - 2, 0)], self._rates[-1]
        falls = abs(before) > CLEAR_RATE and abs(rate) * FALL < abs(before)
        self._smooth = self._smooth + 1 if self._is_smooth() else 0
        return falls or abs(rate - before) > LARGEST_LEAP or self._smooth == SMOOTH_READINGS

    def _is_smooth(self) -> bool:
        if len(self._rates) < 3:
            return False
        first, second, third = self._rates
        return abs(first - 2.0 * second + third) < SMOOTHEST


def _reading(line: bytes, bytes_since: int, lost_before: int) -> GyroReading | None:
    """Return the reading in one line with its LF, None if it is not a line of this gyro."""
    match = _LINE.fullmatch(line)
    if match is None:
        return None
    if match[2] == b"0":
        return GyroReading(math.nan, False, bytes_since, lost_before=lost_before)
    rate = float(match[1])
    if abs(rate) > LARGEST_RATE:
        return None
    return GyroReading(-math.radians(rate), True, bytes_since, lost_before=lost_before)
