"""Drives in closed loop: a pilot that sees the robot's poses, with their noise and their age, steers it."""

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from cmr.plant import sensors
from cmr.plant.beyond_sensors import forward_speed
from cmr.plant.parameters import PlantParameters, as_record, plant_parameters
from cmr.plant.physics import simulate
from cmr.plant.sensors import SILENT, Noise
from cmr.plant.state import COLUMNS, at_rest
from cmr.recordings.signal import Floats
from tests.reference_plant.drives import (
    COMMAND_RATE,
    ORIGIN,
    POSE_RATE,
    STUDY_STEP,
    Commands,
    Pose,
    course_of,
    moments,
    raster,
    seeds,
)

# What a pilot does at a time [s] when it sees the robot at this pose: the duties of both sides.
Pilot = Callable[[float, Pose], tuple[float, float]]

PACKETS = round(COMMAND_RATE / POSE_RATE)  # that the pilot sends for each pose it sees
POSE = slice(COLUMNS.index("x"), COLUMNS.index("theta") + 1)
SPEEDS = slice(COLUMNS.index("psi_left"), COLUMNS.index("psi_right") + 1)
RATE = COLUMNS.index("w")


def steered(
    pilot: Pilot,
    parameters: Mapping[str, float],
    seconds: float,
    noise: Noise = SILENT,
    seed: int = 0,
    *,
    step: float = STUDY_STEP,
    start: Pose = ORIGIN,
) -> Commands:
    """Return the commands that the pilot gives in a drive, deciding again at each pose.

    `drive` with these commands and the same seed makes the same motion: all that is drawn by chance on the way is
    drawn in the same order.
    """
    p = plant_parameters(parameters)
    record, sent, stamps = as_record(p), *(raster(seconds, rate)[:-1] for rate in (COMMAND_RATE, POSE_RATE))
    course = course_of(p, sent, moments(p, seconds), seeds(seed)[0])
    seen_at, errors = course.at(sensors.pose_time(p, stamps)), _errors(stamps, noise, seed)
    given = np.zeros((2, len(sent) + 1))  # the last: nothing has come yet
    states = np.zeros((len(course.borders), len(COLUMNS)))
    states[0, POSE] = start
    robot, borders = at_rest(start), np.append(course.at(stamps), len(course.packet))
    for number, (begin, end) in enumerate(pairwise(borders)):
        pose = _seen(p, states[min(seen_at[number], begin)], errors[number])
        given[:, PACKETS * number : PACKETS * (number + 1)] = np.array([pilot(stamps[number], pose)]).T
        left, right = given[:, course.packet[begin:end]]
        part = course.borders[begin : end + 1]
        states[begin : end + 1], robot = simulate(
            record, robot, part, left, right, step, noise.of_motion, course.random
        )
    return Commands(sent, given[0, :-1], given[1, :-1])


def _errors(stamps: Floats, noise: Noise, seed: int) -> Floats:
    """Return what is wrong with each pose that the pilot sees, shape (n, 3) [m, m, rad]."""
    random = np.random.default_rng([seed, 1])
    sizes = (noise.position, noise.position, noise.heading)
    return np.column_stack([size * sensors.correlated(stamps, noise.pose_time, random) for size in sizes])


def _seen(p: PlantParameters, state: Floats, error: Floats) -> Pose:
    v = forward_speed(p, *state[SPEEDS])
    x, y, theta = np.add(sensors.seen(p, *state[POSE], v, state[RATE]), error).tolist()
    return x, y, theta
