"""What the last gate lets pass to the motors, and when it has to stop them by itself. It does nothing else."""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from robot_driver.gate.messages import SECOND, Reason, Word
from robot_driver.gate.wire import Wire

Channels = tuple[float, float]  # duty of the first and of the second channel of the controller

LIFETIME = SECOND // 2  # ns for which a command is in force, at most
LATE = SECOND // 10  # ns after which what was sent is not what is wanted any more
FUTURE = SECOND // 1000  # ns
SILENCE = SECOND // 4  # ns without a word of the driver, while the motors turn
UNSERVED = 2 * SECOND // 5  # ns without a duty, while the motors turn
SLACK = 3 * SECOND // 100  # ns beyond a cycle, in which the driver would stop the motors itself
ATTENDED = SECOND // 20  # ns since a word of the driver, in which it is there to send zero itself
CONFIRMING = SECOND // 10  # ns that it has for that
ROUNDING = 0.00051  # duty; half of the coarsest step of a controller, and a little
STANDSTILL = 0.0, 0.0


class Mounting(NamedTuple):
    """How the two channels of a controller are mounted: which is left, and which side turns backward."""

    swap: bool = False
    invert_left: bool = False
    invert_right: bool = False

    def channels(self, left: float, right: float) -> Channels:
        """Return the duties of the channels that drive the sides with these."""
        left, right = -left if self.invert_left else left, -right if self.invert_right else right
        return (right, left) if self.swap else (left, right)


class Guard:
    """Judges each word of the driver; times are ns on one steady clock.

    `cycle` (ns) is how often the driver serves the motors. `is_latched` says whether the disk holds an emergency stop:
    then the motors are held until it does so no more, or until the driver has first confirmed it and then released it.
    """

    def __init__(self, wire: Wire, mounting: Mounting, cycle: int, is_latched: Callable[[], bool]) -> None:
        self.interventions = 0
        self._wire, self._mounting, self._cycle, self._is_latched = wire, mounting, cycle, is_latched
        self.latched = is_latched()
        self._engaged = False  # the emergency stop, by a word of the driver
        self._held = True
        self._heard = self._served = 0  # when there was a word, and a duty
        self._expires = 0  # when the command in force ends, or ended
        self._recent: deque[tuple[int, Channels]] = deque(maxlen=64)  # commands, and when each was heard first
        self._zero_first = False
        self._confirm_by: int | None = None  # when the driver has to have sent zero itself
        self.opened()

    def opened(self) -> None:
        """Begin with a port behind which nothing is known but that the driver sends zero first."""
        self._armed = 0
        self._duty: Channels = STANDSTILL
        self._confirm_by = None

    @property
    def moving(self) -> bool:
        """Whether the last duty that passed was not zero."""
        return self._duty != STANDSTILL

    def take(self, word: Word, now: int) -> Reason | None:
        """Take the command in force from a word; return why not."""
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
        """Return why what a word wants written must not be; None where it may, which then counts as written."""
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
        """Return why the motors must not be driven like this."""
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
        """Return whether each channel's duty is between the last one, zero and the commands of the last moment."""
        for channel, value in enumerate(duty):
            ends = [0.0, self._duty[channel], *(command[channel] for _, command in self._recent)]
            if not min(ends) - ROUNDING <= value <= max(ends) + ROUNDING:
                return False
        return True

    def stop_due(self) -> int | None:
        """Return when the gate has to stop the motors, if nothing changes; None when they stand."""
        if self._confirm_by is not None or not self.moving:
            return self._confirm_by
        return min(self._heard + SILENCE, self._served + UNSERVED, self._expires + self._cycle + SLACK)

    def is_attended(self, now: int) -> bool:
        """Whether it is enough to send zero once: the driver is there to do so, too, and to see it acknowledged."""
        return self._confirm_by is None and now - self._heard < ATTENDED

    def note_intervention(self, confirm_by: int | None = None) -> None:
        """Note that the gate stopped the motors itself: the driver has to send zero first, where given by then."""
        self.interventions += 1
        self._duty = STANDSTILL
        self._zero_first, self._confirm_by = True, confirm_by
