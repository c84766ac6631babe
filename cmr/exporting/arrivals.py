"""Apply commands when they arrive: a step is split at an arrival, as calibration and diagnosis split it."""

from itertools import pairwise
from math import inf
from typing import Any, NamedTuple

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
    """Duties of both sides, how long each lasts [s], (n,), and how many spans have ended at the end of each command's
    time.
    """

    left: Floats
    right: Floats
    dt: Floats
    ends: np.typing.NDArray[np.int64]


class Packet(NamedTuple):
    """A command in transit: its duties and its time of arrival [s]."""

    left: float
    right: float
    arrival: float


def in_force(parameters: RobotParameters, left: Floats, right: Floats, dt: Floats, seed: int) -> Spans:
    """Return the duties applied to a robot, initially at rest, that is sent `left` and `right` for `dt` [s] each, (n,).

    A span longer than a step of the model counts as several commands, each of which may be late or lost.
    """
    effects = tuple(effect.name for effect in late(effects_on(parameters.values)))
    parts = np.ceil(dt / LONGEST_STEP).astype(np.int64)
    sent = tuple(np.repeat(column, parts) for column in (left, right, dt / np.maximum(parts, 1)))
    if not effects:
        return Spans(left, right, dt, np.arange(1, len(dt) + 1))
    packet = evaluated(effects, "packet")
    packets, time, ends = [Packet(0.0, 0.0, -inf)], 0.0, [0]
    spans: list[tuple[float, float, float]] = []
    for count, (one_left, one_right, step) in enumerate(zip(*(column.tolist() for column in sent), strict=True)):
        drawn = {"random_number": random_number, "seed": seed, "count": count, "robot": 0}
        variables: dict[str, Any] = {**parameters.values, **drawn, "delay": 0.0, "lost": False}
        found = packet(variables)
        packets.append(packets[-1] if found["lost"] else Packet(one_left, one_right, time + float(found["delay"])))
        spans += _within(packets, time, step)
        time += step
        ends.append(len(spans))
    left, right, dt = np.array(spans).T
    return Spans(left, right, dt, np.array(ends)[np.cumsum(parts)])


def _within(packets: list[Packet], time: float, dt: float) -> list[tuple[float, float, float]]:
    """Return the spans of a step that begins at `time`: duties and durations. Removes superseded packets."""
    places = np.array([_place(one.arrival - time, dt) for one in packets])
    begins = np.array([0.0, *np.unique(places[(places > 0.0) & (places < 1.0)])])
    # Older ones that arrive later change nothing.
    newest = np.array([np.flatnonzero(places <= begin)[-1] for begin in begins])
    changes = np.diff(newest, prepend=-1) != 0
    spans = [
        (packets[number].left, packets[number].right, (end - begin) * dt)
        for number, (begin, end) in zip(newest[changes].tolist(), pairwise([*begins[changes], 1.0]), strict=True)
    ]
    del packets[: newest[0]]
    return spans


def _place(later: float, dt: float) -> float:
    """Return after how many steps of `dt` [s] a command takes effect; an arrival near a step boundary counts as on
    it.
    """
    place = max(later / dt, -1.0)
    return float(round(place)) if abs(place - round(place)) < SHORTEST else place


def prompt(parameters: RobotParameters) -> RobotParameters:
    """Return the robot without delay or loss of commands."""
    own = {one.name for effect in late(effects_on(parameters.values)) for one in effect.all_parameters}
    return RobotParameters.of({name: value for name, value in parameters.values.items() if name not in own})
