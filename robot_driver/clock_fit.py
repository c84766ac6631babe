"""Estimate the sampling times of a sensor with a constant rate, from arrival times.

Adapters and schedulers delay readings, often several at once, but never advance them. So the true times are on a
straight line over the reading numbers, below all arrivals: the lower edge of their convex hull. The sensor's rate is
estimated, within a few per cent of the nominal one.
"""

import math
from bisect import bisect
from collections import deque
from dataclasses import dataclass, field

WINDOW = 30.0  # s of readings in the fit; quartz drift is negligible over this time
RATE_TOLERANCE = 0.05  # share by which a sensor's rate may differ from its nominal one
# s of arrivals of which some are certainly on time; a busy computer may have delayed all earlier ones
FIRST_SIGHT = 0.5
RATE_KNOWN = 10.0  # s of readings after which the rate is known to 1e-3, whatever the delays
OWN_PACE = 0.01  # relative rate error that no quartz exceeds
LONGEST_DRIFT = 0.5  # s of delay that may grow only because a computer becomes busier
PACE_AGREEMENT = 0.2  # relative tolerance between the two halves of the readings
LONGEST_GAP = 0.5  # s without a reading after which the number of missing ones is unknown
SLIP_FROM = 0.4  # s of readings after which the rate is known well enough to detect missing ones
# In steps, the time of the largest undetectable number of lost readings: the delay of a reading after a loss; and how
# early a reading is if there was no loss and earlier ones were only late.
SLIP, EARLY = 0.9, 0.3
LONGEST_RUN = 4  # consecutive arrivals that must be equally late to count readings as lost, at most
SELDOM = 0.25  # largest ratio of late runs due to load to those due to losses
REMEMBERED = 100  # runs remembered
ON_TRIAL = 50  # arrivals after which losses are confirmed

Point = tuple[int, int]  # number of a reading, time (monotonic ns)


@dataclass
class _Late:
    """Arrivals since a late one, numbered as before it, and the hull without them.

    The first are late by `steps` [the time of `unnoticed` readings]; `counted` readings count as lost for them.
    """

    hull: deque[Point]
    arrivals: list[Point] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    counted: int = 0


class ClockFit:
    """Maps the numbers of a sensor's readings to times; `nominal_rate` in Hz.

    `unnoticed` is the number of readings, or a divisor of it, that can be lost without detection: 1 without numbers,
    otherwise the period of the numbers.
    """

    def __init__(self, nominal_rate: float, unnoticed: int = 1) -> None:
        self._nominal = 1e9 / nominal_rate  # ns
        self._slowest, self._fastest = self._nominal / (1 + RATE_TOLERANCE), self._nominal * (1 + RATE_TOLERANCE)  # ns
        self._hull: deque[Point] = deque()
        self._slope_known: float | None = None  # of the hull as it is
        self._step = unnoticed
        self._missing = 0
        self._late: _Late | None = None
        # The latest runs of late arrivals: their number without a loss, 0 with one, and when (ns).
        self._ended: deque[Point] = deque(maxlen=REMEMBERED)
        self._began = self._newest = 0

    @property
    def is_known(self) -> bool:
        """Whether the times of the last readings are accurate to 2 ms."""
        return self._newest - self._began >= FIRST_SIGHT * 1e9

    @property
    def pace(self) -> float:
        """The ratio of the sensor's rate to its nominal one; 1 unless the difference is significant.

        A computer that becomes busy delays readings from then on, which bends the line; a different sensor rate gives a
        straight line that diverges.
        """
        if not self._hull or self._hull[-1][1] - self._hull[0][1] < RATE_KNOWN * 1e9:
            return 1.0
        (first, begin), (last, end) = self._hull[0], self._hull[-1]
        drift = end - begin - (last - first) * self._nominal
        pace = self._nominal / self._slope()
        if abs(pace - 1.0) <= OWN_PACE or abs(drift) <= LONGEST_DRIFT * 1e9:
            return 1.0
        is_straight = self._difference_of_halves() < PACE_AGREEMENT * abs(pace - 1.0)
        return pace if is_straight else 1.0

    def times_of(self, readings: list[Point]) -> list[int]:
        """Return the sampling times of readings that arrived together, as (number, latest possible time).

        Numbers count readings, including known losses. Times are in ns.
        """
        if self._hull and readings[0][1] - self._newest > LONGEST_GAP * 1e9:
            self._begin_anew()
        if not self._hull:
            self._began = readings[-1][1]
        self._newest = readings[-1][1]
        number, latest = readings[-1]  # readings that arrived with it are not before the line unless it is
        self._count_missing(number + self._missing, latest)
        self._add((number + self._missing, latest))
        at, time, slope = self._line()
        at -= self._missing
        return [min(round(time + slope * (number - at)), latest) for number, latest in readings]

    def _count_missing(self, number: int, latest: int) -> None:
        """Count readings as lost if all arrivals are late by their periods, and revise that if one arrives too early.

        A reading is late because the computer is busy, or because its number is wrong: initially this is unknown.
        """
        if len(self._hull) < 2 or number - self._hull[0][0] < SLIP_FROM * 1e9 / self._nominal:
            return
        at, time, slope = self._line()
        steps = (latest - time - slope * (number - at)) / (slope * self._step)
        if steps >= SLIP:
            if self._late is not None and self._late.counted:
                self._ended.append((0, latest))
            if self._late is None or self._late.counted:
                self._late = _Late(self._hull.copy())
            self._late.arrivals.append((number, latest))
            self._late.steps.append(steps)
            if len(self._late.steps) >= self._run(latest):
                self._recount(self._step * int(min(self._late.steps) + 1.0 - SLIP))
        elif self._late is not None and (not self._late.counted or steps < -EARLY):
            self._ended.append((len(self._late.steps), latest))
            self._recount(-self._late.counted)
            self._late = None
        elif self._late is not None:
            self._late.arrivals.append((number - self._late.counted, latest))
            if len(self._late.arrivals) >= ON_TRIAL:
                self._ended.append((0, latest))
                self._late = None

    def _run(self, now: int) -> int:
        """Return how many consecutive arrivals must be late for a loss to be far more likely."""
        while self._ended and now - self._ended[0][1] > WINDOW * 1e9:
            self._ended.popleft()
        in_vain = [length for length, _ in self._ended if length]
        seldom = SELDOM * (len(self._ended) - len(in_vain))
        longer = (sum(length >= run for length in [1, *in_vain]) for run in range(1, LONGEST_RUN))
        return next((run for run, count in enumerate(longer, start=1) if count <= seldom), LONGEST_RUN)

    def _recount(self, missing: int) -> None:
        """Count more readings as lost before the first of the late ones."""
        assert self._late is not None
        self._missing += missing
        self._late.counted += missing
        self._hull = self._late.hull.copy()
        self._slope_known = None
        for number, latest in self._late.arrivals:
            self._add((number + self._late.counted, latest))

    def _begin_anew(self) -> None:
        self._hull.clear()
        self._slope_known = None
        self._late = None

    def _add(self, point: Point) -> None:
        hull = self._hull
        number, time = point
        while len(hull) >= 2:
            (before, began), (middle, reached) = hull[-2], hull[-1]
            if (reached - began) * (number - before) < (time - began) * (middle - before):
                break  # the last one is below the line from the one before it to this one
            hull.pop()
        hull.append(point)
        self._slope_known = None
        self._forget(point[0] - round(WINDOW * 1e9 / self._nominal))

    def _forget(self, oldest: int) -> None:
        """Cut the hull at the number `oldest`, on its line: its slope stays known."""
        hull = self._hull
        while len(hull) > 2 and hull[1][0] <= oldest:
            hull.popleft()
        (first, begin), (second, end) = hull[0], hull[min(1, len(hull) - 1)]
        if first < oldest < second:
            hull[0] = oldest, begin + (end - begin) * (oldest - first) // (second - first)

    def _line(self) -> tuple[int, int, float]:
        """Return the highest line with the middle slope below all readings: a point and the slope."""
        slope, begin, lowest, touched = self._slope(), self._hull[0][0], math.inf, self._hull[0]
        for point in self._hull:
            height = point[1] - slope * (point[0] - begin)
            if height < lowest:
                lowest, touched = height, point
        return *touched, slope

    def _difference_of_halves(self) -> float:
        """Return by what share of a period the intervals in the two halves of the readings differ."""
        numbers, times = [number for number, _ in self._hull], [time for _, time in self._hull]
        begin, end = self._hull[0], self._hull[-1]
        number = (begin[0] + end[0]) / 2
        after = bisect(numbers, number)
        share = (number - numbers[after - 1]) / (numbers[after] - numbers[after - 1])
        middle = times[after - 1] + share * (times[after] - times[after - 1])
        return abs(begin[1] + end[1] - 2 * middle) / ((number - begin[0]) * self._nominal)

    def _slope(self) -> float:
        """Return the interval between readings in the middle of the hull (ns)."""
        if self._slope_known is None:
            self._slope_known = self._slope_of_hull()
        return self._slope_known

    def _slope_of_hull(self) -> float:
        middle = (self._hull[0][0] + self._hull[-1][0]) / 2
        before, began = self._hull[0]
        for number, time in self._hull:
            if number >= middle and number > before:
                slope = (time - began) / (number - before)
                return min(max(slope, self._slowest), self._fastest)
            before, began = number, time
        return self._nominal
