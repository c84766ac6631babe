"""What a person's hands ask for, whatever they hold, and up to which moment that is known.

All sources keep one promise: one that is let go, unplugged, or not heard any more asks for nothing within SILENCE.
Terminal and page are asked again and again, and answer at once; what they say comes in order. So when the answer to a
question is there, everything is known that they had to say before that question was sent: `Answers.as_of` is that
moment. What is known as of longer ago than SILENCE moves no robot, wherever on the way messages are held up.
"""

from collections import deque
from typing import NamedTuple, Protocol

SILENCE = 0.15  # s; with a turn of the process and the way to the driver, the robot is commanded zero within 0.2 s
MOST_OPEN = 100  # questions without an answer; two seconds of them
ENOUGH = 0.02  # of full speed; less is zero


class Hands(NamedTuple):
    """What is asked for, each -1 to 1: ahead, and to the left."""

    forward: float = 0.0
    turn: float = 0.0

    def bounded(self) -> "Hands":
        """Return them within what they may be; what is no number is zero, and so is next to nothing."""
        return Hands(*(min(max(share, -1.0), 1.0) if abs(share) >= ENOUGH else 0.0 for share in self))


STILL = Hands()
STOP, END, FASTER, SLOWER = "stop", "end", "faster", "slower"  # what is wished besides


class Source(Protocol):
    """Where hands are seen. Times are seconds of a clock that nobody sets."""

    name: str

    def look(self, now: float) -> None:
        """Take what has come."""

    def hands(self, now: float) -> Hands:
        """Return what is asked for."""

    def wishes(self) -> list[str]:
        """Return what was wished since the last call."""

    def problem(self, now: float) -> str:
        """Return why the hands are not seen, as the end of "Waiting for ..."; empty if they are."""


class Answers:
    """Knows up to which moment [s] everything was heard from somebody who answers questions in their order."""

    def __init__(self) -> None:
        self.as_of = float("-inf")
        self.delay = 0.0  # s that the last answer took
        self._open: deque[float] = deque()

    def ask(self, now: float) -> bool:
        """Note that a question is sent; return whether it may be, as not too many are open."""
        if len(self._open) >= MOST_OPEN:
            return False
        self._open.append(now)
        return True

    def answered(self, now: float) -> None:
        """Note an answer; one that was not asked for is none."""
        if self._open:
            self.as_of = self._open.popleft()
            self.delay = now - self.as_of

    def is_fresh(self, now: float) -> bool:
        """Return whether what is known is new enough for a robot to move."""
        return now - self.as_of <= SILENCE
