"""What a recording says of its own units: wheel speeds beside what the encoders counted."""

import numpy as np
from numpy.typing import NDArray

from cmr.tools.importing.quantities import units

AGREEING = 1.25  # times; wheel radii and ticks per turn of a data sheet are known better, units are further off
FEWEST = 20  # readings between which a wheel was counted to turn
CONTRADICTION = (
    "the wheel speeds (psi_left, psi_right in {unit}) are {ratio:.3g} times what the ticks say "
    "({ticks_per_turn:g} ticks per turn), so one of these units is wrong{remedy}"
)


def speeds_against_ticks(
    by_speed: NDArray[np.float64], by_ticks: NDArray[np.float64], unit: str, ticks_per_turn: float, wheel_radius: float
) -> str:
    """Return how wheel speeds and ticks contradict each other; empty where they agree, or the wheels hardly turn.

    `by_speed` and `by_ticks` are the angles [rad] by which a wheel turned from each reading to the next, by either,
    shape (n,). `unit` is that of the speeds in the mapping, `wheel_radius` [m] the nominal one.
    """
    turning = (by_ticks != 0.0) & (by_speed != 0.0)
    if np.count_nonzero(turning) < FEWEST:
        return ""
    # A median: a counter that jumped, or a speed that was read late, changes nothing.
    ratio = float(np.median(by_speed[turning] / by_ticks[turning]))
    if _agree(ratio):
        return ""
    known = units("wheel_speed", wheel_radius=wheel_radius, full_scale=None)
    others = [other for other, gain in known.items() if _agree(ratio * gain / known[unit])]
    remedy = f"; in {others[0]} they agree: change `unit` in a copy of the mapping" if others else ""
    return CONTRADICTION.format(unit=unit, ratio=ratio, ticks_per_turn=ticks_per_turn, remedy=remedy)


def _agree(ratio: float) -> bool:
    return 1.0 / AGREEING < ratio < AGREEING
