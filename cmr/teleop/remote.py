"""Input from the joystick of a page: lines of JSON from and to the page's server.

In: `{"beat": 7, "forward": 0.5, "turn": 0.0}`, `{"request": "stop"}`. Out, by the process: `{"beat": 8, ...}`. Each
message of the page carries the number of the newest beat that it has received: delayed messages are thus recognised as
old, and move nothing.
"""

import json
import math
from collections.abc import Callable

from cmr.teleop.hands import END, FASTER, SILENCE, SLOWER, STILL, STOP, Hands

REQUESTS = (STOP, FASTER, SLOWER)
MOST_BEATS = 100  # kept, 4 s' worth
LONGEST_LINE = 500  # bytes
NUMBER = (int, float)


class Remote:
    """The joystick of a page; `read` returns the bytes received since the last call, b"" for none, None when the page
    is closed.
    """

    name = "page"

    def __init__(self, read: Callable[[], bytes | None]) -> None:
        self._read = read
        self._rest = b""
        self._sent: dict[int, float] = {}  # when each beat was sent [s]
        self._hands, self._as_of = STILL, float("-inf")
        self._requests: list[str] = []

    def beat(self, now: float) -> int:
        """Return the number of the beat that is sent now."""
        number = max(self._sent, default=0) + 1
        self._sent[number] = now
        if len(self._sent) > MOST_BEATS:
            del self._sent[min(self._sent)]
        return number

    def look(self, _now: float) -> None:
        """Process the messages of the page."""
        data = self._read()
        if data is None:
            self._hands = STILL
            self._requests.append(END)
            return
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-LONGEST_LINE:]
        for line in lines:
            self._take(line)

    def hands(self, now: float) -> Hands:
        """Return the position of the joystick."""
        return self._hands if now - self._as_of <= SILENCE else STILL

    def requests(self) -> list[str]:
        """Return the requests since the last call."""
        requests, self._requests = self._requests, []
        return requests

    def problem(self, now: float) -> str:
        """Return that the page does not answer."""
        return "" if now - self._as_of <= SILENCE else f"the page, which has not answered for {SILENCE:g} s"

    def _take(self, line: bytes) -> None:
        try:
            said = json.loads(line)
        except ValueError:
            return
        if not isinstance(said, dict):
            return
        if said.get("request") in REQUESTS:
            self._requests.append(said["request"])
        beat, forward, turn = (said.get(name) for name in ("beat", "forward", "turn"))
        sent = self._sent.get(beat) if isinstance(beat, int) else None
        if sent is None or sent < self._as_of or not (isinstance(forward, NUMBER) and isinstance(turn, NUMBER)):
            return
        if math.isfinite(forward) and math.isfinite(turn):
            self._hands, self._as_of = Hands(forward, turn).bounded(), sent
