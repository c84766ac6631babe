"""Rules of the last gate: which requests may pass to the motors, and when the gate must stop them itself. Nothing
else.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from robot_driver.gate.messages import SECOND, Reason, Word
from robot_driver.gate.wire import Wire

Channels = tuple[float, float]  # duty of the first and of the second channel of the controller

LIFETIME = SECOND // 2  # ns for which a command is in force, at most
LATE = SECOND // 10  # ns after which a message is out of date
FUTURE = SECOND // 1000  # ns
SILENCE = SECOND // 4  # ns without a message of the driver, while the motors turn
UNSERVED = 2 * SECOND // 5  # ns without a duty, while the motors turn
SLACK = 3 * SECOND // 100  # ns beyond a cycle, within which the driver would stop the motors itself
ATTENDED = SECOND // 20  # ns since a message of the driver, within which it is able to send zero itself
CONFIRMING = SECOND // 10  # ns that it has to do so
ROUNDING = 0.00051  # duty; half of the coarsest step of a controller, plus a margin
STANDSTILL = 0.0, 0.0


class Mounting(NamedTuple):
    """How the two channels of a controller are mounted: which is left, and which side turns backward."""

    swap: bool = False
    invert_left: bool = False
    invert_right: bool = False

    def channels(self, left: float, right: float) -> Channels:
        """Return the duties of the channels for these duties of the sides."""
        left, right = -left if self.invert_left else left, -right if self.invert_right else right
        return (right, left) if self.swap else (left, right)


class Guard:
    """Judges each message of the driver; times are ns on one steady clock.

    `cycle` (ns) is the driver's period of serving the motors. `is_latched` tells whether the disk holds an emergency
    stop: then the motors are held until that has gone, or until the driver has first confirmed and then released it.
    """

    def __init__(self, wire: Wire, mounting: Mounting, cycle: int, is_latched: Callable[[], bool]) -> None:
        self.interventions = 0
        self._wire, self._mounting, self._cycle, self._is_latched = wire, mounting, cycle, is_latched
        self.latched = is_latched()
        self._engaged = False  # the emergency stop, by a message of the driver
        self._held = True
        self._heard = self._served = 0  # times of the last message and the last duty
        self._expires = 0  # when the command in force ends, or ended
        self._recent: deque[tuple[int, Channels]] = deque(maxlen=64)  # commands, and when each was first received
        self._zero_first = False
        self._confirm_by: int | None = None  # deadline for the driver to send zero itself
        self.opened()

    def opened(self) -> None:
        """Reset for a newly opened port: its state is unknown, so the driver must send zero first."""
        self._armed = 0
        self._duty: Channels = STANDSTILL
        self._confirm_by = None

    @property
    def moving(self) -> bool:
        """Whether the last duty that passed was not zero."""
        return self._duty != STANDSTILL

    def take(self, word: Word, now: int) -> Reason | None:
        """Store the command in force of a message; return the reason if it is refused."""
        if not 0 <= now + FUTURE - word.sent <= LATE + FUTURE:
            return Reason.LATE
        held = word.held or word.engaged
        sane = all(math.isfinite(duty) and abs(duty) <= 1.0 for duty in (word.left, word.right))
        if not sane or word.expires > word.sent + LIFETIME + FUTURE:
            return Reason.INSANE
        self._heard = now
        if self.latched and not word.engaged and (self._engaged or not self._is_latched()):
            self.latched = False
        self._engaged = word.engaged
        self._held = held or self.latched
        if self._held:
            self._expires = min(self._expires, now)
            self._recent.clear()
            return None
        self._expires = word.expires
        command = self._mounting.channels(word.left, word.right)
        if not self._recent or self._recent[-1][1] != command:
            self._recent.append((now, command))
        while len(self._recent) > 1 and self._recent[1][0] < now - LATE:
            self._recent.popleft()
        return None

    def judge(self, word: Word, now: int) -> Reason | None:
        """Return the reason for refusing a message's write request; None if it is permitted, and then counts as
        written.
        """
        requests = self._wire.read(word.data)
        if requests is None:
            return Reason.FOREIGN
        duties = [request.duty for request in requests if request.duty is not None]
        for duty in duties:
            if duty != STANDSTILL and (reason := self._objection(duty, word, now)) is not None:
                return reason
        for request in requests:
            self._armed |= request.arms
        if duties:
            self._duty, self._served = duties[-1], now
            if not self.moving:
                self._zero_first, self._confirm_by = False, None
        return None

    def _objection(self, duty: Channels, word: Word, now: int) -> Reason | None:
        """Return the objection to driving the motors with a duty, None if there is none."""
        if self._held:
            return Reason.HELD
        if now - word.sent > LATE:
            return Reason.LATE
        if now > self._expires + self._cycle:
            return Reason.STALE
        if self._armed & self._wire.units != self._wire.units:
            return Reason.UNARMED
        if self._zero_first:
            return Reason.ZERO_FIRST
        return None if self._is_on_its_way(duty) else Reason.BEYOND

    def _is_on_its_way(self, duty: Channels) -> bool:
        """Return whether each channel's duty is between the last one, zero and the recent commands."""
        for channel, value in enumerate(duty):
            ends = [0.0, self._duty[channel], *(command[channel] for _, command in self._recent)]
            if not min(ends) - ROUNDING <= value <= max(ends) + ROUNDING:
                return False
        return True

    def stop_due(self) -> int | None:
        """Return when the gate must stop the motors, if nothing changes; None when they stand."""
        if self._confirm_by is not None or not self.moving:
            return self._confirm_by
        return min(self._heard + SILENCE, self._served + UNSERVED, self._expires + self._cycle + SLACK)

    def is_attended(self, now: int) -> bool:
        """Return whether one zero suffices, because the driver is alive to send zero as well, and to see it
        acknowledged.
        """
        return self._confirm_by is None and now - self._heard < ATTENDED

    def note_intervention(self, confirm_by: int | None = None) -> None:
        """Record that the gate stopped the motors: the driver must send zero first, by the time given, if any."""
        self.interventions += 1
        self._duty = STANDSTILL
        self._zero_first, self._confirm_by = True, confirm_by
