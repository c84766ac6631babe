"""What may move the motors: the newest fresh, sane command, unless something holds them at zero."""

import math
import threading
from collections import Counter
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from cmr.bus import streams
from cmr.msg import motor_feedback_t

# A controller that has been silent for longer is not in control any more (s).
COMMAND_LIFETIME = streams.COMMAND_LIFETIME / 1e6
# After the process was held up, commands that were sent meanwhile still come out of the network's buffers. None is
# taken for this time (s), or the robot would repeat what was wanted of it long ago.
FLUSH_TIME = 0.1
# An emergency stop that was engaged before this process began is heard when it is repeated, which a command must not
# overtake. Nothing moves for as long as four repetitions take at 10 Hz (s).
LISTENING_TIME = 0.4
HELD_UP = 0.25  # s between two turns of the process, after which waiting commands count as old

# Why a command was not taken. not_finite: NaN or infinite. out_of_range: beyond the largest. old: decided more than 0.5
# s ago, or not after one already taken, as in a log that is replayed. future: decided more than 0.5 s from now, by a
# computer whose clock is wrong. held_up: it may have waited while this process was held up. starting: an emergency
# stop might not have been heard yet. not_zero: after a stop was released, zero must be commanded before anything else.
REASONS = ("not_finite", "out_of_range", "old", "future", "held_up", "starting", "not_zero")


class Stop(Enum):
    """What can hold the motors at zero until it is released."""

    BUS = "ESTOP on the bus"
    CONTROLLER = "the controller's own emergency stop"
    BATTERY = "the battery"
    VOLTAGE_UNKNOWN = "a battery that nobody knows to be full enough"

    @property
    def status(self) -> int:
        """The STATUS constant that reports it."""
        battery = self in (Stop.BATTERY, Stop.VOLTAGE_UNKNOWN)
        return motor_feedback_t.STATUS_BATTERY if battery else motor_feedback_t.STATUS_ESTOP


@dataclass(frozen=True)
class Drive:
    """What the motors are to do now: the drive of each side, and the STATUS constants that say why it must be zero."""

    left: float
    right: float
    status: int


class InForce(NamedTuple):
    """The command in force (duty of each side), until when (s), and whether something or the emergency stop holds."""

    left: float
    right: float
    expires: float
    held: bool
    engaged: bool


class CommandGate:
    """Holds the command in force; safe to use from several threads.

    `now` is the driver's own steady clock (s), `utime` the time of day as in messages (us). `rejected` counts
    commands not taken, by reason; `releases_rejected` releases of the emergency stop that were not recent. Closed to
    all but zero until some time after `note_listening`.
    Commands are duties of each side, or whatever else drives it; beyond `largest` they are not taken.
    """

    def __init__(self, largest: float = 1.0) -> None:
        self.rejected: Counter[str] = Counter()
        self.releases_rejected = 0
        self._largest = largest
        self._last_turn: float | None = None
        self._lock = threading.Lock()
        self._command: tuple[float, float] | None = None
        self._expires = -math.inf
        self._last_decided: int | None = None
        self._stops: set[Stop] = set()
        self._engaged_utime = self._released_utime = 0
        self._zero_first = False
        self._listening_until = math.inf
        self._closed_until = -math.inf

    def note_turn(self, now: float) -> None:
        """Note that the process is alive, before it handles messages; at the first turn it has to hear the bus."""
        last, self._last_turn = self._last_turn, now
        if last is None:
            self.note_listening(now)
        elif now - last > HELD_UP:
            self.note_held_up(now)

    def note_listening(self, now: float) -> None:
        """Note that from now on the bus is heard: commands are taken when it has been for LISTENING_TIME."""
        with self._lock:
            self._listening_until = now + LISTENING_TIME

    @property
    def needs_zero(self) -> bool:
        """Whether zero must be commanded before anything else is taken, now that nothing holds the motors."""
        return self._zero_first and not self._stops

    def offer(self, decided: int, left: float, right: float, *, now: float, utime: int) -> bool:
        """Take a command that was decided at `decided` (us) and has arrived `now`, or count why not; return which."""
        with self._lock:
            self._forget_the_future(utime)
            reason = self._objection(decided, left, right, now, utime)
            if reason:
                self.rejected[reason] += 1
                return False
            counts = decided > self._released_utime  # a zero that was decided before may come after the release
            self._zero_first = bool(self._stops) or (self._zero_first and not counts)
            self._command, self._last_decided = (left, right), decided
            self._expires = now + COMMAND_LIFETIME - max(utime - decided, 0) / 1e6
            return True

    def take_estop(self, engaged: bool, decided: int, *, utime: int) -> bool:
        """Engage or release the emergency stop of the bus; return whether it is engaged, or released, by now.

        It is engaged whatever the time; a release must be recent and not older than what engaged it.
        """
        with self._lock:
            self._forget_the_future(utime)
        if engaged:
            self._engaged_utime = max(self._engaged_utime, min(decided, utime))
            self.hold(Stop.BUS)
        elif Stop.BUS in self._stops:
            if decided < self._engaged_utime or abs(utime - decided) > streams.COMMAND_LIFETIME:
                self.releases_rejected += 1
                return False
            self._released_utime = decided
            self.release(Stop.BUS)
        return True

    def hold(self, stop: Stop) -> None:
        """Hold the motors at zero from now on; the command in force is forgotten."""
        with self._lock:
            if stop not in self._stops:
                self._stops.add(stop)
                self._command, self._zero_first = None, True

    def release(self, stop: Stop) -> None:
        """End one stop. Nothing moves before zero has been commanded; what was commanded meanwhile does not count."""
        with self._lock:
            if stop in self._stops:
                self._stops.remove(stop)
                self._command = None

    def note_held_up(self, now: float) -> None:
        """Take no command for a moment: this process has just woken up and does not know how old they are."""
        with self._lock:
            self._command, self._closed_until = None, now + FLUSH_TIME

    def clear(self) -> None:
        """Forget the command in force: after a new connection the robot waits for a new one."""
        with self._lock:
            self._command = None

    def remarks(self) -> list[str]:
        """Return, in sentences, what is waited for and what was not taken."""
        remarks = ["Waiting for zero to be commanded; nothing else moves the motors before."] if self.needs_zero else []
        if self.rejected:
            counts = ", ".join(f"{reason} {count}" for reason, count in sorted(self.rejected.items()))
            remarks.append(f"Commands not taken: {counts}.")
        if self.releases_rejected:
            remarks.append(
                f"Releases of ESTOP not taken: {self.releases_rejected}, not made within the last 0.5 s. "
                f"Keep the clocks of all computers together."
            )
        return remarks

    def drive(self, now: float) -> Drive:
        """Return what the motors are to do at `now`."""
        with self._lock:
            fresh = self._command is not None and now <= self._expires
            status = 0 if fresh else motor_feedback_t.STATUS_COMMAND_STALE
            for stop in self._stops:
                status |= stop.status
            if status or self._command is None:
                return Drive(0.0, 0.0, status)
            return Drive(*self._command, status)

    def in_force(self, now: float) -> InForce:
        """Return what the last gate has to know at `now` (s): zero that has expired where there is no command."""
        with self._lock:
            held, engaged = bool(self._stops), Stop.BUS in self._stops
            if self._command is None or held or now > self._expires:
                return InForce(0.0, 0.0, -math.inf, held, engaged)
            return InForce(*self._command, self._expires, held, engaged)

    def _forget_the_future(self, utime: int) -> None:
        """Forget when what was decided last where that is still to come: the time of day was set back."""
        latest = utime + streams.COMMAND_LIFETIME
        if self._last_decided is not None and self._last_decided > latest:
            self._last_decided = None
        self._engaged_utime = self._engaged_utime if self._engaged_utime <= latest else 0
        self._released_utime = self._released_utime if self._released_utime <= latest else 0

    def _objection(self, decided: int, left: float, right: float, now: float, utime: int) -> str:
        if not (math.isfinite(left) and math.isfinite(right)):
            return "not_finite"
        if max(abs(left), abs(right)) > self._largest:
            return "out_of_range"
        if utime - decided > streams.COMMAND_LIFETIME or (
            self._last_decided is not None and decided <= self._last_decided
        ):
            return "old"
        if decided - utime > streams.COMMAND_LIFETIME:
            return "future"
        if now < self._closed_until:
            return "held_up"
        if (left, right) == (0.0, 0.0):
            return ""
        if now < self._listening_until:
            return "starting"
        return "not_zero" if self._zero_first and not self._stops else ""
