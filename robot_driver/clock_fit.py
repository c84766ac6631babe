"""When a sensor that samples steadily took its readings, from when they arrived.

Readings arrive late by what adapters and schedulers hold them back for, often several at once, but never early. So
the true times lie on a straight line over the numbers of the readings, below all arrivals: the lower edge of their
convex hull. The sensor's rate is its own, whatever it says; a few per cent around the nominal one are believed.
"""

import math
from bisect import bisect
from collections import deque

WINDOW = 30.0  # s of readings that a line is fitted to; over that time no quartz drifts noticeably
RATE_TOLERANCE = 0.05  # share by which a sensor's rate may differ from its nominal one
FIRST_SIGHT = 0.5  # s of arrivals of which some are surely in time; before, a busy computer may have held up all
RATE_KNOWN = 10.0  # s of readings after which the rate is known to a part in a thousand, whatever held them back
OWN_PACE = 0.01  # share by which no sensor with a quartz differs from what it says
LONGEST_DRIFT = 0.5  # s by which readings may come later and later only because a computer becomes busier
PACE_AGREEMENT = 0.2  # share of what the pace is off by, within which both halves of the readings must show the same
LONGEST_GAP = 0.5  # s without a reading after which nothing is known about how many are missing
SLIP_BEFORE, SLIP_AFTER = 10, 5  # arrivals; a step of lateness between them that lasts shows that readings are missing
SLIP_FROM = 1.0  # s of readings after which the rate is known well enough to see one
SLIP = (
    0.9  # of the step that is to be seen; adapters hold back, too, but the last of what then comes together is in time
)

Point = tuple[int, int]  # number of a reading, time (monotonic ns)


class ClockFit:
    """Maps the numbers of a sensor's readings to times; `nominal_rate` in Hz.

    `unnoticed` is how many readings, or a multiple of it, may be lost without being counted: 1 where nothing numbers
    them, else after how many their numbers begin anew.
    """

    def __init__(self, nominal_rate: float, unnoticed: int = 1) -> None:
        self._nominal = 1e9 / nominal_rate  # ns
        self._slowest, self._fastest = self._nominal / (1 + RATE_TOLERANCE), self._nominal * (1 + RATE_TOLERANCE)  # ns
        self._hull: deque[Point] = deque()
        self._slope_known: float | None = None  # of the hull as it is
        self._step = unnoticed
        self._arrivals: deque[Point] = deque(maxlen=SLIP_BEFORE + SLIP_AFTER)  # the last reading of each
        self._missing = 0
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
        points = [(number + self._missing, latest) for number, latest in readings]
        for point in points:
            self._add(point)
        self._arrivals.append(point)
        at, time, slope = self._line()
        newest, latest = points[-1]
        # Those before are no earlier than the line, so that what is missing delays the newest by as much, at least.
        late = latest - (time + slope * (newest - at))
        if late >= SLIP * self._step * self._slowest and self._count_missing():
            at, time, slope = self._line()
        at -= self._missing
        return [min(round(time + slope * (number - at)), latest) for number, latest in readings]

    def _count_missing(self) -> bool:
        """Return whether readings were lost unnoticed: then all that has come since is late by whole periods."""
        newest, _ = self._arrivals[-1]
        if (
            len(self._arrivals) < SLIP_BEFORE + SLIP_AFTER
            or newest - self._hull[0][0] < SLIP_FROM * 1e9 / self._nominal
        ):
            return False
        slope = self._slope()
        lateness = [latest - slope * (number - newest) for number, latest in self._arrivals]
        steps = (min(lateness[SLIP_BEFORE:]) - min(lateness[:SLIP_BEFORE])) / (self._step * slope)
        if steps < SLIP:
            return False
        missing = self._step * round(steps)
        self._missing += missing
        since = [self._arrivals.pop() for _ in range(SLIP_AFTER)][::-1]
        while len(self._hull) > 1 and self._hull[-1][0] > self._arrivals[-1][0]:
            self._hull.pop()
        self._slope_known = None
        for number, latest in since:
            self._arrivals.append((number + missing, latest))
            self._add(self._arrivals[-1])
        return True

    def _begin_anew(self) -> None:
        self._hull.clear()
        self._slope_known = None
        self._arrivals.clear()

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
        oldest = point[0] - WINDOW * 1e9 / self._nominal
        while len(hull) > 2 and hull[0][0] < oldest:
            hull.popleft()

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
