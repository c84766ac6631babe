"""Find a place for a patch of other ground: one that the robot crosses several times, and is off most of the time."""

from collections.abc import Callable
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
DISCS = ("surface_patch", "slippery_spot")  # what has a place
FAR = (1e3, 1e3)  # m; where no robot comes


def placed(truth: Truth) -> Truth:
    """Return the truth with a patch where the robot comes by several times, also when the patch itself acts.

    Nothing changes where no patch is hidden. Raises ValueError when there is no such place.
    """
    disc = next((name for name in DISCS if name in truth.case.effects), None)
    if disc is None:
        return truth
    case, truth = truth.case, replace(truth, case=replace(truth.case, run=0))

    def at(x: float, y: float) -> Truth:
        return replace(truth, parameters={**truth.parameters, f"{disc}_x": x, f"{disc}_y": y})

    radius = truth.parameters[f"{disc}_radius"]
    place = find_place(lambda x, y: _path(at(x, y)), radius, truth.case.random("place"))
    return replace(at(*place), case=case)


def find_place(
    driven: Callable[[float, float], Floats], radius: float, random: np.random.Generator
) -> tuple[float, float]:
    """Return the middle of a disc that a robot crosses several times; `driven` is its path where one lies there.

    Raises ValueError when there is no such place.
    """
    path = driven(*FAR)
    for number in random.integers(len(path), size=TRIES):
        x, y = map(float, path[number] + random.uniform(-0.4, 0.4, 2) * radius)
        if _crossed(path, x, y, radius) and _crossed(driven(x, y), x, y, radius):
            return x, y
    raise ValueError(f"the robot crosses no place {CROSSINGS} times")


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
