"""What the robots are told to drive: the rich drive, parts of it, and figure-eights with or without a pilot."""

import math
from collections.abc import Mapping

import numpy as np

from cmr.recordings.signal import Floats
from tests.hidden_effects.cases import (
    BEGINNING,
    BRIEF,
    CONTROLLED_WINDOWS,
    EIGHT_OPEN,
    HELD_OUT,
    RICH,
    SHORT_SECONDS,
    WINDOWS,
    Truth,
)
from tests.hidden_effects.commanded import commands_of_sequence
from tests.hidden_effects.windows import commands_of_controller
from tests.reference_plant import Commands, packets, plant_parameters
from tests.reference_plant.drives import Pose
from tests.reference_plant.manoeuvres import (
    RICH_DRIVE_SECONDS,
    figure_eight,
    held_out_drive,
    in_turn,
    part_of_rich_drive,
    rich_drive,
)
from tests.reference_plant.steering import Pilot, steered

REST = 3.0  # s before and after figure-eights
SPEEDS = (0.27, 0.33)  # m/s; of figure-eights, for a robot that is as believed
HALF_WIDTHS = (0.8, 1.1)  # m, of figure-eights
LOOKAHEAD = 0.25  # m
SHARPEST = 0.6  # of the duty for straight driving: how much the pilot adds on one side and takes from the other
POINTS = 1000  # of a figure-eight


def commands_of(truth: Truth, seed: int) -> Commands:
    """Return the commands that the robot gets in the drive of this seed."""
    seconds, random = truth.case.seconds, truth.case.random("driving", truth.case.run)
    if truth.case.manoeuvre == CONTROLLED_WINDOWS:
        return commands_of_controller(truth, seed)
    if truth.case.manoeuvre in (RICH, WINDOWS):
        return packets(in_turn([(RICH_DRIVE_SECONDS, rich_drive())] * truth.case.repeats), seconds)
    if truth.case.manoeuvre == HELD_OUT:
        return packets(held_out_drive(), seconds)
    if truth.case.manoeuvre == BRIEF:
        return commands_of_sequence(BRIEF, truth.nominal, seconds)
    if truth.case.manoeuvre in SHORT_SECONDS:
        short = rich_drive() if truth.case.manoeuvre == BEGINNING else part_of_rich_drive(truth.case.manoeuvre)
        return packets(short, seconds)
    speed, half_width = random.uniform(*SPEEDS), random.uniform(*HALF_WIDTHS)
    if truth.case.manoeuvre == EIGHT_OPEN:
        laps = round(speed * (seconds - 2.0 * REST) / (6.1 * half_width))
        return packets(figure_eight(seconds, laps, speed, plant_parameters(truth.robot)), seconds)
    pilot = pursuit(truth.nominal, speed, half_width, seconds)
    return steered(pilot, truth.plant, seconds, truth.noise, seed)


def eight(half_width: float) -> Floats:
    """Return the points of a figure-eight through the origin, which it leaves along x, shape (POINTS, 2) [m]."""
    share = 2.0 * math.pi * np.arange(POINTS) / POINTS
    x, y = half_width * np.sin(share), half_width * np.sin(share) * np.cos(share)
    diagonal = math.sqrt(0.5)
    return np.column_stack([diagonal * (x + y), diagonal * (y - x)])


def pursuit(believed: Mapping[str, float], speed: float, half_width: float, seconds: float) -> Pilot:
    """Return a pilot that pursues a point ahead of the robot on a figure-eight, at this speed [m/s], between rests.

    It turns the speed and turn rate that it wants into duties by what is believed of the robot.
    """
    points = eight(half_width)
    spacing = float(np.mean(np.hypot(*np.diff(points, axis=0).T)))
    ahead, window = round(LOOKAHEAD / spacing), round(0.5 / spacing)
    nearest = 0

    def duties(time: float, pose: Pose) -> tuple[float, float]:
        nonlocal nearest
        if not REST <= time < seconds - REST:
            return 0.0, 0.0
        x, y, theta = pose
        near = (nearest + np.arange(window)) % POINTS
        nearest = int(near[np.argmin(np.hypot(points[near, 0] - x, points[near, 1] - y))])
        goal_x, goal_y = points[(nearest + ahead) % POINTS]
        bearing = math.remainder(math.atan2(goal_y - y, goal_x - x) - theta, 2.0 * math.pi)
        turn_rate = 2.0 * speed * math.sin(bearing) / max(math.hypot(goal_x - x, goal_y - y), 0.5 * LOOKAHEAD)
        common = believed["k1"] * speed / believed["wheel_radius"]
        difference = believed["k1"] * turn_rate * believed["base_width"] / 2.0 / believed["wheel_radius"]
        difference = min(max(difference, -SHARPEST * common), SHARPEST * common)
        return common - difference, common + difference

    return duties
