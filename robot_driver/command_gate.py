"""What may move the motors: the newest recent, valid command, unless something holds them at zero."""

import math
import threading
from collections import Counter
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from cmr.bus import streams
from cmr.msg import motor_feedback_t

# A controller that has been silent for longer is no longer in control (s).
COMMAND_LIFETIME = streams.COMMAND_LIFETIME / 1e6
# After the process was delayed, commands sent meanwhile are still in network buffers. None is accepted for this time
# (s), so that old commands are not executed.
FLUSH_TIME = 0.1
# An emergency stop engaged before this process began is received when it is repeated, and must come before any command.
# Nothing moves for the time of four repetitions at 10 Hz (s).
LISTENING_TIME = 0.4
HELD_UP = 0.25  # s between two turns of the process, beyond which waiting commands count as old

# Why a command was rejected. not_finite: NaN or infinite. out_of_range: beyond the largest. old: decided more than 0.5
# s ago, or not after one already accepted, as in a replayed log. future: decided more than 0.5 s from now, by a
# computer whose clock is wrong. held_up: it may have been queued while this process was delayed. starting: an emergency
# stop might not have been received yet. not_zero: after a stop was released, zero must be commanded before anything
# else.
REASONS = ("not_finite", "out_of_range", "old", "future", "held_up", "starting", "not_zero")


class Stop(Enum):
    """A reason to hold the motors at zero until it is released."""

    BUS = "ESTOP on the bus"
    CONTROLLER = "the controller's own emergency stop"
    BATTERY = "the battery"
    VOLTAGE_UNKNOWN = "a battery that nobody knows to be full enough"

    @property
    def status(self) -> int:
        """The STATUS constant for it."""
        battery = self in (Stop.BATTERY, Stop.VOLTAGE_UNKNOWN)
        return motor_feedback_t.STATUS_BATTERY if battery else motor_feedback_t.STATUS_ESTOP


@dataclass(frozen=True)
class Drive:
    """The required drive of each side, and the STATUS constants on why it must be zero."""

    left: float
    right: float
    status: int


class InForce(NamedTuple):
    """The command in force (duty of each side), its expiry (s), and whether something, or the emergency stop, holds
    it.
    """

    left: float
    right: float
    expires: float
    held: bool
    engaged: bool


class CommandGate:
    """Holds the command in force; thread-safe.

    `now` is the driver's monotonic clock (s), `utime` the time of day as in messages (us). `rejected` counts rejected
    commands by reason; `releases_rejected` counts releases of the emergency stop that were not recent. Until some time
    after `note_listening` only zero is accepted. Commands are duties of each side, or another quantity that drives it;
    those beyond `largest` are rejected.
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
        """Signal that the process is alive, before it handles messages; the first turn requires listening to the
        bus.
        """
        last, self._last_turn = self._last_turn, now
        if last is None:
            self.note_listening(now)
        elif now - last > HELD_UP:
            self.note_held_up(now)

    def note_listening(self, now: float) -> None:
        """Signal that the bus is received from now on: commands are accepted after LISTENING_TIME."""
        with self._lock:
            self._listening_until = now + LISTENING_TIME

    @property
    def needs_zero(self) -> bool:
        """Whether zero must be commanded before any other command, now that nothing holds the motors."""
        return self._zero_first and not self._stops

    def offer(self, decided: int, left: float, right: float, *, now: float, utime: int) -> bool:
        """Offer a command decided at `decided` (us) and received `now`; count and return the reason if it is
        rejected.
        """
        with self._lock:
            self._forget_the_future(utime)
            reason = self._objection(decided, left, right, now, utime)
            if reason:
                self.rejected[reason] += 1
                return False
            counts = decided > self._released_utime  # a zero decided before may arrive after the release
            self._zero_first = bool(self._stops) or (self._zero_first and not counts)
            self._command, self._last_decided = (left, right), decided
            self._expires = now + COMMAND_LIFETIME - max(utime - decided, 0) / 1e6
            return True

    def take_estop(self, engaged: bool, decided: int, *, utime: int) -> bool:
        """Engage or release the bus's emergency stop; return whether the stop is now in the requested state.

        It can be engaged with any stamp; a release must be recent and not older than what engaged it.
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
        """Hold the motors at zero from now on, and drop the command in force."""
        with self._lock:
            if stop not in self._stops:
                self._stops.add(stop)
                self._command, self._zero_first = None, True

    def release(self, stop: Stop) -> None:
        """End one stop. Nothing moves until zero has been commanded; commands during the stop do not count."""
        with self._lock:
            if stop in self._stops:
                self._stops.remove(stop)
                self._command = None

    def note_held_up(self, now: float) -> None:
        """Reject commands for a moment: this process was delayed and does not know their age."""
        with self._lock:
            self._command, self._closed_until = None, now + FLUSH_TIME

    def clear(self) -> None:
        """Drop the command in force: after a reconnection the robot waits for a new one."""
        with self._lock:
            self._command = None

    def remarks(self) -> list[str]:
        """Return sentences on what is waited for, and on rejected commands."""
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
        """Return the drive required at `now`."""
        with self._lock:
            fresh = self._command is not None and now <= self._expires
            status = 0 if fresh else motor_feedback_t.STATUS_COMMAND_STALE
            for stop in self._stops:
                status |= stop.status
            if status or self._command is None:
                return Drive(0.0, 0.0, status)
            return Drive(*self._command, status)

    def in_force(self, now: float) -> InForce:
        """Return the state for the last gate at `now` (s): an expired zero without a command."""
        with self._lock:
            held, engaged = bool(self._stops), Stop.BUS in self._stops
            if self._command is None or held or now > self._expires:
                return InForce(0.0, 0.0, -math.inf, held, engaged)
            return InForce(*self._command, self._expires, held, engaged)

    def _forget_the_future(self, utime: int) -> None:
        """Reset decision times that are in the future, because the time of day was set back."""
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
