"""Commands within a step of the observer: one in the middle splits the step; compiled into its loops.

A command's row of a profile is the share of the step at which it arrives, or 0, the duties before it, and those after
it.
"""

import numpy as np
from numpy.typing import NDArray

from cmr.model.compiled import inlined
from cmr.model.extended.compose import COMMAND_LEFT, COMMAND_RIGHT, DT, LANES, LEFT_BEFORE, RIGHT_BEFORE
from cmr.model.extended.stepping import prepare_each
from cmr.model.observer.helpers import (
    BASE_WIDTH,
    CURVE,
    CURVE_BEFORE,
    CURVING,
    GROWTH,
    GROWTH_BEFORE,
    K2_OVER_K3,
    MEAN,
    MEAN_BEFORE,
    PART,
    RADIUS_LEFT,
    RADIUS_RIGHT,
    SHARE,
    SLIP_TIME,
    SPLIT_AT,
    TWELFTH,
    Floats,
)

Indices = NDArray[np.int64]

# s^2; a change of duty by D within a step dt is averaged if D dt^2 is smaller, and otherwise splits the step. For a
# change at the share s of the step, the mean causes an error of a wheel's angle of k2_over_k3 D dt^2 s (1 - s) / 2:
# 3e-5 rad with a usual motor.
SMALL = 2e-6
SPLIT, FIRST, LAST = 0, 1, 3  # columns of a profile of commands; left, followed by right


@inlined
def known(duty: float, held: float) -> float:
    """Return a duty, or if it is unknown, as before the first command, the one that held the speed at the start."""
    return held if np.isnan(duty) else duty


def split_steps(profiles: Floats, dt: float) -> NDArray[np.uint8]:
    """Return for each step (steps,) of dt [s] whether it is split, from the `profiles` of commands (P, steps, 5).

    It is split for all candidates if any of them needs it: otherwise small differences between candidates, from which
    slopes are computed, would show which of them were split.
    """
    splits = np.zeros(profiles.shape[1], np.bool_)
    for duties in profiles:  # one by one: a drive of hours has many steps
        change = np.abs(duties[:, LAST : LAST + 2] - duties[:, FIRST : FIRST + 2])
        small = np.all(change * dt**2 <= SMALL, axis=1)  # false for unknown duties, as before the first command
        splits |= (duties[:, SPLIT] > 0.0) & ~small
    return splits.astype(np.uint8)


@inlined
def command(here: Floats, commands: Floats, profile: Indices, step: int, lanes: int) -> bool:
    """Set the commands of each lane for a whole step, means if they change in it; return whether any does."""
    comes = False
    for i in range(lanes):
        duties = commands[profile[i], step]
        share = duties[SPLIT]
        comes |= share > 0.0
        left = duties[LAST] - share * (duties[LAST] - duties[FIRST]) if share > 0.0 else duties[LAST]
        right = duties[LAST + 1] - share * (duties[LAST + 1] - duties[FIRST + 1]) if share > 0.0 else duties[LAST + 1]
        here[COMMAND_LEFT + i] = known(left, here[LEFT_BEFORE + i])
        here[COMMAND_RIGHT + i] = known(right, here[RIGHT_BEFORE + i])
    return comes


@inlined
def command_first_part(here: Floats, own: Floats, commands: Floats, profile: Indices, step: int, lanes: int) -> bool:
    """Set the commands of the first part of a split step; return whether its split equals the last one.

    Lanes without a command within the step take it in two halves.
    """
    same = True
    for i in range(LANES):
        duties = commands[profile[min(i, lanes - 1)], step]
        share = duties[SPLIT] if duties[SPLIT] > 0.0 else 0.5
        same &= share == own[SHARE + i]
        own[SHARE + i] = share
        here[COMMAND_LEFT + i] = known(duties[FIRST], here[LEFT_BEFORE + i])
        here[COMMAND_RIGHT + i] = known(duties[FIRST + 1], here[RIGHT_BEFORE + i])
    return same


@inlined
def command_last_part(here: Floats, commands: Floats, profile: Indices, step: int, lanes: int) -> None:
    """Set the commands of the last part of a split step."""
    for i in range(LANES):
        duties = commands[profile[min(i, lanes - 1)], step]
        here[COMMAND_LEFT + i] = known(duties[LAST], here[LEFT_BEFORE + i])
        here[COMMAND_RIGHT + i] = known(duties[LAST + 1], here[RIGHT_BEFORE + i])


@inlined
def bend(newest: Floats, own: Floats, commands: Floats, profile: Indices, step: int, lanes: int, dt: float) -> None:
    """Bend the stored yaw rate within a step in which a command was averaged.

    The mean command leads to the same end of the step.
    """
    for i in range(lanes):
        duties = commands[profile[i], step]
        share = duties[SPLIT]
        left = own[RADIUS_LEFT + i] * (duties[LAST] - duties[FIRST])
        right = own[RADIUS_RIGHT + i] * (duties[LAST + 1] - duties[FIRST + 1])
        change = own[K2_OVER_K3 + i] * (right - left) / own[BASE_WIDTH + i] if share > 0.0 else 0.0
        slips, change = own[SLIP_TIME + i] * change, dt * change * share * (1.0 - share)
        mean, growth = newest[MEAN + i] - 0.5 * change, newest[GROWTH + i]
        newest[SPLIT_AT + i] = share
        newest[MEAN_BEFORE + i] = mean + (1.0 - share) * (slips - 0.5 * growth)
        newest[GROWTH_BEFORE + i] = share * growth - change
        newest[MEAN + i] = mean - share * (slips - 0.5 * growth)
        newest[GROWTH + i] = (1.0 - share) * growth + change
        curve, rest = own[CURVING + i], 1.0 - share
        newest[MEAN_BEFORE + i] += (0.25 * rest * rest + TWELFTH * (share * share - 1.0)) * curve
        newest[MEAN + i] += (0.25 * share * share + TWELFTH * (rest * rest - 1.0)) * curve
        newest[GROWTH_BEFORE + i] -= share * rest * curve
        newest[GROWTH + i] += share * rest * curve
        newest[CURVE_BEFORE + i], newest[CURVE + i] = share * share * curve, rest * rest * curve


@inlined
def prepare_parts(here: Floats, own: Floats, dt: float, before: Floats, behind: Floats) -> None:
    """Compute the coefficients of a block for the first parts of steps of dt, up to SHARE, and for the rest.

    Numbers are copied individually here and below: slice assignment takes seconds to compile.
    """
    parts = own[PART : PART + LANES]
    for i in range(LANES):
        parts[i] = (1.0 - own[SHARE + i]) * dt
    prepare_each(here, parts)
    for i in range(len(behind)):
        behind[i] = here[DT + i]
    for i in range(LANES):
        parts[i] = own[SHARE + i] * dt
    prepare_each(here, parts)
    for i in range(len(before)):
        before[i] = here[DT + i]


@inlined
def put_coefficients(kept: Floats, here: Floats) -> None:
    """Copy stored coefficients back to their block."""
    for i in range(len(kept)):
        here[DT + i] = kept[i]
