"""When a sensor that samples steadily took its readings, from when they arrived.

Readings arrive late by what adapters and schedulers hold them back for, often several at once, but never early. So
the true times lie on a straight line over the numbers of the readings, below all arrivals: the lower edge of their
convex hull. The sensor's rate is its own; only a few per cent around the nominal one are believed.
"""

from collections import deque

WINDOW = 30.0  # s of readings that a line is fitted to; over that time no quartz drifts noticeably
RATE_TOLERANCE = 0.03  # share by which a sensor's rate may differ from its nominal one
LONGEST_GAP = 0.5  # s without a reading after which nothing is known about how many are missing
SLIP_TEST = 50  # readings that must all be late by half a period before one counts as missing

Point = tuple[int, int]  # number of a reading, time (monotonic ns)


class ClockFit:
    """Maps the numbers of a sensor's readings to times; `nominal_rate` in Hz."""

    def __init__(self, nominal_rate: float) -> None:
        self._nominal = 1e9 / nominal_rate  # ns
        self._hull: deque[Point] = deque()
        self._lateness: deque[float] = deque(maxlen=SLIP_TEST)
        self._missing = 0
        self._newest = 0

    def times_of(self, readings: list[Point]) -> list[int]:
        """Return when readings were taken that came together, as (number, time by which it was taken at the latest).

        Numbers count readings, lost ones included as far as they are known. Times are in ns.
        """
        if self._hull and readings[0][1] - self._newest > LONGEST_GAP * 1e9:
            self._begin_anew()
        self._newest = readings[-1][1]
        for number, latest in readings:
            self._add((number + self._missing, latest))
            self._lateness.append(latest - self._line_at(number + self._missing))
        if len(self._lateness) == SLIP_TEST and min(self._lateness) > 0.5 * self._nominal:
            self._count_missing(*readings[-1])
        return [min(round(self._line_at(number + self._missing)), latest) for number, latest in readings]

    def _count_missing(self, number: int, latest: int) -> None:
        """Take it that readings were lost unnoticed, as all recent ones seem late by whole periods."""
        while len(self._hull) > 1 and self._hull[-1][0] > number + self._missing - SLIP_TEST:
            self._hull.pop()
        self._missing += round(min(self._lateness) / self._nominal)
        self._lateness.clear()
        self._add((number + self._missing, latest))

    def _begin_anew(self) -> None:
        self._hull.clear()
        self._lateness.clear()

    def _add(self, point: Point) -> None:
        hull = self._hull
        while len(hull) >= 2 and _is_above(hull[-1], hull[-2], point):
            hull.pop()
        hull.append(point)
        oldest = point[0] - WINDOW * 1e9 / self._nominal
        while len(hull) > 2 and hull[0][0] < oldest:
            hull.popleft()

    def _line_at(self, number: int) -> float:
        """Return the time on the highest line of the middle's slope that no reading lies below."""
        slope = self._slope()
        return min(time + slope * (number - at) for at, time in self._hull)

    def _slope(self) -> float:
        hull = self._hull
        middle = (hull[0][0] + hull[-1][0]) / 2
        for i in range(1, len(hull)):
            if hull[i][0] >= middle and hull[i][0] > hull[i - 1][0]:
                slope = (hull[i][1] - hull[i - 1][1]) / (hull[i][0] - hull[i - 1][0])
                return min(max(slope, self._nominal / (1 + RATE_TOLERANCE)), self._nominal * (1 + RATE_TOLERANCE))
        return self._nominal


def _is_above(middle: Point, before: Point, after: Point) -> bool:
    """Tell whether a point lies on or above the line from the one before it to the one after it."""
    return (middle[1] - before[1]) * (after[0] - before[0]) >= (after[1] - before[1]) * (middle[0] - before[0])
