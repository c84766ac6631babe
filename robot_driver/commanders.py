"""Detect several programs commanding a robot that nobody claimed (see `cmr.bus.claiming`).

Programs without claims do not name themselves, but two of them disagree. The commands of one change steadily. Those of
two alternate: a command departs from the previous one, and the next one returns.
"""

from collections import deque
from typing import NamedTuple

WINDOW = 1_000_000  # us
MOST = 10_000  # commands kept: any number may have stamps within the window
FEWEST = 7  # departures with return within the window; chance, noise and single corrections cause fewer
SHARE = 0.1  # of all commands
DIFFERENT = 0.01  # duty; smaller differences do not matter
RETURN = 0.15  # of the departure; tolerance of the return
REPORTED = 5_000_000  # us for which it is reported, so that a person sees it


class _Command(NamedTuple):
    utime: int
    left: float
    right: float


class Commanders:
    """Processes all commands of one robot, in the order of arrival, whatever their stamps [us]."""

    def __init__(self) -> None:
        self._recent: deque[_Command] = deque(maxlen=3)
        self._commands: deque[int] = deque(maxlen=MOST)
        self._departures: deque[int] = deque(maxlen=MOST)
        self._seen: int | None = None

    def take(self, utime: int, left: float, right: float) -> None:
        """Process a command."""
        self._recent.append(_Command(utime, left, right))
        self._commands.append(utime)
        if len(self._recent) == 3 and _departs(*self._recent):
            self._departures.append(utime)
        for times in (self._commands, self._departures):
            while times and abs(utime - times[0]) > WINDOW:  # also one stamped later by another clock
                times.popleft()
        if len(self._departures) >= max(FEWEST, SHARE * len(self._commands)):
            self._seen = utime

    def problem(self, utime: int) -> str:
        """Return a sentence if several processes command the robot at `utime` [us]; otherwise empty."""
        if self._seen is None or abs(utime - self._seen) > REPORTED:
            return ""
        return "More than one process commands this robot: end all but one. cmr-spy shows what is on the bus."


def _departs(before: _Command, between: _Command, after: _Command) -> bool:
    """Return whether the middle command departs from the first, and the last one returns."""
    departure = max(abs(between.left - before.left), abs(between.right - before.right))
    back = max(abs(after.left - before.left), abs(after.right - before.right))
    return departure > DIFFERENT and back < RETURN * departure
