"""What a recording says of its own units: wheel speeds beside what the encoders counted."""

import numpy as np
from numpy.typing import NDArray

from cmr_tools.importing.quantities import TURN, units

AGREEING = 1.25  # times; wheel radii and ticks per turn of a data sheet are known better, units are further off
STRETCH = 10  # ticks, over which angles are compared: within a reading a coarse encoder counts one, or none
FEWEST = 20  # stretches
CONTRADICTION = (
    "the wheel speeds (psi_left, psi_right in {unit}) are {ratio:.2g} times what the ticks say "
    "({ticks_per_turn:g} ticks per turn), so one of these units is wrong{remedy}"
)
REVERSED = "the wheel speeds (psi_left, psi_right) and the ticks have opposite signs: change `sign` of one of them"


def speeds_against_ticks(
    by_speed: NDArray[np.float64], by_ticks: NDArray[np.float64], unit: str, ticks_per_turn: float, wheel_radius: float
) -> str:
    """Return how wheel speeds and ticks contradict each other; empty where they agree, or the wheels hardly turn.

    `by_speed` and `by_ticks` are the angles [rad] by which a wheel turned from each reading to the next, by either,
    shape (n,). `unit` is that of the speeds in the mapping, `wheel_radius` [m] the nominal one.
    """
    stretch = np.floor(np.cumsum(np.abs(by_ticks)) / (STRETCH * TURN / ticks_per_turn)).astype(np.int64)
    turned, counted = (np.bincount(stretch, angles) for angles in (by_speed, by_ticks))
    turning = np.abs(counted) > 0.5 * STRETCH * TURN / ticks_per_turn  # others hold a reversal
    if np.count_nonzero(turning) < FEWEST:
        return ""
    # A median: a counter that jumped, or a speed that was read late, changes nothing.
    ratio = float(np.median(turned[turning] / counted[turning]))
    if _agree(ratio):
        return ""
    if _agree(-ratio):
        return REVERSED
    known = units("wheel_speed", wheel_radius=wheel_radius, full_scale=None)
    others = [other for other, gain in known.items() if _agree(ratio * gain / known[unit])]
    remedy = f"; in {others[0]} they agree: change `unit` in a copy of the mapping" if others else ""
    return CONTRADICTION.format(unit=unit, ratio=ratio, ticks_per_turn=ticks_per_turn, remedy=remedy)


def _agree(ratio: float) -> bool:
    return 1.0 / AGREEING < ratio < AGREEING
