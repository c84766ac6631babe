"""Interface of manual input: the demand, and the time as of which it is known.

All sources meet one requirement: when released, unplugged or silent, they demand nothing within SILENCE. Terminal and
page are polled continually and answer at once, in order. So when the answer to a question has arrived, everything they
sent before that question was asked has arrived too: `Answers.as_of` is that time. Input known as of longer ago than
SILENCE moves no robot, wherever messages are delayed.
"""

from collections import deque
from typing import NamedTuple, Protocol

# s; with one cycle of the process and the transport to the driver, the robot is commanded zero within 0.2 s
SILENCE = 0.15
MOST_OPEN = 100  # unanswered questions; two seconds' worth
ENOUGH = 0.02  # of full speed; less is zero


class Hands(NamedTuple):
    """The demand, each -1 to 1: ahead, and to the left."""

    forward: float = 0.0
    turn: float = 0.0

    def bounded(self) -> "Hands":
        """Return the demand clipped to its limits; NaN and values near zero become zero."""
        return Hands(*(min(max(share, -1.0), 1.0) if abs(share) >= ENOUGH else 0.0 for share in self))


STILL = Hands()
STOP, END, FASTER, SLOWER = "stop", "end", "faster", "slower"  # other requests


class Source(Protocol):
    """A source of input. Times are in seconds of a monotonic clock."""

    name: str

    def look(self, now: float) -> None:
        """Process what has arrived."""

    def hands(self, now: float) -> Hands:
        """Return the demand."""

    def requests(self) -> list[str]:
        """Return the requests since the last call."""

    def problem(self, now: float) -> str:
        """Return why the input is not available, as the end of "Waiting for ..."; empty if it is."""


class Answers:
    """Tracks the time [s] as of which everything was received from a partner that answers questions in order."""

    def __init__(self) -> None:
        self.as_of = float("-inf")
        self.delay = 0.0  # s delay of the last answer
        self._open: deque[float] = deque()

    def ask(self, now: float) -> bool:
        """Record that a question is sent; return whether it may be, as the number of open questions is limited."""
        if len(self._open) >= MOST_OPEN:
            return False
        self._open.append(now)
        return True

    def answered(self, now: float) -> None:
        """Record an answer; ignore one that was not asked for."""
        if self._open:
            self.as_of = self._open.popleft()
            self.delay = now - self.as_of

    def is_fresh(self, now: float) -> bool:
        """Return whether the input is recent enough for a robot to move."""
        return now - self.as_of <= SILENCE
