"""The bus's emergency stop in a driver: engaged by anybody, latched, released with name and reason."""

from collections import Counter

from cmr.bus.estop import HOW_TO_RELEASE, local_time
from cmr.bus.messages import make
from cmr.msg import estop_latch_t, estop_t
from robot_driver.command_gate import CommandGate, Stop
from robot_driver.stop_file import EngagedStop, StopKeeper, plain

REPORT_PERIOD = 0.5  # s between reports while nothing changes; a change is reported at once


class BusStop:
    """Holds the `gate` while the emergency stop is engaged, from the start if `keeper` has a stored stop.

    `news` are sentences about events, for the terminal; reading removes them. Without a keeper a stop ends with the
    process, as is right for a robot that ends with it. Times of day are in us.
    """

    def __init__(self, gate: CommandGate, robot_id: int, keeper: StopKeeper | None = None) -> None:
        self._gate, self._robot_id, self._keeper = gate, robot_id, keeper
        self._stop = keeper.loaded if keeper is not None else None
        self._last: tuple[int, str, str] = (0, "", "")  # when the stop was engaged or released, by whom and why
        self._reported: tuple[bool, bool, int] | None = None
        self._report_due = 0.0
        self.refused: Counter[str] = Counter()
        self.news: list[str] = []
        if self._stop is not None:
            gate.hold(Stop.BUS)
            self._last = self._stop.since, self._stop.source, self._stop.reason
            self.news.append(self.sentence())

    def handle(self, message: estop_t, decided: int, *, utime: int) -> None:
        """Handle a message that engages or releases the stop, decided at `decided` and received at `utime`.

        Anybody may engage it, at any time. Refused releases are counted in `refused`, or by the gate.
        """
        if message.engaged:
            self._gate.take_estop(True, decided, utime=utime)
            if self._stop is None:
                self._engage(EngagedStop(utime, plain(message.source), plain(message.reason)))
        elif self._stop is not None:
            objection = self._objection(message)
            if objection:
                self.refused[objection] += 1
            elif self._gate.take_estop(False, decided, utime=utime):
                self._release(message, utime)

    def sentence(self) -> str:
        """Who engaged the stop, when and why, and how to release it; "" while none is engaged."""
        stop = self._stop
        if stop is None:
            return ""
        restarts = "" if self._keeper is None else ", also over restarts,"
        return (
            f"EMERGENCY STOP engaged by {stop.source}: {stop.reason}, since {local_time(stop.since)}. "
            f"It holds{restarts} until it is released: {HOW_TO_RELEASE}."
        )

    @property
    def problem(self) -> str:
        """Problems with storing a stop, in sentences; "" without any."""
        doubt = self._stop.doubt if self._stop is not None else ""
        return " ".join(filter(None, [doubt, self._keeper.problem if self._keeper is not None else ""]))

    def remarks(self) -> list[str]:
        """Sentences on an engaged stop, and on refused releases."""
        return [self.sentence(), *(f"Releases of ESTOP {why}: {count}." for why, count in sorted(self.refused.items()))]

    def reports(self, now: float, utime: int) -> list[estop_latch_t]:
        """Return the report due at `now` (s of a monotonic clock), if any."""
        engaged, stored = self._stop is not None, self._keeper is not None and self._keeper.stored
        since, source, reason = self._last
        state = engaged, stored, since
        if state == self._reported and now < self._report_due:
            return []
        self._reported, self._report_due = state, now + REPORT_PERIOD
        about = {"robot_id": self._robot_id, "engaged": engaged, "stored": stored, "since_utime": since}
        return [make(estop_latch_t, utime=utime, **about, source=source, reason=reason)]

    def _objection(self, release: estop_t) -> str:
        """Return why a release is refused; "" if it is accepted.

        This is decided only here: if the bus has a key, unsigned releases are refused.
        """
        return "" if _says_something(release.source) and _says_something(release.reason) else "without name or reason"

    def _engage(self, stop: EngagedStop) -> None:
        self._stop, self._last = stop, (stop.since, stop.source, stop.reason)
        if self._keeper is not None:
            self._keeper.keep(stop)
        self.news.append(self.sentence())

    def _release(self, release: estop_t, utime: int) -> None:
        self._stop, self._last = None, (utime, plain(release.source), plain(release.reason))
        if self._keeper is not None:
            self._keeper.keep(None)
        self.news.append(f"emergency stop released by {self._last[1]}: {self._last[2]}")


def _says_something(text: str) -> bool:
    """Return whether the text has a letter or digit; control characters arrive as question marks."""
    return any(letter.isalnum() for letter in text)
