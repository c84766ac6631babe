"""Input from a keyboard, as a terminal reports it.

A terminal that reports releases gives the exact state of the keys. Any other reports only that a key was typed,
repeatedly while it is held: the robot then moves while the repeats continue. The first report alone moves nothing,
since it does not tell whether the key is held; keyboards wait 0.25 to 0.66 s before they repeat it.
"""

from collections.abc import Callable

from cmr.teleop.hands import END, FASTER, SILENCE, SLOWER, STILL, STOP, Answers, Hands
from cmr.teleop.keys import (
    ANSWER,
    ASK,
    ESCAPE,
    FLAGS,
    INTERRUPT,
    LOST_FOCUS,
    PRESS,
    RELEASE,
    RELEASES,
    SPACE,
    TYPED,
    Decoder,
    Event,
)

ALONE = 0.05  # s after which an ESC is the key, not the beginning of a sequence
FORGOTTEN = 0.5  # s of silence after which a key that is still held has to be pressed again
ARC = 0.5  # share of the full turn rate while driving an arc
DIRECTIONS = {
    "w": Hands(1.0, 0.0),
    "s": Hands(-1.0, 0.0),
    "a": Hands(0.0, 1.0),
    "d": Hands(0.0, -1.0),
    "q": Hands(1.0, 1.0),
    "e": Hands(1.0, -1.0),
    "y": Hands(-1.0, 1.0),  # left of x on a German keyboard, ...
    "z": Hands(-1.0, 1.0),  # ... and on others
    "c": Hands(-1.0, -1.0),
    "up": Hands(1.0, 0.0),
    "down": Hands(-1.0, 0.0),
    "left": Hands(0.0, 1.0),
    "right": Hands(0.0, -1.0),
}
REQUESTS = {SPACE: STOP, ESCAPE: STOP, INTERRUPT: END, "+": FASTER, "=": FASTER, "-": SLOWER}
HELP = "w a s d or arrows drive, q e z c arcs, + - speed, space or Esc EMERGENCY STOP, Ctrl-C end"


class Keyboard:
    """The keys of a terminal: `read` returns the bytes received since the last call, `write` sends bytes to it.

    `reports_releases` says whether the terminal reports releases.
    """

    name = "keyboard"

    def __init__(self, read: Callable[[], bytes], write: Callable[[bytes], None]) -> None:
        self.reports_releases = False
        self._read, self._write = read, write
        self._decoder, self._answers = Decoder(), Answers()
        self._fed = 0.0  # when the last bytes came [s]
        self._down: dict[str, None] = {}  # if releases are reported
        self._held, self._typed, self._repeats = "", float("-inf"), False  # if they are not
        self._requests: list[str] = []

    def look(self, now: float) -> None:
        """Process what was typed, and ask the terminal for an answer that confirms that this was all."""
        data = self._read()
        if data:
            self._fed = now
        events = list(self._decoder.feed(data))
        if self._decoder.waits and now - self._fed >= ALONE:
            events += self._decoder.flush()
        for event in events:
            self._take(now, event)
        if now - self._answers.as_of > FORGOTTEN:
            self._let_go()
        if self._answers.ask(now):
            self._write(ASK)

    def hands(self, now: float) -> Hands:
        """Return the demand of the keys that are held."""
        if not self._answers.is_fresh(now):
            return STILL
        if self.reports_releases:
            asked = [DIRECTIONS[key] for key in self._down]
        else:
            asked = [DIRECTIONS[self._held]] if self._repeats and now - self._typed <= SILENCE else []
        forward, turn = sum(one.forward for one in asked), sum(one.turn for one in asked)
        return Hands(forward, ARC * turn if forward else turn).bounded()

    def requests(self) -> list[str]:
        """Return the requests since the last call."""
        requests, self._requests = self._requests, []
        return requests

    def problem(self, now: float) -> str:
        """Return why keys are not accepted."""
        if self._answers.is_fresh(now):
            return ""
        if self._answers.as_of < 0.0:
            return "the first answer of this terminal"
        return f"answers of this terminal within {SILENCE:g} s; the last took {self._answers.delay:.2f} s"

    def _take(self, now: float, event: Event) -> None:
        if event.kind == ANSWER:
            self._answers.answered(now)
        elif event.kind == FLAGS:
            self.reports_releases = event.number & RELEASES == RELEASES
            self._let_go()
        elif event.kind == LOST_FOCUS:
            self._let_go()
        elif event.key in DIRECTIONS:
            self._take_direction(event)
        elif event.key in REQUESTS and event.kind in (PRESS, TYPED):
            self._requests.append(REQUESTS[event.key])

    def _take_direction(self, event: Event) -> None:
        if event.kind == RELEASE:
            self._down.pop(event.key, None)
        elif event.kind == PRESS:
            self._down[event.key] = None
        elif event.kind == TYPED:
            self._take_typed(event.key)

    def _take_typed(self, key: str) -> None:
        """Handle a key whose release is not reported: it was typed no earlier than the time as of which all is known.

        It counts as held if it repeats faster than fingers can type; a keyboard's pause before it repeats is longer.
        """
        typed = self._answers.as_of
        self._repeats = key == self._held and typed - self._typed <= SILENCE
        self._held, self._typed = key, typed

    def _let_go(self) -> None:
        self._down.clear()
        self._held, self._repeats = "", False
