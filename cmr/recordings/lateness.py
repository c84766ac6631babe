"""Measure the delay of commands and their loss, from the commands and the duties that a driver applied.

Between decision and motors are the bus and the driver's loop, which takes the newest command at each turn. The applied
duty shows which command was in force: the newest one with this duty. While the driver's ramp keeps the duty away from
all commands, only the time at which the duty begins to change is informative.

A command that is overtaken by a newer one before the driver's next turn is not lost, nor is one that was delayed with
others, or refused, or stopped. It is lost if the driver had a turn at which it should have been available, but applied
an older one, and continued with a newer one that was in time.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.msg import motor_feedback_t
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

FINEST, COARSEST = 1e-5, 1.0 / 127.0  # duty; range of the resolution of controllers
ROUNDING = 0.6  # of the resolution; tolerance between applied and commanded duties
AHEAD = 1e-3  # s by which a duty may be stamped before its command
REACH = 1.0  # s after its stamp within which a command takes effect or never does
IN_TIME = 0.99  # quantile of the delays of effective commands that counts as in time
MARGIN = 2e-3  # s
GAP = 1.7  # times the usual interval of duties: a longer one hides what was applied
# s; lateness may vary with the beat of two clocks: the variation between blocks of this length gives the uncertainty of
# its mean
BLOCK = 5.0
FEWEST = 20  # changes of the duty needed to report lateness
HELD = (
    motor_feedback_t.STATUS_ESTOP
    | motor_feedback_t.STATUS_COMMAND_STALE
    | motor_feedback_t.STATUS_NOT_ARMED
    | motor_feedback_t.STATUS_BATTERY
)
NONE = -1  # no command: no command is in force


@dataclass(frozen=True)
class Lateness:
    """The measured delay of commands in a recording.

    `mean` [s] after their stamps, with its standard deviation `std`, and the standard deviation of individual delays,
    `spread`, over `changes` of the duty. `lost` is the share of the `judged` commands that never took effect.
    """

    mean: float
    std: float
    spread: float
    changes: int
    lost: float
    judged: int

    @property
    def lost_std(self) -> float:
        """The standard deviation of the lost share, computed as if one more were lost and one more not."""
        share = (self.lost * self.judged + 1.0) / (self.judged + 2.0)
        return float(np.sqrt(share * (1.0 - share) / (self.judged + 2.0)))

    @property
    def sentence(self) -> str:
        """A sentence for a person."""
        late = f"Commands take effect {_milliseconds(self.mean)} after their stamp, +- {_milliseconds(self.spread)}"
        if not self.judged:
            return f"{late}."
        share = f"{100.0 * self.lost:.2g} % never took effect" if self.lost else "none was lost"
        return f"{late}; of {self.judged} that can be judged, {share}."


def lateness_of(recording: Recording) -> Lateness | None:
    """Measure the delay of commands; None if the driver does not report duties, or too little changes."""
    duty = recording.duty
    if duty is recording.commands or len(duty) < FEWEST or len(recording.commands) < FEWEST:
        return None
    held = (duty["status"].astype(np.int64) & HELD) != 0
    return measured_lateness(recording.commands, duty, held)


def measured_lateness(commands: Signal, applied: Signal, held: Mask) -> Lateness | None:
    """Measure the delay of `commands` from the duties `applied` (both with fields left, right [duty]).

    `held` marks applied duties that were zero for another reason than a command. None with too few changes.
    """
    matching = _Matching(commands, applied, held)
    taken = matching.taken()
    if len(taken) < FEWEST:
        return None
    numbers, turns = taken.T
    late = matching.time[turns] - matching.stamp[numbers]
    waited = np.maximum(matching.time[turns - 1] - matching.stamp[numbers], 0.0)
    in_time = max(float(np.quantile(waited, IN_TIME)), float(np.quantile(late, 1.0 - IN_TIME))) + MARGIN
    fates = [matching.is_lost(number, in_time) for number in range(len(matching.stamp) - 1)]
    judged = [fate for fate in fates if fate is not None]
    blocks = np.unique((matching.stamp[numbers] / BLOCK).astype(np.int64), return_inverse=True)[1]
    means = np.bincount(blocks, late) / np.bincount(blocks)
    doubt = max(float(np.std(means)), float(np.std(late)) / np.sqrt(len(late) / len(means))) / np.sqrt(len(means))
    share = float(np.mean(judged)) if judged else 0.0
    return Lateness(float(late.mean()), float(doubt), float(late.std()), len(late), share, len(judged))


class _Matching:
    """The command in force at each turn of the driver; times in s since the first command."""

    def __init__(self, commands: Signal, applied: Signal, held: Mask) -> None:
        first = commands.utime[0]
        self.time: Floats = (applied.utime - first) * SECONDS
        self._duty, wanted = (np.stack([of["left"], of["right"]], axis=1) for of in (applied, commands))
        self._near = ROUNDING * _resolution(self._duty)
        changed = np.any(np.abs(np.diff(wanted, axis=0, prepend=wanted[:1] + 1.0)) > 2.0 * self._near, axis=1)
        numbers = np.flatnonzero(changed)
        self.stamp: Floats = (commands.utime[changed] - first) * SECONDS
        self._wanted = wanted[changed]
        self._once = np.diff(numbers, append=numbers[-1:]) == 1  # the next command already has another duty
        longest = GAP * float(np.median(np.diff(self.time)))
        # Turns for which the applied duty is known, and that of the previous turn, too.
        self._known = ~held & (np.diff(self.time, prepend=-np.inf) < longest)
        self._in_force = self._matched(held)

    def taken(self) -> NDArray[np.int64]:
        """Return commands with a known start of effect, and its turn, shape (n, 2)."""
        found = []
        for turn in range(1, len(self.time)):
            before, now = int(self._in_force[turn - 1]), int(self._in_force[turn])
            if before != NONE and now == NONE and self._known[turn]:
                now = self._begun(turn, before)
            if NONE != before < now:
                found.append((now, turn))
        return np.array(found, np.int64).reshape(-1, 2)

    def is_lost(self, number: int, in_time: float) -> bool | None:
        """Return whether a command was lost, given that it should arrive `in_time` [s] after its stamp; None:
        unknown.
        """
        turn = int(np.searchsorted(self.time, self.stamp[number] + in_time))
        if not self._once[number] or turn >= len(self.time) or self.time[turn] >= self.stamp[number + 1]:
            return None
        for later in range(turn, len(self.time)):
            now = self._in_force[later]
            if now == NONE or not self._known[later]:
                return None
            if now >= number:
                # A newer one that should have arrived a turn before was delayed, and perhaps this one with it.
                newer_was_late = later > 0 and self.time[later - 1] >= self.stamp[now] + in_time
                return None if now > number and newer_was_late else bool(now > number)
        return None

    def _matched(self, held: Mask) -> NDArray[np.int64]:
        """Return the number of the command in force at each turn, shape (n,); a command does not return after a newer
        one.
        """
        result = np.full(len(self.time), NONE)
        until = np.searchsorted(self.stamp, self.time + AHEAD, side="right").tolist()
        since = np.searchsorted(self.stamp, self.time - REACH).tolist()
        duties, wanted, near = self._duty.tolist(), self._wanted.tolist(), self._near
        last = 0
        for turn in np.flatnonzero(~held).tolist():
            # A command stays in force as long as nothing else is commanded.
            first = max(min(since[turn], until[turn] - 1), last)
            left, right = duties[turn]
            for number in range(until[turn] - 1, first - 1, -1):
                if abs(wanted[number][0] - left) <= near and abs(wanted[number][1] - right) <= near:
                    result[turn] = last = number
                    break
        return result

    def _begun(self, turn: int, before: int) -> int:
        """Return the command that the ramp begins to follow in a turn, if it is unambiguous; otherwise none."""
        number = before + 1
        if number >= len(self.stamp) or self.stamp[number] > self.time[turn] + AHEAD:
            return NONE
        if number + 1 < len(self.stamp) and self.stamp[number + 1] <= self.time[turn]:
            return NONE
        moved, way = (of - self._duty[turn - 1] for of in (self._duty[turn], self._wanted[number]))
        stays = np.abs(way) <= 2.0 * self._near
        on_its_way = np.where(
            stays, np.abs(moved) <= 2.0 * self._near, (moved * way > 0.0) & (np.abs(moved) < np.abs(way))
        )
        return number if bool(np.all(on_its_way)) else NONE


def _resolution(duty: Floats) -> float:
    """Return the resolution of a controller's duties."""
    steps = np.diff(np.unique(np.abs(duty)))
    steps = steps[steps > FINEST]
    return float(min(max(steps.min(initial=COARSEST), FINEST), COARSEST))


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.1f} ms" if abs(seconds) < 0.01 else f"{1e3 * seconds:.0f} ms"
