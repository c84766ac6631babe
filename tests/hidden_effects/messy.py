"""Robots as they are: several small imperfections at once, each within a quarter of an ordinary size.

The pilot follows a figure-eight by sight, as that of the product does: open-loop commands would take a robot with
unequal motors out of any room.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from cmr.parameters.file import ParameterFile, Value
from cmr.plant.sensors import REALISTIC
from cmr.recordings.recording import Recording
from tests.hidden_effects.robots import draw_nominal, draw_robot, scales
from tests.hidden_effects.sizes import EITHER_SIGN, GROWS_WITH
from tests.reference_plant import drives
from tests.reference_plant.drives import Pose
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, rich_drive
from tests.reference_plant.steering import Pilot, steered

ORDINARY: Mapping[str, float] = {
    "motor_gain_asymmetry": 0.03,
    "wheel_radius_asymmetry": 0.008,
    "coulomb_friction": 3.0,
    "gyro_bias": 0.01,
    "turn_slip": 0.03,
    "lateral_skid": 0.06,
    "pose_offset": 0.012,
    "battery_sag": 0.2,
    "command_delay": 0.015,
    "gyro_latency": 0.01,
    "longitudinal_slip": 0.02,
}
AT_ONCE = 6  # of them
SPREAD = 0.25  # share of the ordinary size
SENSOR_RATE = 50.0  # Hz
REST = 1.0  # s, before and after the drive
HALF_WIDTH = 0.9  # m, of the figure
AHEAD = 0.25  # s at this speed lies the point that the pilot steers for, and AHEAD_AT_LEAST
AHEAD_AT_LEAST = 0.15  # m
# Speeds [m/s] and how long [s] each is held.
PLANS: Mapping[str, tuple[tuple[float, float], ...]] = {
    "two60": ((0.2, 30.0), (0.5, 30.0)),
    "one60": ((0.3, 60.0),),
    "one120": ((0.3, 120.0),),
}


class Messy(NamedTuple):
    """A robot with what is hidden in it, and a recording of it."""

    robot: Mapping[str, float]
    hidden: Mapping[str, float]
    recording: Recording


def messy(seed: int, plan: str, at_once: int = AT_ONCE, drive: int = 0) -> Messy:
    """Return a robot with `at_once` imperfections, and its recording of a plan of PLANS, or of the rich drive.

    Another `drive` has other noise.
    """
    random = np.random.default_rng([seed, 19])
    robot = draw_robot(random)
    hidden = imperfections(robot, random, at_once)
    nominal = ParameterFile(0, {name: Value(value) for name, value in draw_nominal(robot, random).items()})
    plant = {**robot, **hidden}
    luck = seed + 1_000_000 * drive
    with sensors_at(SENSOR_RATE):
        if plan == "rich":
            seconds = RICH_DRIVE_SECONDS
            commands = drives.packets(rich_drive(), seconds)
        else:
            seconds = sum(held for _, held in PLANS[plan])
            commands = steered(pursuit(robot, PLANS[plan]), plant, seconds, REALISTIC, luck)
        recording = drives.drive(commands, plant, seconds, REALISTIC, luck, nominal=nominal).recording
    return Messy(robot, hidden, recording)


def imperfections(robot: Mapping[str, float], random: np.random.Generator, at_once: int = AT_ONCE) -> dict[str, float]:
    """Draw `at_once` imperfections of a robot, each within a quarter of an ordinary size."""
    grown = scales(robot)
    return {
        str(name): float(
            (random.choice((-1.0, 1.0)) if name in EITHER_SIGN else 1.0)
            * ORDINARY[name]
            * random.uniform(1.0 - SPREAD, 1.0 + SPREAD)
            * grown[GROWS_WITH.get(name, "-")]
        )
        for name in random.choice(list(ORDINARY), at_once, replace=False)
    }


@contextmanager
def sensors_at(rate: float) -> Iterator[None]:
    """All sensors of the plant tell at this rate [Hz]."""
    names = ("WHEEL_RATE", "GYRO_RATE", "POSE_RATE")
    before = {name: getattr(drives, name) for name in names}
    for name in names:
        setattr(drives, name, rate)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(drives, name, value)


def pursuit(robot: Mapping[str, float], plan: tuple[tuple[float, float], ...]) -> Pilot:
    """Return a pilot that drives figure-eights by pure pursuit: on the circle to a point ahead on the figure."""
    phases = np.linspace(0.0, 2.0 * math.pi, 2001)
    figure = HALF_WIDTH * np.column_stack([np.sin(phases), np.sin(phases) * np.cos(phases)])
    # The figure begins at the origin, along x.
    turned = math.pi / 4.0
    turn = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
    figure = figure @ turn.T
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(figure, axis=0).T))])
    whole, reached = lengths[-1], 0.0
    end = sum(held for _, held in plan)

    def point(way: float) -> tuple[float, float]:
        at = way % whole
        return float(np.interp(at, lengths, figure[:, 0])), float(np.interp(at, lengths, figure[:, 1]))

    def pilot(time: float, pose: Pose) -> tuple[float, float]:
        nonlocal reached
        if not REST <= time < end - REST:
            return 0.0, 0.0
        borders = np.cumsum([held for _, held in plan])
        speed = plan[int(np.searchsorted(borders, time, side="right"))][0]
        x, y, theta = pose
        ways = reached + np.linspace(0.0, 0.15, 31)
        near = [math.hypot(point(way)[0] - x, point(way)[1] - y) for way in ways]
        reached = float(ways[int(np.argmin(near))])
        goal = point(reached + max(AHEAD_AT_LEAST, AHEAD * speed))
        across = -math.sin(theta) * (goal[0] - x) + math.cos(theta) * (goal[1] - y)
        curvature = 2.0 * across / max((goal[0] - x) ** 2 + (goal[1] - y) ** 2, 1e-6)
        return duties(robot, speed, float(np.clip(curvature, -5.0, 5.0)))

    return pilot


def duties(robot: Mapping[str, float], speed: float, curvature: float) -> tuple[float, float]:
    """Return the duties with which the robot of the paper drives at this speed [m/s] along a curvature [1/m]."""
    share = curvature * robot["base_width"] / 2.0
    turning = robot["k1"] * speed / robot["wheel_radius"]
    return float(np.clip(turning * (1.0 - share), -1, 1)), float(np.clip(turning * (1.0 + share), -1, 1))
