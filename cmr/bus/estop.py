"""The emergency stop as every process obeys it, and as one engages it: latched until it is released."""

import time

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.senders import keep
from cmr.bus.streams import ESTOP
from cmr.msg import estop_latch_t, estop_t

HOW_TO_RELEASE = "cmr estop release --reason TEXT, or the page of cmr-view"
RELEASES = 6  # messages, as one can be lost
MOST_NAMED = 20  # robots that are held
LAST_UTIME = 253_370_764_800_000_000  # us; the year 9999


class EmergencyStop:
    """Whether the emergency stop is engaged, and by whom and why: as it is asked for on ESTOP, and as drivers keep it.

    `latched` holds the last ESTOP_LATCH_N of each robot whose driver holds it, of so many that there can be.
    """

    def __init__(self) -> None:
        self.latched: dict[int, estop_latch_t] = {}
        self._asked = ""

    def handle(self, _utime: int, channel: str, message: Message) -> None:
        """Take an estop_t or an estop_latch_t; other messages are passed over."""
        if channel == ESTOP.name and isinstance(message, estop_t):
            self._asked = f"{message.source}: {message.reason}" if message.engaged else ""
        elif isinstance(message, estop_latch_t):
            if message.engaged:
                keep(self.latched, message.robot_id, message)
            else:
                self.latched.pop(message.robot_id, None)

    @property
    def engaged(self) -> bool:
        """Whether it is asked for, or any robot is held by it."""
        return bool(self._asked or self.latched)

    def holds(self, robot_id: int) -> bool:
        """Return whether a robot must stand: others may have been released already, or never been stopped."""
        return bool(self._asked) or robot_id in self.latched

    @property
    def reason(self) -> str:
        """By whom and why it is engaged; where nobody asks for it any more, also since when and for which robots."""
        return self._asked or self.latched_reason

    @property
    def latched_reason(self) -> str:
        """By whom, why and since when robots are held, and which; of several the longest held. Empty if none is."""
        if not self.latched:
            return ""
        first = min(self.latched.values(), key=lambda latch: latch.since_utime)
        more = len(self.latched) - MOST_NAMED
        ids = ", ".join(map(str, sorted(self.latched)[:MOST_NAMED])) + (f" and {more} more" if more > 0 else "")
        robots = f"robot{'s' if len(self.latched) > 1 else ''} {ids}"
        return f"{first.source}: {first.reason} ({robots}, since {local_time(first.since_utime)})"


class StopButton:
    """The emergency stop as a process engages and releases it for a person: `due` returns what is to be sent.

    `handle` hears ESTOP. A stop is repeated until anybody releases it. `stopped` says whether it is engaged, and
    `text` by whom and why. `source` gives `reason` where it engages the stop, and `released` where it releases it.
    """

    def __init__(self, source: str, reason: str, released: str = "") -> None:
        self.stopped = False
        self.text = ""
        self._source, self._reason, self._released = source, reason, released
        self._engaged_at: int | None = None  # us; None while no stop of ours is in force
        self._releases = 0  # that are still to be sent
        self._released_at = 0  # us; when the first of them was sent

    def handle(self, _utime: int, channel: str, message: Message) -> None:
        """Take a message from the bus, our own among them."""
        if channel != ESTOP.name or not isinstance(message, estop_t):
            return
        if message.engaged:
            # Our own repetitions come back even after we have released; they engage nothing again.
            if message.source != self._source or self._engaged_at is not None:
                self.stopped, self.text = True, f"{message.source}: {message.reason}"
            return
        if self._engaged_at is None or message.utime >= self._engaged_at:
            self.stopped, self.text, self._engaged_at = False, "", None

    def stop(self, utime: int) -> None:
        """Engage the emergency stop."""
        self._engaged_at, self._releases = utime, 0
        self.stopped, self.text = True, f"{self._source}: {self._reason}"

    def release(self) -> None:
        """Release the emergency stop, whoever engaged it.

        Each repetition has the moment of the first, so that a stop that is engaged after it stays engaged.
        """
        self._engaged_at, self._releases = None, RELEASES
        self.stopped, self.text = False, ""

    def due(self, utime: int) -> estop_t | None:
        """Return what is to be sent now, if anything is."""
        if self._engaged_at is not None:
            return self._made(utime, True)
        if not self._releases:
            return None
        self._released_at = utime if self._releases == RELEASES else self._released_at
        self._releases -= 1
        return self._made(self._released_at, False)

    def _made(self, utime: int, engaged: bool) -> estop_t:
        reason = self._reason if engaged else self._released
        return make(estop_t, utime=utime, engaged=engaged, source=self._source, reason=reason)


def local_time(utime: int) -> str:
    """Return a time of day [us since the Unix epoch] with its date, as this computer's clock shows it."""
    if not 0 <= utime < LAST_UTIME:
        return "a time that no clock shows"
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(utime / 1e6))
