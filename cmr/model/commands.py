"""Commands in effect: each holds until the next.

A step of the model has constant duties. If a command arrives within a step, the step is split there: real processes
send at any time, and each robot has its own delay.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.model.catalogue import CATALOGUE, DEFINITIONS
from cmr.model.compiled import compiled, inlined
from cmr.model.extended.compose import late
from cmr.model.extended.evaluating import evaluated

Floats = NDArray[np.float64]
# Of a step: the share after which a command arrives, 0 without one; duties before and after.
PROFILE = ("split", "first_left", "first_right", "left", "right")
SHORTEST = 1e-3  # of a step; a command closer to a border is moved to it


@dataclass(frozen=True)
class Commands:
    """Commands sent at `time` [s], shape (n,), increasing, with the `duty` of both sides, shape (n, 2)."""

    time: Floats
    duty: Floats

    def profile(self, dt: float, steps: int, delay: float = 0.0) -> Floats:
        """Return the duties in each of `steps` of `dt` [s] from time 0 on, shape (steps, 5), columns PROFILE.

        Each command takes effect `delay` [s] after its time; before the first, duties are not known: NaN. Without any
        commands they are 0. With several in one step, the one with the largest change splits it, and means are used
        before and after.
        """
        result = np.zeros((steps, len(PROFILE)))
        if len(self.time):
            time, duty = np.ascontiguousarray(self.time), np.ascontiguousarray(self.duty)
            fill_profile(time, duty, dt, delay, result)
        return result


@inlined
def _place(time, delay, dt):  # type: ignore[no-untyped-def]
    """Return the number of steps until a command takes effect; one near a border is moved to it."""
    place = (time + delay) / dt
    whole = np.rint(place)
    return whole if abs(place - whole) < SHORTEST else place


@compiled("void(f8[::1], f8[:, ::1], f8, f8, f8[:, ::1])")
def fill_profile(time, duty, dt, delay, profile):  # type: ignore[no-untyped-def]
    """Write the profile of commands, (steps, 5); see `Commands.profile`."""
    count, number, left, right = len(time), 0, np.nan, np.nan  # the next command, and the duties in force
    for step in range(len(profile)):
        row = profile[step]
        while number < count and _place(time[number], delay, dt) <= step:
            left, right = duty[number, 0], duty[number, 1]
            number += 1
        row[1], row[2], largest, first = left, right, 0.0, number
        while number < count and _place(time[number], delay, dt) < step + 1:
            change = max(abs(duty[number, 0] - left), abs(duty[number, 1] - right))
            if not change <= largest:  # or unknown before
                row[0], largest = _place(time[number], delay, dt) - step, change if change == change else np.inf
            left, right = duty[number, 0], duty[number, 1]
            number += 1
        row[3], row[4] = left, right
        if number > first + 1 and row[0] > 0.0:
            _average(row, time, duty, dt, delay, step, first, number)


@compiled("void(f8[::1], f8[:, ::1], i8[::1], f8, f8, i8[::1], f8[:, ::1])")
def fill_profiles(time, duty, ends, dt, delay, steps, profile):  # type: ignore[no-untyped-def]
    """Write the profiles of several drives, one after another; see `Commands.profile`.

    `ends` and `steps` (K + 1,) say where each drive's commands and steps end; a drive without commands is left as is.
    """
    for drive in range(len(steps) - 1):
        first, last = ends[drive], ends[drive + 1]
        if last > first:
            of_drive = profile[steps[drive] : steps[drive + 1]]
            fill_profile(time[first:last], duty[first:last], dt, delay, of_drive)


@inlined
def _average(row, time, duty, dt, delay, step, first, last):  # type: ignore[no-untyped-def]
    """Write means of the duties before and after the split of a step in which several commands come."""
    split, since, left, right = row[0], 0.0, row[1], row[2]
    row[1], row[2], row[3], row[4] = 0.0, 0.0, 0.0, 0.0
    for number in range(first, last + 1):
        until = _place(time[number], delay, dt) - step if number < last else 1.0
        before = (min(until, split) - min(since, split)) / split
        behind = (max(until, split) - max(since, split)) / (1.0 - split)
        row[1] += before * left if before > 0.0 else 0.0
        row[2] += before * right if before > 0.0 else 0.0
        row[3] += behind * left if behind > 0.0 else 0.0
        row[4] += behind * right if behind > 0.0 else 0.0
        if number < last:
            since, left, right = until, duty[number, 0], duty[number, 1]


def fixed_delays(values: Mapping[str, Floats]) -> Floats | None:
    """Return the delay [s] of commands for each candidate, (C,); None if any of them has random delays.

    `values` of parameters, by name, are arrays (C,).
    """
    given = {name: values[name] for name in _late_parameters() if name in values}
    if not given:
        return np.zeros(1)
    lowest, highest = (_packet(given, random) for random in (1.0, 0.0))
    if np.any(lowest["delay"] != highest["delay"]) or np.any(highest["lost"]):
        return None
    return np.asarray(lowest["delay"], np.float64)


def _packet(given: Mapping[str, Floats], random: float) -> dict[str, Floats]:
    """Apply the packet stage with equal random numbers; arrays (C,) by name."""
    neutral = {name: DEFINITIONS[name].neutral for name in _late_parameters()}
    zero = np.zeros(len(next(iter(given.values()))))
    drawn: dict[str, Any] = {"random_number": lambda *_stream: random, "seed": 0, "count": 0, "robot": 0}
    stage = evaluated(tuple(effect.name for effect in late(CATALOGUE.values())), "packet")
    return stage({**neutral, **given, **drawn, "delay": zero, "lost": zero > 0.0})


@cache
def _late_parameters() -> tuple[str, ...]:
    return tuple(parameter.name for effect in late(CATALOGUE.values()) for parameter in effect.parameters)
