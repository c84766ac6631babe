"""A controller such as ROS 2's diff_drive_controller: speeds of wheels from (v, omega), odometry from their angles.

Written from the equations of its documentation (ros2_controllers, "Wheeled Mobile Robot Kinematics", section on
differential drives), for wheels at distance b with radii r_left and r_right, each its number in the description times
its multiplier:

    wheel speeds      w_left = (v - omega b / 2) / r_left,   w_right = (v + omega b / 2) / r_right
    from their turns  ds = (r_right da_right + r_left da_left) / 2,   dtheta = (r_right da_right - r_left da_left) / b
    odometry          x += ds cos(theta + dtheta / 2),   y += ds sin(theta + dtheta / 2),   theta += dtheta
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cmr.recordings.signal import Floats


class DiffDriveController:
    """The controller with `ros__parameters` as a user pastes them; limits of speed and acceleration hold."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        self._separation = parameters["wheel_separation"] * parameters.get("wheel_separation_multiplier", 1.0)
        self._radii = tuple(
            parameters["wheel_radius"] * parameters.get(f"{side}_wheel_radius_multiplier", 1.0)
            for side in ("left", "right")
        )
        self._limits = tuple(
            parameters.get(kind, {}).get(axis, {}) for kind, axis in (("linear", "x"), ("angular", "z"))
        )

    def wheel_speeds(self, v: Floats, omega: Floats, period: float) -> tuple[Floats, Floats]:
        """Return wheel speeds [rad/s] of left and right, (n,) each, for commands (n,) [m/s, rad/s] every period [s]."""
        v, omega = (_limited(one, limit, period) for one, limit in zip((v, omega), self._limits, strict=True))
        half = 0.5 * self._separation * omega
        return (v - half) / self._radii[0], (v + half) / self._radii[1]

    def odometry(self, left: Floats, right: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x, y [m] and heading [rad], (n,) each, for the angles [rad] that both wheels have turned, (n,)."""
        gone_left, gone_right = (
            radius * np.diff(angle, prepend=0.0) for radius, angle in zip(self._radii, (left, right), strict=True)
        )
        way, turned = 0.5 * (gone_left + gone_right), (gone_right - gone_left) / self._separation
        theta = np.cumsum(turned)
        middle = theta - 0.5 * turned
        return np.cumsum(way * np.cos(middle)), np.cumsum(way * np.sin(middle)), theta


def _limited(commands: Floats, limit: Mapping[str, float], period: float) -> Floats:
    """Return what a speed limiter lets pass: no faster than `max_velocity`, changing by no more than acceleration."""
    fastest, quickest = limit.get("max_velocity", math.inf), limit.get("max_acceleration", math.inf)
    result, now = np.empty(len(commands)), 0.0
    for number, command in enumerate(np.clip(commands, -fastest, fastest).tolist()):
        now += min(max(command - now, -quickest * period), quickest * period)
        result[number] = now
    return result
