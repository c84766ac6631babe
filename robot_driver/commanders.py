"""Whether one program alone commands a robot that nobody claimed (`cmr.bus.claiming`: who did has it).

Programs that claim nothing do not name themselves in what they command, but two of them disagree. The commands of one
change steadily from one to the next. Those of two alternate: a command departs from the one before it, and the next one
comes back.
"""

from collections import deque
from typing import NamedTuple

WINDOW = 1_000_000  # us
MOST = 10_000  # commands that are looked back upon: any number may have stamps within the window
FEWEST = 7  # departures and returns within the window; chance, noise and a single correction make fewer
SHARE = 0.1  # of all commands
DIFFERENT = 0.01  # duty; smaller differences do nothing to the robot
RETURN = 0.15  # of the departure, within which the next command has to be at the one before
REPORTED = 5_000_000  # us for which it stays reported, so that a person sees it


class _Command(NamedTuple):
    utime: int
    left: float
    right: float


class Commanders:
    """Takes all commands of one robot, at whatever times [us] they were decided, in the order of arrival."""

    def __init__(self) -> None:
        self._recent: deque[_Command] = deque(maxlen=3)
        self._commands: deque[int] = deque(maxlen=MOST)
        self._departures: deque[int] = deque(maxlen=MOST)
        self._seen: int | None = None

    def take(self, utime: int, left: float, right: float) -> None:
        """Take a command."""
        self._recent.append(_Command(utime, left, right))
        self._commands.append(utime)
        if len(self._recent) == 3 and _departs(*self._recent):
            self._departures.append(utime)
        for times in (self._commands, self._departures):
            while times and abs(utime - times[0]) > WINDOW:  # also what one with another clock decided later
                times.popleft()
        if len(self._departures) >= max(FEWEST, SHARE * len(self._commands)):
            self._seen = utime

    def problem(self, utime: int) -> str:
        """Return that several processes command the robot; empty if it does not look so at `utime` [us]."""
        if self._seen is None or abs(utime - self._seen) > REPORTED:
            return ""
        return "More than one process commands this robot: end all but one. cmr-spy shows what is on the bus."


def _departs(before: _Command, between: _Command, after: _Command) -> bool:
    """Return whether the command between departs from the one before, and the one after comes back."""
    departure = max(abs(between.left - before.left), abs(between.right - before.right))
    back = max(abs(after.left - before.left), abs(after.right - before.right))
    return departure > DIFFERENT and back < RETURN * departure
