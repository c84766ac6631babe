"""What visitors ask for: put into a queue by the page's own threads, fulfilled by the process between two pictures."""

import hmac
from queue import SimpleQueue
from typing import Any, NamedTuple

from cmr.view.entrance.guesses import Guesses

COME, LEAVE, CLICK = "come", "leave", "click"  # of a visitor: what needs no token
STOP, RELEASE, FIGURE_EIGHT = "stop", "release", "figure-eight"
PAUSE, SPEED, JUMP = "pause", "speed", "jump"
OPEN, CLOSE = "open", "close"  # a log of the visitor's own, for that visitor alone
HARMLESS = (STOP, PAUSE, SPEED, JUMP, OPEN, CLOSE)  # needs no token on the computer that serves the page


class Wish(NamedTuple):
    """What is wished, by whom, and its object: a robot id, a speed, a moment [us], a place in a list, or a log."""

    what: str
    visitor: int
    value: Any = None


Wishes = SimpleQueue[Wish]


class Permission:
    """Whether one visitor has entered the token, without which nothing that he wishes is done.

    With `on_this_computer` the page is served to this computer alone: then everybody may stop the robots, and open and
    play a log, without the token. `refused` counts what was wished without permission. `guesses` slows down visitors
    who try wrong tokens from this `address`.
    """

    def __init__(
        self, token: str, on_this_computer: bool = False, guesses: Guesses | None = None, address: str = ""
    ) -> None:
        self.on_this_computer = on_this_computer
        self.granted = False
        self.refused = 0
        self._token = token.encode()
        self._guesses, self._address = guesses or Guesses(), address

    @property
    def wait(self) -> float:
        """How long no token of this visitor is looked at, after too many wrong ones [s]."""
        return self._guesses.wait(self._address)

    def try_token(self, text: str) -> bool:
        """Take what a visitor has typed; return whether it is the token. It is not looked at where he has to wait."""
        if not self.granted and self.wait <= 0.0:
            self.granted = hmac.compare_digest(text.strip().encode(errors="replace"), self._token)
            self._guesses.count(self._address, self.granted)
        return self.granted

    def asks(self, what: str) -> bool:
        """Return whether the visitor may have `what` he wishes now."""
        allowed = self.allows(what)
        self.refused += not allowed
        return allowed

    def allows(self, what: str) -> bool:
        """Return whether the visitor could have `what` now."""
        return self.granted or (what in HARMLESS and self.on_this_computer)
