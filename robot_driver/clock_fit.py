"""When a sensor that samples steadily took its readings, from when they arrived.

Readings arrive late by what adapters and schedulers hold them back for, often several at once, but never early. So
the true times lie on a straight line over the numbers of the readings, below all arrivals: the lower edge of their
convex hull. The sensor's rate is its own, whatever it says; a few per cent around the nominal one are believed.
"""

import math
from bisect import bisect
from collections import deque
from dataclasses import dataclass, field

WINDOW = 30.0  # s of readings that a line is fitted to; over that time no quartz drifts noticeably
RATE_TOLERANCE = 0.05  # share by which a sensor's rate may differ from its nominal one
FIRST_SIGHT = 0.5  # s of arrivals of which some are surely in time; before, a busy computer may have held up all
RATE_KNOWN = 10.0  # s of readings after which the rate is known to a part in a thousand, whatever held them back
OWN_PACE = 0.01  # share by which no sensor with a quartz differs from what it says
LONGEST_DRIFT = 0.5  # s by which readings may come later and later only because a computer becomes busier
PACE_AGREEMENT = 0.2  # share of what the pace is off by, within which both halves of the readings must show the same
LONGEST_GAP = 0.5  # s without a reading after which nothing is known about how many are missing
SLIP_FROM = 0.4  # s of readings after which the rate is known well enough to see that readings are missing
# In steps, the time of as many readings as may be lost unnoticed: how much later than all before it a reading is where
# one was lost; and how much earlier than all it is where none was, and what came before it was only late.
SLIP, EARLY = 0.9, 0.3
LONGEST_RUN = 4  # arrivals in turn that must be as late until readings count as lost, at most
SELDOM = 0.25  # times as many runs of late arrivals as were due to losses may have been due to a busy computer
REMEMBERED = 100  # such runs
ON_TRIAL = 50  # arrivals after which readings were surely lost

Point = tuple[int, int]  # number of a reading, time (monotonic ns)


@dataclass
class _Late:
    """Arrivals since one was late, numbered as before it, and the hull without them.

    The first ones are late by `steps` [the time of `unnoticed` readings]; for them, `counted` readings count as lost.
    """

    hull: deque[Point]
    arrivals: list[Point] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    counted: int = 0


class ClockFit:
    """Maps the numbers of a sensor's readings to times; `nominal_rate` in Hz.

    `unnoticed` is how many readings, or a multiple of it, may be lost without being counted: 1 where nothing numbers
    them, else after how many their numbers begin again.
    """

    def __init__(self, nominal_rate: float, unnoticed: int = 1) -> None:
        self._nominal = 1e9 / nominal_rate  # ns
        self._slowest, self._fastest = self._nominal / (1 + RATE_TOLERANCE), self._nominal * (1 + RATE_TOLERANCE)  # ns
        self._hull: deque[Point] = deque()
        self._slope_known: float | None = None  # of the hull as it is
        self._step = unnoticed
        self._missing = 0
        self._late: _Late | None = None
        # The latest runs of late arrivals: how many there were with nothing lost, 0 where something was, and when (ns).
        self._ended: deque[Point] = deque(maxlen=REMEMBERED)
        self._began = self._newest = 0

    @property
    def is_known(self) -> bool:
        """Whether the times of the last readings are good to 2 ms."""
        return self._newest - self._began >= FIRST_SIGHT * 1e9

    @property
    def pace(self) -> float:
        """How many times as fast as it says the sensor sends readings; 1 unless it surely has a pace of its own.

        A computer that has become busy makes readings late from then on, which bends the line; a sensor's own pace
        gives a straight one, and leads further and further away.
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
        """Return when readings were taken that came together, as (number, time by which it was taken at the latest).

        Numbers count readings, lost ones included as far as they are known. Times are in ns.
        """
        if self._hull and readings[0][1] - self._newest > LONGEST_GAP * 1e9:
            self._begin_anew()
        if not self._hull:
            self._began = readings[-1][1]
        self._newest = readings[-1][1]
        number, latest = readings[-1]  # those that came with it are no earlier than the line if it is not
        self._count_missing(number + self._missing, latest)
        self._add((number + self._missing, latest))
        at, time, slope = self._line()
        at -= self._missing
        return [min(round(time + slope * (number - at)), latest) for number, latest in readings]

    def _count_missing(self, number: int, latest: int) -> None:
        """Count readings as lost where all that comes is late by their periods, and no more where one comes too early.

        A reading is late because the computer is busy, or because its number is wrong: at first nobody knows.
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
        """Return how many arrivals in turn must be late, so that far more of them are due to losses than to nothing."""
        while self._ended and now - self._ended[0][1] > WINDOW * 1e9:
            self._ended.popleft()
        in_vain = [length for length, _ in self._ended if length]
        seldom = SELDOM * (len(self._ended) - len(in_vain))
        longer = (sum(length >= run for length in [1, *in_vain]) for run in range(1, LONGEST_RUN))
        return next((run for run, count in enumerate(longer, start=1) if count <= seldom), LONGEST_RUN)

    def _recount(self, missing: int) -> None:
        """Take so many readings more for lost before the first of those that were late."""
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
                break  # the last one lies below the line from the one before it to this one
            hull.pop()
        hull.append(point)
        self._slope_known = None
        self._forget(point[0] - round(WINDOW * 1e9 / self._nominal))

    def _forget(self, oldest: int) -> None:
        """Let the hull begin at the number `oldest`, on the line that it had there: its slope stays known."""
        hull = self._hull
        while len(hull) > 2 and hull[1][0] <= oldest:
            hull.popleft()
        (first, begin), (second, end) = hull[0], hull[min(1, len(hull) - 1)]
        if first < oldest < second:
            hull[0] = oldest, begin + (end - begin) * (oldest - first) // (second - first)

    def _line(self) -> tuple[int, int, float]:
        """Return the highest line of the middle's slope that no reading lies below: a point of it, and the slope."""
        slope, begin, lowest, touched = self._slope(), self._hull[0][0], math.inf, self._hull[0]
        for point in self._hull:
            height = point[1] - slope * (point[0] - begin)
            if height < lowest:
                lowest, touched = height, point
        return *touched, slope

    def _difference_of_halves(self) -> float:
        """Return by what share of a period readings come less often in one half of them than in the other."""
        numbers, times = [number for number, _ in self._hull], [time for _, time in self._hull]
        begin, end = self._hull[0], self._hull[-1]
        number = (begin[0] + end[0]) / 2
        after = bisect(numbers, number)
        share = (number - numbers[after - 1]) / (numbers[after] - numbers[after - 1])
        middle = times[after - 1] + share * (times[after] - times[after - 1])
        return abs(begin[1] + end[1] - 2 * middle) / ((number - begin[0]) * self._nominal)

    def _slope(self) -> float:
        """Return the time between two readings in the middle of the hull (ns)."""
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
