"""Find a place for a patch of other ground: one that the robot crosses several times, and is off most of the time."""

from dataclasses import replace

import numpy as np

from cmr.recordings.signal import Floats
from tests.hidden_effects.cases import Truth
from tests.hidden_effects.driving import commands_of
from tests.reference_plant import drive

CROSSINGS = 3  # at least
SHARES = (0.06, 0.4)  # of the time of driving that may be spent inside
SETTLED = 0.02  # rad/s; a robot whose wheels turn more slowly stands
TRIES = 200


def placed(truth: Truth) -> Truth:
    """Return the truth with a patch where the robot comes by several times, also when the patch itself acts.

    Raises ValueError when there is no such place.
    """
    truth = replace(truth, case=replace(truth.case, run=0))
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
    """Return where the robot is while it moves, at 100 Hz, shape (n, 2) [m]."""
    case = truth.case
    commands = commands_of(truth, case.drive_seed)
    states = drive(commands, truth.plant, case.seconds, truth.noise, case.drive_seed).truth
    moves = np.abs(states["psi_left"]) + np.abs(states["psi_right"]) > SETTLED
    return np.column_stack([states["x"], states["y"]])[moves]


def _crossed(path: Floats, x: float, y: float, radius: float) -> bool:
    """Tell whether the path enters the disc often enough, and a fair part of it lies inside."""
    inside = np.hypot(path[:, 0] - x, path[:, 1] - y) < radius
    entries = int(np.count_nonzero(inside[1:] & ~inside[:-1]))
    return entries >= CROSSINGS and SHARES[0] <= float(np.mean(inside)) <= SHARES[1]
