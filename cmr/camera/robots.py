"""The pose of a robot from its tag: its corners are projected onto the plane in which it is mounted."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from cmr.camera.floor import RobotTag, square, turned
from cmr.camera.lens import Floats, Lens
from cmr.camera.place import Place
from cmr.camera.tags import Tag

# Why a tag of a robot gives no pose.
TOO_SMALL, TOO_OBLIQUE, AMBIGUOUS, OFF_FLOOR = "too small", "too oblique", "ambiguous", "off the floor plane"
REASONS = (TOO_SMALL, TOO_OBLIQUE, AMBIGUOUS, OFF_FLOOR)

SMALLEST = 20.0  # pixels, the shortest side of a tag: below, a heading may be off by more than 0.3 degrees
MOST_OBLIQUE = math.radians(70.0)  # between the line of sight and the vertical
# A flat square in its plane fits the corners to some hundredths of a pixel; blur and lens errors add to that.
WORST_FIT = 0.5  # pixels (rms); from 2.5 m a tag of 16 cm that is 3 cm higher than stated fits worse
WORST_SHARE = 0.008  # of the tag's side, if that is larger: accuracy of the print
TILTED = math.radians(25.0)  # from this angle on, a tag counts as tilted
AS_GOOD = 1.5  # a tilted fit is as good as a flat one if its error is at most this factor larger
NOISE = 0.1  # pixels (rms) below which a fit is as good as any


class Pose(NamedTuple):
    """Pose of a robot: its tracked point [m; world] and heading [rad; world]; `off` [pixels] is the residual."""

    x: float
    y: float
    theta: float
    off: float


def robot_pose(tag: Tag, carried: RobotTag, lens: Lens, place: Place) -> Pose | str:
    """Return the pose of the robot that carries this tag, or why there is none: one of REASONS."""
    if tag.side < SMALLEST:
        return TOO_SMALL
    corners = place.on_plane(lens.directions(tag.corners), carried.height)
    sight = corners.mean(axis=0) - place.eye
    if not abs(sight[2]) >= math.cos(MOST_OBLIQUE) * np.linalg.norm(sight):  # NaN, too
        return TOO_OBLIQUE
    flat = _refined(_flat(corners, carried.size), tag, carried, lens, place)
    off = _rms(flat, tag, carried, lens, place)
    if off > max(WORST_FIT, WORST_SHARE * tag.side):
        return OFF_FLOOR
    if _fits_tilted(tag, carried, lens, place, off):
        return AMBIGUOUS
    theta = math.remainder(flat[2] - carried.theta, 2.0 * math.pi)
    mounted = turned(np.array([[carried.x, carried.y]]), theta)[0]
    return Pose(float(flat[0] - mounted[0]), float(flat[1] - mounted[1]), theta, off)


def _flat(corners: Floats, size: float) -> Floats:
    """Return x, y [m], theta [rad] of the square that best fits these corners (4, 3)."""
    middle = corners.mean(axis=0)[:2]
    shape, seen = square(size), corners[:, :2] - middle
    along = float((shape * seen).sum())
    across = float((shape[:, 0] * seen[:, 1] - shape[:, 1] * seen[:, 0]).sum())
    return np.array([*middle, math.atan2(across, along)])


def _refined(flat: Floats, tag: Tag, carried: RobotTag, lens: Lens, place: Place) -> Floats:
    """Return the flat pose after one Gauss-Newton step on the residuals in the picture."""
    steps = (1e-4, 1e-4, 1e-3)
    here = _misfit(flat, tag, carried, lens, place)
    slopes = [(_misfit(flat + np.eye(3)[k] * steps[k], tag, carried, lens, place) - here) / steps[k] for k in range(3)]
    change, *_ = np.linalg.lstsq(np.column_stack(slopes), -here, rcond=None)
    return np.asarray(flat + change)


def _misfit(flat: Floats, tag: Tag, carried: RobotTag, lens: Lens, place: Place) -> Floats:
    """Return the residuals (8) [pixels] of the tag's corners for a flat pose."""
    corners = turned(square(carried.size), float(flat[2])) + flat[:2]
    seen = place.before_camera(np.column_stack([corners, np.full(4, carried.height)]))
    again = seen[:, :2] / seen[:, 2:] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    return np.asarray(again - tag.corners).ravel()


def _rms(flat: Floats, tag: Tag, carried: RobotTag, lens: Lens, place: Place) -> float:
    return float(np.sqrt((_misfit(flat, tag, carried, lens, place) ** 2).sum() / 4.0))


def _fits_tilted(tag: Tag, carried: RobotTag, lens: Lens, place: Place, off: float) -> bool:
    """Return whether a tilted tag, as of a robot that fell or is carried, fits the picture as well.

    A small square has two poses that look nearly alike; for a tag that lies flat, the other one is tilted by twice the
    viewing angle.
    """
    across_and_up = square(carried.size)[:, ::-1] * (-1.0, 1.0)  # as OpenCV wants it
    shape = np.column_stack([across_and_up, np.zeros(4)])
    count, turns, _, offs = cv2.solvePnPGeneric(shape, tag.corners, lens.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    for k in range(count):
        upwards = place.axes.T @ np.asarray(cv2.Rodrigues(turns[k])[0])[:, 2]
        tilt = math.acos(float(np.clip(upwards[2], -1.0, 1.0)))
        fit = float(np.ravel(offs[k])[0]) * math.sqrt(2.0)  # OpenCV's rms is per coordinate, not per corner
        if tilt > TILTED and fit < AS_GOOD * max(off, NOISE):
            return True
    return False
