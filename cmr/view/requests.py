"""Requests of visitors: queued by the page's threads, fulfilled by the process between pictures."""

import hmac
from queue import SimpleQueue
from typing import Any, NamedTuple

from cmr.view.entrance.guesses import Guesses

COME, LEAVE, CLICK = "come", "leave", "click"  # of a visitor: no token needed
STOP, RELEASE, FIGURE_EIGHT = "stop", "release", "figure-eight"
PAUSE, SPEED, JUMP = "pause", "speed", "jump"
OPEN, CLOSE = "open", "close"  # an uploaded log, for that visitor alone
HARMLESS = (STOP, PAUSE, SPEED, JUMP, OPEN, CLOSE)  # need no token on the computer that serves the page


class Request(NamedTuple):
    """A request: its kind, its visitor, and its object: a robot id, a speed, a time [us], an index, or a log."""

    what: str
    visitor: int
    value: Any = None


Requests = SimpleQueue[Request]


class Permission:
    """Whether one visitor has entered the token, which is required for requests.

    With `on_this_computer` the page is served only to this computer: then anybody may stop the robots, and open and
    play a log, without the token. `refused` counts refused requests. `guesses` slows down visitors who try wrong tokens
    from this `address`.
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
        """The waiting time before this visitor's next token is checked, after too many wrong ones [s]."""
        return self._guesses.wait(self._address)

    def try_token(self, text: str) -> bool:
        """Check a typed token; return whether it is right. Nothing is checked during a waiting time."""
        if not self.granted and self.wait <= 0.0:
            self.granted = hmac.compare_digest(text.strip().encode(errors="replace"), self._token)
            self._guesses.count(self._address, self.granted)
        return self.granted

    def asks(self, what: str) -> bool:
        """Return whether the visitor may request `what` now, counting refusals."""
        allowed = self.allows(what)
        self.refused += not allowed
        return allowed

    def allows(self, what: str) -> bool:
        """Return whether the visitor could have `what` now."""
        return self.granted or (what in HARMLESS and self.on_this_computer)
