"""Motion of the whole robot: one step of many robots, or one drive under many candidate parameters.

Wheel speed and heading are the exact solution for constant duty; the position integrates speed times direction
with the two-point Gauss-Legendre rule, whose error over a 10 ms step is some nanometres.
"""

from typing import Any, NamedTuple

import numpy as np

from cmr.model.body import arc, forward, turn, wrap
from cmr.model.motor import wheel_acceleration, wheel_angle_after, wheel_speed_after
from cmr.model.parameters import RobotParameters

# Gauss-Legendre on [0, 1]: two points, equal weights of 1/2.
GAUSS_POINTS = (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0))


class RobotState(NamedTuple):
    """The state of one robot (numbers) or of many (arrays of one shape); fields and units as in robot_state_t."""

    x: Any
    y: Any
    theta: Any
    psi_left: Any
    psi_right: Any
    domega_left: Any
    domega_right: Any

    @classmethod
    def at_rest(cls, x: Any = 0.0, y: Any = 0.0, theta: Any = 0.0) -> "RobotState":
        """Return the state of a robot that stands still at this pose."""
        still = np.zeros_like(np.asarray(x, dtype=float))[()]
        return cls(x, y, theta, still, still, still, still)


class Trajectory(NamedTuple):
    """A simulated drive: each array has the time on its first axis and the candidates on the others.

    Pose and wheel speeds are as in RobotState; `angle_left` and `angle_right` [rad] are how far the wheels have
    turned since the start.
    """

    x: Any
    y: Any
    theta: Any
    psi_left: Any
    psi_right: Any
    angle_left: Any
    angle_right: Any


def step(state: RobotState, left: Any, right: Any, parameters: RobotParameters, dt: Any) -> RobotState:
    """Return the state after `dt` [s] of constant duties `left` and `right`."""
    dx, dy = displacement(state.theta, state.psi_left, state.psi_right, left, right, parameters, dt)
    angle_left, angle_right = wheel_angles(state.psi_left, state.psi_right, left, right, parameters, dt)
    psi_left = wheel_speed_after(state.psi_left, left, parameters, dt)
    psi_right = wheel_speed_after(state.psi_right, right, parameters, dt)
    return RobotState(
        state.x + dx,
        state.y + dy,
        wrap(state.theta + turn(angle_left, angle_right, parameters)),
        psi_left,
        psi_right,
        wheel_acceleration(psi_left, left, parameters),
        wheel_acceleration(psi_right, right, parameters),
    )


def wheel_angles(
    psi_left: Any, psi_right: Any, left: Any, right: Any, parameters: RobotParameters, time: Any
) -> tuple[Any, Any]:
    """Return the angles [rad] through which the wheels of both sides turn during `time` [s] of constant duties."""
    return (
        wheel_angle_after(psi_left, left, parameters, time),
        wheel_angle_after(psi_right, right, parameters, time),
    )


def displacement(
    theta: Any, psi_left: Any, psi_right: Any, left: Any, right: Any, parameters: RobotParameters, dt: Any
) -> tuple[Any, Any]:
    """Return the displacement (dx, dy) [m, world frame] during `dt` [s] of constant duties."""
    dx, dy = 0.0, 0.0
    for point in GAUSS_POINTS:
        time = point * dt
        heading = theta + turn(*wheel_angles(psi_left, psi_right, left, right, parameters, time), parameters)
        speed = forward(
            wheel_speed_after(psi_left, left, parameters, time),
            wheel_speed_after(psi_right, right, parameters, time),
            parameters,
        )
        dx = dx + 0.5 * dt * speed * np.cos(heading)
        dy = dy + 0.5 * dt * speed * np.sin(heading)
    return dx, dy


def wheel_speeds(duty: Any, dt: Any, parameters: RobotParameters, psi: Any) -> Any:
    """Return the speeds of one side's wheels over a drive that starts at speed `psi`.

    `duty` and `dt` have shape (T,); the result has shape (T + 1, candidates...), candidates as the parameters
    broadcast.
    """
    candidates = np.broadcast_shapes(np.shape(parameters.k1), np.shape(parameters.k2_over_k3), np.shape(psi))
    speeds = np.empty((len(duty) + 1, *candidates))
    speeds[0] = psi
    for k, (u, h) in enumerate(zip(duty, dt, strict=True)):
        speeds[k + 1] = wheel_speed_after(speeds[k], u, parameters, h)
    return speeds


def drive(left: Any, right: Any, dt: Any, parameters: RobotParameters, start: RobotState) -> Trajectory:
    """Simulate a drive from recorded duties, freely: nothing is corrected on the way.

    `left`, `right` [duty] and `dt` [s] have shape (T,), one entry per span of constant duty. Parameters and start
    may be arrays of candidates. The result has shape (T + 1, candidates...); `theta` is not wrapped.
    """
    psi_left = wheel_speeds(left, dt, parameters, start.psi_left)
    psi_right = wheel_speeds(right, dt, parameters, start.psi_right)
    candidates = max(psi_left.ndim - 1, *(np.ndim(value) for value in (*parameters, *start)))
    in_time = (slice(None), *(np.newaxis,) * candidates)
    spans = (psi_left[:-1], psi_right[:-1], np.asarray(left)[in_time], np.asarray(right)[in_time])
    span = np.asarray(dt)[in_time]
    angle_left, angle_right = wheel_angles(*spans, parameters, span)
    theta = _accumulate(start.theta, turn(angle_left, angle_right, parameters))
    dx, dy = displacement(theta[:-1], *spans, parameters, span)
    return Trajectory(
        _accumulate(start.x, dx),
        _accumulate(start.y, dy),
        theta,
        psi_left,
        psi_right,
        _accumulate(0.0, angle_left),
        _accumulate(0.0, angle_right),
    )


def roll(angle_left: Any, angle_right: Any, parameters: RobotParameters, start: RobotState) -> Trajectory:
    """Follow the wheels: the path (dead reckoning) of measured wheel angles, without any motor model.

    `angle_left`, `angle_right` [rad] are cumulative and have shape (T + 1,); so have the results, with candidates
    behind. Wheel speeds are not known and come back as NaN.
    """
    candidates = max(np.ndim(value) for value in (*parameters, *start))
    in_time = (slice(None), *(np.newaxis,) * candidates)
    left, right = np.diff(angle_left)[in_time], np.diff(angle_right)[in_time]
    angle = turn(left, right, parameters)
    theta = _accumulate(start.theta, angle)
    dx, dy = arc(theta[:-1], forward(left, right, parameters), angle)
    unknown = np.full(len(angle_left), np.nan)
    x, y = _accumulate(start.x, dx), _accumulate(start.y, dy)
    return Trajectory(x, y, theta, unknown, unknown, angle_left, angle_right)


def _accumulate(first: Any, increments: Any) -> Any:
    """Return the running sum of `increments` along time, from `first` on; one entry longer than `increments`."""
    total = np.empty((len(increments) + 1, *np.broadcast_shapes(increments.shape[1:], np.shape(first))))
    total[0] = first
    np.cumsum(increments, axis=0, out=total[1:])
    total[1:] += first
    return total
