"""What may move the motors: the newest fresh, sane command, unless the emergency stop is engaged."""

import math
import threading
from collections import Counter
from dataclasses import dataclass

from cmr.msg import motor_feedback_t

COMMAND_LIFETIME = 0.5  # s; a controller that has been silent for longer is not in control any more
# After the process was held up, commands that were sent meanwhile still come out of the network's buffers. None is
# taken for this time (s), or the robot would repeat what was wanted of it long ago.
FLUSH_TIME = 0.1

# Why a command was not taken. not_finite: NaN or infinite. out_of_range: beyond [-1, 1]. old: decided before, or
# at the same time as, one already taken. held_up: it may have waited while this process was held up.
REASONS = ("not_finite", "out_of_range", "old", "held_up")


@dataclass(frozen=True)
class Drive:
    """What the motors are to do now: duty of each side, and the STATUS constants that say why it may be zero."""

    left: float
    right: float
    status: int


class CommandGate:
    """Holds the command in force; safe to use from several threads.

    Times are seconds of the driver's own monotonic clock. `rejected` counts commands not taken, by reason.
    """

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._command: tuple[float, float] | None = None
        self._received = 0.0
        self._last_utime: int | None = None
        self._engaged = False
        self._closed_until = -math.inf

    def offer(self, utime: int, left: float, right: float, now: float) -> None:
        """Take a command that was decided at `utime` and has arrived `now`, or count why not."""
        with self._lock:
            reason = self._objection(utime, left, right, now)
            if reason:
                self.rejected[reason] += 1
                return
            self._command, self._received, self._last_utime = (left, right), now, utime

    def set_estop(self, engaged: bool) -> None:
        """Engage or release the emergency stop; after a release the motors wait for a new command."""
        with self._lock:
            self._engaged = engaged
            self._command = None if engaged else self._command

    def note_held_up(self, now: float) -> None:
        """Take no command for a moment: this process has just woken up and does not know how old they are."""
        with self._lock:
            self._command, self._closed_until = None, now + FLUSH_TIME

    def clear(self) -> None:
        """Forget the command in force: after a new connection the robot waits for a new one."""
        with self._lock:
            self._command = None

    def drive(self, now: float) -> Drive:
        """Return what the motors are to do at `now`."""
        with self._lock:
            fresh = self._command is not None and now - self._received <= COMMAND_LIFETIME
            status = motor_feedback_t.STATUS_ESTOP if self._engaged else 0
            status |= 0 if fresh else motor_feedback_t.STATUS_COMMAND_STALE
            if status or self._command is None:
                return Drive(0.0, 0.0, status)
            return Drive(*self._command, status)

    def _objection(self, utime: int, left: float, right: float, now: float) -> str:
        if not (math.isfinite(left) and math.isfinite(right)):
            return "not_finite"
        if max(abs(left), abs(right)) > 1.0:
            return "out_of_range"
        if self._last_utime is not None and utime <= self._last_utime:
            return "old"
        return "held_up" if now < self._closed_until else ""
