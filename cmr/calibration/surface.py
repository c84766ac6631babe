"""What the grid's error surface alone tells of the parameters, where the model does not explain the path.

A refinement with its standard deviations supposes that the model is right. Where it is not, the least that can be said
of a parameter is within which values the path error is hardly larger than at best.
"""

from collections.abc import Sequence

import numpy as np

from cmr.calibration.grid import Grid
from cmr.estimation.estimates import Estimate
from cmr.model.parameters import DEFINITIONS
from cmr.recordings.signal import Floats

NAMES = ("k2_over_k3", "k1", "base_width")  # the axes of a grid
ALIKE = 1.1  # times the least path error, up to which errors count as alike
AT_THE_EDGE = (
    "the error surface does not determine it: from {low:.4g} to {high:.4g} {unit}, the edge of the grid, the path "
    "error is within 10 % of the least, which is at {best:.4g}"
)


def told_by_surface(grid: Grid, names: Sequence[str]) -> tuple[dict[str, Estimate], dict[str, str]]:
    """Return the estimates that the surface tells, and why it does not tell the others, both by name.

    A value is that of the least error. Its standard deviation is half the range in which errors are alike, whatever the
    other two parameters are; where that reaches the edge of the grid, nobody knows how far it goes.
    """
    estimates, untold = {}, {}
    for name in names:
        values: Floats = getattr(grid, name)
        others = tuple(axis for axis, other in enumerate(NAMES) if other != name)
        alike = np.sqrt(grid.mean_square.min(axis=others)) <= ALIKE * np.sqrt(grid.mean_square.min())
        low, high = values[alike].min(), values[alike].max()
        if alike[0] or alike[-1]:
            unit = DEFINITIONS[name].unit
            untold[name] = AT_THE_EDGE.format(low=low, high=high, unit=unit, best=grid.best[name])
        else:
            estimates[name] = Estimate(grid.best[name], max(float(high - low), _step(values, grid.best[name])) / 2.0)
    return estimates, untold


def _step(values: Floats, at: float) -> float:
    """Return how far apart the grid's values are around one of them."""
    index = int(np.searchsorted(values, at))
    return float(values[min(index + 1, len(values) - 1)] - values[max(index - 1, 0)])
