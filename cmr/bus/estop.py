"""The emergency stop: how processes obey and engage it. It stays latched until it is released."""

import time

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.senders import keep
from cmr.bus.streams import ESTOP
from cmr.msg import estop_latch_t, estop_t

HOW_TO_RELEASE = "cmr estop release --reason TEXT, or the page of cmr-view"
RELEASES = 6  # messages per release, because one can be lost
MOST_NAMED = 20  # held robots that are named
LAST_UTIME = 253_370_764_800_000_000  # us; the year 9999


class EmergencyStop:
    """Whether the emergency stop is engaged, by whom and why, from requests on ESTOP and the latches of drivers.

    `latched` holds the last ESTOP_LATCH_N of each robot that its driver holds stopped, up to a limit.
    """

    def __init__(self) -> None:
        self.latched: dict[int, estop_latch_t] = {}
        self._asked = ""

    def handle(self, _utime: int, channel: str, message: Message) -> None:
        """Handle an estop_t or an estop_latch_t; ignore other messages."""
        if channel == ESTOP.name and isinstance(message, estop_t):
            self._asked = f"{message.source}: {message.reason}" if message.engaged else ""
        elif isinstance(message, estop_latch_t):
            if message.engaged:
                keep(self.latched, message.robot_id, message)
            else:
                self.latched.pop(message.robot_id, None)

    @property
    def engaged(self) -> bool:
        """Whether a stop is requested, or any robot is held by one."""
        return bool(self._asked or self.latched)

    def holds(self, robot_id: int) -> bool:
        """Return whether this robot must stay stopped; others may already be released, or were never stopped."""
        return bool(self._asked) or robot_id in self.latched

    @property
    def reason(self) -> str:
        """Who engaged it and why; once nobody requests it any more, also since when and for which robots."""
        return self._asked or self.latched_reason

    @property
    def latched_reason(self) -> str:
        """Who holds which robots, why and since when; of several stops, the oldest. Empty if no robot is held."""
        if not self.latched:
            return ""
        first = min(self.latched.values(), key=lambda latch: latch.since_utime)
        more = len(self.latched) - MOST_NAMED
        ids = ", ".join(map(str, sorted(self.latched)[:MOST_NAMED])) + (f" and {more} more" if more > 0 else "")
        robots = f"robot{'s' if len(self.latched) > 1 else ''} {ids}"
        return f"{first.source}: {first.reason} ({robots}, since {local_time(first.since_utime)})"


class StopButton:
    """The emergency stop button of a process: engage, release, and `due`, which returns the messages to send.

    `handle` receives ESTOP. A stop is repeated until anybody releases it. `stopped` is whether it is engaged, `text` by
    whom and why. Messages name `source`, with `reason` when engaging and `released` when releasing.
    """

    def __init__(self, source: str, reason: str, released: str = "") -> None:
        self.stopped = False
        self.text = ""
        self._source, self._reason, self._released = source, reason, released
        self._engaged_at: int | None = None  # us; None while no stop of ours is in force
        self._releases = 0  # release messages still to be sent
        self._released_at = 0  # us; when the first of them was sent

    def handle(self, _utime: int, channel: str, message: Message) -> None:
        """Handle a message from the bus, including this process's own."""
        if channel != ESTOP.name or not isinstance(message, estop_t):
            return
        if message.engaged:
            # Our own repetitions may still arrive after a release; they must not engage the stop again.
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

        All repetitions carry the time of the first one, so a stop engaged after it stays engaged.
        """
        self._engaged_at, self._releases = None, RELEASES
        self.stopped, self.text = False, ""

    def due(self, utime: int) -> estop_t | None:
        """Return the message that is due now, if any."""
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
