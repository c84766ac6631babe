"""The recordings: the truth from the wire, and the driver's messages, on one clock."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from cmr.msg import estop_latch_t, gyro_t, motor_feedback_t, process_status_t
from robot_driver.acceptance.dialects import Dialect, Kind
from robot_driver.acceptance.filter import SECOND, Exchange
from robot_driver.controllers.controller import signed_step
from robot_driver.encoders import Wiring
from robot_driver.gate.guard import STANDSTILL, Channels


class Span(NamedTuple):
    """Start and end of an action (ns, monotonic)."""

    begin: int
    end: int

    @property
    def seconds(self) -> float:
        """Its duration (s)."""
        return (self.end - self.begin) / SECOND

    def holds(self, moment: int) -> bool:
        """Return whether a moment is in it."""
        return self.begin <= moment <= self.end


class Drive(NamedTuple):
    """A duty on the wire: time, channels, whether the device acknowledged it and the driver received the reply."""

    asked: int
    duty: Channels
    acknowledged: bool
    seen: bool

    @property
    def moves(self) -> bool:
        """Whether it is not zero."""
        return self.duty != STANDSTILL


class Reading(NamedTuple):
    """Wheel positions from a reply of the device: accumulated ticks of left and right, forward positive."""

    asked: int
    answered: int
    ticks: tuple[int, int]


class Wire:
    """Requests to the device and its replies, as drives and readings."""

    def __init__(self, dialect: Dialect, wiring: Wiring, exchanges: Sequence[Exchange]) -> None:
        self.dialect = dialect
        self.exchanges = list(exchanges)
        self.drives = [drive for one in self.exchanges if (drive := self._drive(one)) is not None]
        self.readings = _readings(dialect, wiring, self.exchanges)

    def _drive(self, one: Exchange) -> Drive | None:
        duty = self.dialect.duty(one.passed) if one.passed == one.request else None
        if duty is None:
            return None
        done = self.dialect.acknowledged(one.request, one.reply)
        return Drive(one.asked, duty, done, done and one.delivered == one.reply)

    def drives_in(self, span: Span) -> list[Drive]:
        """Return the duties that were sent in a span."""
        return [drive for drive in self.drives if span.holds(drive.asked)]

    def first_zero(self, since: int) -> Drive | None:
        """Return the first zero after a moment."""
        return next((drive for drive in self.drives if drive.asked >= since and not drive.moves), None)

    def of_kind(self, kind: Kind, span: Span) -> list[Exchange]:
        """Return the exchanges of a kind in a span."""
        return [one for one in self.exchanges if span.holds(one.asked) and self.dialect.kind(one.request) is kind]

    def speed(self, before: int) -> float:
        """Return the speed of the faster wheel in the third of a second before a moment (ticks/s)."""
        chosen = [one for one in self.readings if before - SECOND // 3 <= one.asked <= before]
        if len(chosen) < 2 or chosen[-1].asked == chosen[0].asked:
            return 0.0
        return _way(chosen[0], chosen[-1]) / ((chosen[-1].asked - chosen[0].asked) / SECOND)

    def gained(self, since: int, until: int) -> int | None:
        """Return the rotation of the faster wheel between the last reading before a time and the first after another.

        In ticks; None without such readings.
        """
        before = [one for one in self.readings if one.answered <= since]
        after = next((one for one in self.readings if one.asked > max(since, until)), None)
        return _way(before[-1], after) if before and after else None

    def stood_after(self, since: int, until: int) -> float:
        """Return the time from a moment until both wheels had stopped (s), by readings up to another moment.

        NaN without readings.
        """
        chosen = [one for one in self.readings if since <= one.asked <= until]
        if not chosen:
            return math.nan
        moving = [one.answered for one in chosen if one.ticks != chosen[-1].ticks]
        return max((moving[-1] - since) / SECOND, 0.0) if moving else 0.0


def _way(first: Reading, last: Reading) -> int:
    return max(abs(last.ticks[side] - first.ticks[side]) for side in (0, 1))


def _readings(dialect: Dialect, wiring: Wiring, exchanges: Iterable[Exchange]) -> list[Reading]:
    readings: list[Reading] = []
    before: tuple[int, int] | None = None
    ticks = (0, 0)
    for one in exchanges:
        raw = dialect.counts(one.reply) if dialect.kind(one.passed) is Kind.COUNTS else None
        if raw is None:
            continue
        counts = wiring.forward_counts(*raw)
        if before is not None:
            ticks = (ticks[0] + signed_step(before[0], counts[0]), ticks[1] + signed_step(before[1], counts[1]))
        before = counts
        readings.append(Reading(one.asked, one.answered, ticks))
    return readings


@dataclass
class Record:
    """Messages received on the bus. `offset` (ns) is time of day minus monotonic clock."""

    offset: int = 0
    feedback: list[motor_feedback_t] = field(default_factory=list)
    gyro: list[gyro_t] = field(default_factory=list)
    statuses: list[process_status_t] = field(default_factory=list)
    latches: list[estop_latch_t] = field(default_factory=list)

    def moment(self, utime: int) -> int:
        """Return a time of day (us) on the monotonic clock (ns)."""
        return 1000 * utime - self.offset

    def feedback_in(self, span: Span) -> list[motor_feedback_t]:
        """Return the feedback that was measured in a span."""
        return [one for one in self.feedback if span.holds(self.moment(one.utime))]

    def gyro_in(self, span: Span) -> list[gyro_t]:
        """Return the yaw rates that were measured in a span."""
        return [one for one in self.gyro if span.holds(self.moment(one.utime))]

    def statuses_in(self, span: Span) -> list[process_status_t]:
        """Return the driver's reports on PROCESS_STATUS in a span."""
        return [one for one in self.statuses if span.holds(self.moment(one.utime))]


class Moments:
    """Readings in order of time, for lookups around a time."""

    def __init__(self, readings: Sequence[Reading]) -> None:
        self._readings = readings
        self._asked = [one.asked for one in readings]

    def about(self, moment: int, slack: int, held_up: int) -> Sequence[Reading]:
        """Return the readings that may have been stamped with this time.

        None was answered more than `slack` (ns) before: that would be a late reply mistaken for another. A busy
        computer may delay a request by up to `held_up` (ns) after the driver has made it.
        """
        begin = bisect_left(self._asked, moment - slack - SECOND // 5)
        end = bisect_right(self._asked, moment + held_up)
        return [one for one in self._readings[begin:end] if one.answered >= moment - slack]
