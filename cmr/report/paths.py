"""Draw the paths of a real and a simulated robot over the floor, in the common style of CMR."""

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Path: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64]]  # x, y [m], each (n,); NaN where it is interrupted


def draw_paths(axes: "Axes", real: Path, simulated: Path, starts: Path, title: str) -> None:
    """Draw both paths, and where the real robot started."""
    axes.plot(*real, color=REAL_COLOUR, linewidth=4.0, label="real robot")
    axes.plot(*simulated, color=TWIN_COLOUR, linewidth=1.4, label="simulated robot")
    axes.plot(*starts, "o", color="black", markersize=5, label="start")
    axes.set_title(title)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", frameon=False)
