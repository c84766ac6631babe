"""Commands as they take effect: a step in which one comes is split there, as calibration and diagnosis split it."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cmr.model.catalogue import effects_on
from cmr.model.commands import SHORTEST
from cmr.model.extended.compose import late
from cmr.model.extended.evaluating import evaluated
from cmr.model.extended.step_helpers import random_number
from cmr.model.extended.step_statements import LONGEST_STEP
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats


class Spans(NamedTuple):
    """Duties of both sides and how long each lasts [s], (n,), and how many have ended when each command's time has."""

    left: Floats
    right: Floats
    dt: Floats
    ends: np.typing.NDArray[np.int64]


def in_force(parameters: RobotParameters, left: Floats, right: Floats, dt: Floats, seed: int) -> Spans:
    """Return the duties by which a robot at rest drives that is sent `left` and `right` for `dt` [s] each, (n,).

    A span that is longer than a step of the model counts as several commands, each of which may be late, or lost.
    """
    effects = tuple(effect.name for effect in late(effects_on(parameters.values)))
    parts = np.ceil(dt / LONGEST_STEP).astype(np.int64)
    sent = tuple(np.repeat(column, parts) for column in (left, right, dt / np.maximum(parts, 1)))
    if not effects:
        return Spans(left, right, dt, np.arange(1, len(dt) + 1))
    packets, time, spans = [(0.0, 0.0, -np.inf)], 0.0, []
    ends = [0]
    for count, (one_left, one_right, step) in enumerate(zip(*(column.tolist() for column in sent), strict=True)):
        drawn = {"random_number": random_number, "seed": seed, "count": count, "robot": 0, "delay": 0.0, "lost": False}
        found = evaluated(effects, "packet")({**parameters.values, **drawn})
        packets.append(packets[-1] if found["lost"] else (one_left, one_right, time + float(found["delay"])))
        places = np.array([_place(arrival - time, step) for _, _, arrival in packets])
        begins = np.array([0.0, *np.unique(places[(places > 0.0) & (places < 1.0)])])
        newest = [int(np.flatnonzero(places <= begin)[-1]) for begin in begins]  # older ones that come change nothing
        changes = np.diff(newest, prepend=-1) != 0
        for number, (begin, end) in zip(np.array(newest)[changes], pairwise([*begins[changes], 1.0]), strict=True):
            spans.append((*packets[number][:2], (end - begin) * step))
        del packets[: int(np.flatnonzero(places <= 0.0)[-1])]
        time += step
        ends.append(len(spans))
    columns = np.array(spans).T
    return Spans(columns[0], columns[1], columns[2], np.array(ends)[np.cumsum(parts)])


def _place(later: float, dt: float) -> float:
    """Return after how many steps of `dt` [s] a command takes effect; one that comes near a border comes with it."""
    place = max(later / dt, -1.0)
    return float(round(place)) if abs(place - round(place)) < SHORTEST else place


def prompt(parameters: RobotParameters) -> RobotParameters:
    """Return a robot whose commands are neither late nor lost."""
    own = {one.name for effect in late(effects_on(parameters.values)) for one in effect.all_parameters}
    return RobotParameters.of({name: value for name, value in parameters.values.items() if name not in own})
