"""Find a place for a patch of other ground: one that the robot crosses several times, and is off most of the time."""

from dataclasses import replace

import numpy as np

from cmr.recordings.signal import Floats
from tests.hidden_effects.cases import Truth
from tests.hidden_effects.driving import commands_of
from tests.reference_plant.drives import raster, true_motion

CROSSINGS = 3  # at least
SHARES = (0.08, 0.4)  # of the way that may lie inside
SETTLED = 0.02  # rad/s; a robot whose wheels turn more slowly stands
TRIES = 200
STEP = 1e-3  # s


def placed(truth: Truth) -> Truth:
    """Return the truth with a patch where the robot comes by several times, also when the patch itself acts.

    Raises ValueError when there is no such place.
    """
    random = truth.case.random("place")
    radius = truth.parameters["surface_patch_radius"]
    elsewhere = replace(truth, parameters={**truth.parameters, "surface_patch_x": 1e3, "surface_patch_y": 1e3})
    path = _path(elsewhere)
    for number in random.integers(len(path), size=TRIES):
        x, y = path[number] + random.uniform(-0.4, 0.4, 2) * radius
        if not _crossed(path, x, y, radius):
            continue
        here = replace(truth, parameters={**truth.parameters, "surface_patch_x": float(x), "surface_patch_y": float(y)})
        if _crossed(_path(here), x, y, radius):
            return here
    raise ValueError(f"{truth.case}: the robot crosses no place {CROSSINGS} times")


def _path(truth: Truth) -> Floats:
    """Return where the robot is while it moves, at 50 Hz, shape (n, 2) [m], without noise of the motion."""
    times = raster(truth.case.seconds, 50.0)
    states = true_motion(commands_of(truth, 0), truth.plant, times, step=STEP)
    moves = np.abs(states["psi_left"]) + np.abs(states["psi_right"]) > SETTLED
    return np.column_stack([states["x"], states["y"]])[moves]


def _crossed(path: Floats, x: float, y: float, radius: float) -> bool:
    """Tell whether the path enters the disc often enough, and spends a fair part of its way there."""
    inside = np.hypot(path[:, 0] - x, path[:, 1] - y) < radius
    way = np.hypot(*np.diff(path, axis=0, prepend=path[:1]).T)
    share = float(np.sum(way[inside]) / np.sum(way))
    entries = np.count_nonzero(inside[1:] & ~inside[:-1])
    return bool(entries >= CROSSINGS) and SHARES[0] <= share <= SHARES[1]
