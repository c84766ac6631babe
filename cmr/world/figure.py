"""Draw what real robots and their twins drove, as Figure 2 of Edwards, Gaskell and Olson, AAMAS 2018."""

from pathlib import Path

from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR
from cmr.world.comparison import Drive

TITLES = ("before calibration", "after calibration")


def draw_before_and_after(drives: tuple[Drive, Drive], path: Path) -> None:
    """Write a picture of two drives side by side, real path yellow and simulated path blue, to `path`."""
    from matplotlib.figure import Figure  # slow to import, and writes a cache

    figure = Figure(figsize=(11.0, 5.5), dpi=120, layout="constrained")
    for axes, drive, title in zip(figure.subplots(1, 2), drives, TITLES, strict=True):
        axes.plot(drive.real_x, drive.real_y, color=REAL_COLOUR, linewidth=4.0, label="real robot")
        axes.plot(drive.twin_x, drive.twin_y, color=TWIN_COLOUR, linewidth=1.4, label="simulated robot")
        axes.plot(drive.real_x[0], drive.real_y[0], "o", color="black", markersize=5, label="start")
        axes.set_title(f"{title}\npath error {drive.path_rmse:.3f} m (root mean square)")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        axes.grid(alpha=0.3)
        axes.legend(loc="best", frameon=False)
    figure.savefig(path)
