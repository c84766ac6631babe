"""Corrections of the observer's state by encoder and pose errors; compiled into its loops."""

from math import pi

import numpy as np

from cmr.model.compiled import inlined
from cmr.model.elementary import cos, sin
from cmr.model.extended.compose import ANGLE_LEFT, ANGLE_RIGHT, PSI_LEFT, PSI_RIGHT, THETA, X, Y
from cmr.model.observer.helpers import (
    AT_TIME,
    BASE_WIDTH,
    BEFORE_LEFT,
    BEFORE_RIGHT,
    EARLY,
    EAST_X,
    EAST_Y,
    ERROR_LEFT,
    ERROR_RIGHT,
    ERROR_THETA,
    ERROR_X,
    ERROR_Y,
    GAIN_ANGLE,
    GAIN_POSITION,
    GAIN_PSI,
    GAIN_THETA,
    MIDDLE_LEFT,
    MIDDLE_RIGHT,
    NEARBY,
    NORTH_X,
    NORTH_Y,
    OFFSET_LEFT,
    OFFSET_RIGHT,
    OFFSET_THETA,
    OFFSET_X,
    OFFSET_Y,
    RADIUS_LEFT,
    RADIUS_RIGHT,
    SCALE_LEFT,
    SCALE_RIGHT,
    SEEN_THETA,
    SEEN_X,
    SEEN_Y,
    SLIP_TIME,
    Floats,
)


@inlined
def move(own: Floats, here: Floats, i: int, x: float, y: float, turned: float) -> None:
    """Move the robot of lane i [m, m, rad]."""
    own[OFFSET_X + i] += x
    own[OFFSET_Y + i] += y
    own[OFFSET_THETA + i] += turned
    here[X + i] += x
    here[Y + i] += y
    here[THETA + i] += turned


@inlined
def correct_by_encoders(own: Floats, here: Floats, i: int, left: bool, right: bool) -> None:
    """Correct the wheels of lane i by their encoder errors, if used, and the robot with them."""
    # Displacement of the wheels, not of their encoders.
    error_left = own[SCALE_LEFT + i] * own[ERROR_LEFT + i] if left else 0.0
    error_right = own[SCALE_RIGHT + i] * own[ERROR_RIGHT + i] if right else 0.0
    rolled_left, rolled_right = own[GAIN_ANGLE + i] * error_left, own[GAIN_ANGLE + i] * error_right
    here[ANGLE_LEFT + i] += rolled_left
    own[BEFORE_LEFT + i] += rolled_left
    own[MIDDLE_LEFT + i] += rolled_left
    here[ANGLE_RIGHT + i] += rolled_right
    own[BEFORE_RIGHT + i] += rolled_right
    own[MIDDLE_RIGHT + i] += rolled_right
    here[PSI_LEFT + i] += own[GAIN_PSI + i] * error_left
    here[PSI_RIGHT + i] += own[GAIN_PSI + i] * error_right
    own[OFFSET_LEFT + i] += own[GAIN_PSI + i] * error_left
    own[OFFSET_RIGHT + i] += own[GAIN_PSI + i] * error_right
    # Displaced wheels have also moved the robot, except for slip while they accelerated.
    rolled_left -= own[SLIP_TIME + i] * own[GAIN_PSI + i] * error_left
    rolled_right -= own[SLIP_TIME + i] * own[GAIN_PSI + i] * error_right
    rolled_left *= own[RADIUS_LEFT + i]
    rolled_right *= own[RADIUS_RIGHT + i]
    ahead = 0.5 * (rolled_left + rolled_right)
    turned = (rolled_right - rolled_left) / own[BASE_WIDTH + i]
    move(own, here, i, ahead * cos(here[THETA + i]), ahead * sin(here[THETA + i]), turned)


@inlined
def correct_by_pose(own: Floats, here: Floats, i: int, pose: Floats, restart: bool, dt: float) -> None:
    """Correct the robot of lane i towards a measured `pose` (3,) [m, m, rad]: completely on a `restart`.

    Besides the expected readings, those for a robot displaced by NEARBY are used: if the sensor distorts or folds
    space, following the error directly may diverge.
    """
    x, y = own[SEEN_X + i], own[SEEN_Y + i]
    error_x, error_y = pose[0] - x, pose[1] - y
    error_theta = pose[2] - own[SEEN_THETA + i]
    error_theta -= 2.0 * pi * np.floor(error_theta / (2.0 * pi) + 0.5)
    own[ERROR_X + i] = error_x
    own[ERROR_Y + i] = error_y
    own[ERROR_THETA + i] = error_theta
    east_x, east_y = (own[EAST_X + i] - x) / NEARBY, (own[EAST_Y + i] - y) / NEARBY
    north_x, north_y = (own[NORTH_X + i] - x) / NEARBY, (own[NORTH_Y + i] - y) / NEARBY
    stretched = 0.5 * (east_x * east_x + east_y * east_y + north_x * north_x + north_y * north_y)
    # The motion before the beginning is unknown: each earlier pose restarts.
    restarts = restart or (own[AT_TIME + i] < -EARLY * dt and own[GAIN_POSITION + i] > 0.0)
    followed = (1.0 if restarts else own[GAIN_POSITION + i]) / max(1.0, stretched)
    turned = (1.0 if restarts else own[GAIN_THETA + i]) * error_theta
    move_x = followed * (east_x * error_x + east_y * error_y)
    move(own, here, i, move_x, followed * (north_x * error_x + north_y * error_y), turned)
