"""The effect of each catalogue entry on a figure-eight, enlarged to be visible."""

from dataclasses import dataclass

import numpy as np

from cmr.model.catalogue import typical, with_effects
from cmr.model.effect import Effect
from cmr.model.motion import Floats, RobotState, Trajectory, drive, roll
from cmr.model.parameters import RobotParameters
from cmr.model.sensors import Readings, read_sensors

ROBOT = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.161)
LAP = 20.0  # s
DT = 0.01  # s
# A heading amplitude at the first zero of the Bessel function J0 closes the path to an eight.
SWING = 2.404825557695773  # rad
FORWARD = 0.42  # duty
VISIBLE = 0.1  # m, or rad of an angle: smallest visible change
FACTORS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0, 70.0, 100.0)


@dataclass(frozen=True)
class Showcase:
    """One lap without and with an effect of `factor` times its typical size; `time` [s] are those of all arrays."""

    effect: Effect
    factor: float
    values: dict[str, float]
    time: Floats
    without: Trajectory
    motion: Trajectory
    seen: Readings


def figure_eight() -> tuple[Floats, Floats]:
    """Return the duties of one lap, one per step."""
    time = np.arange(round(LAP / DT)) * DT
    yaw_rate = SWING * 2.0 * np.pi / LAP * np.sin(2.0 * np.pi * time / LAP)
    turning = yaw_rate * ROBOT.base_width * ROBOT.k1 / (2.0 * ROBOT.wheel_radius)
    return FORWARD - turning, FORWARD + turning


def showcase(effect: Effect) -> Showcase:
    """Return the effect on one lap, at the smallest of the sizes in FACTORS at which it is visible."""
    possible = [shown for factor in FACTORS if (shown := _at(effect, factor)) is not None]
    return next((shown for shown in possible if _shift(shown) > VISIBLE), possible[-1])


def _at(effect: Effect, factor: float) -> Showcase | None:
    """Return the effect at a multiple of its typical size; None if that is out of bounds."""
    values = _sizes(effect, factor)
    if not all(parameter.allows(values[parameter.name]) for parameter in effect.parameters):
        return None
    parameters = with_effects(ROBOT, values)
    duties = figure_eight()
    spans = np.full(len(duties[0]), DT)
    time: Floats = np.arange(len(spans) + 1, dtype=float) * DT
    without = drive(*duties, spans, ROBOT, RobotState.at_rest())
    motion = drive(*duties, spans, parameters, RobotState.at_rest())
    return Showcase(
        effect, factor, values, time, without, motion, read_sensors(time, motion, parameters, time, time, time)
    )


def _sizes(effect: Effect, factor: float) -> dict[str, float]:
    """Return the parameters at a multiple of their typical size, limits at a fraction; times are halfway."""
    values = typical(effect)
    for parameter in effect.parameters:
        if parameter.kind == "time":
            values[parameter.name] = LAP / 2.0
        elif parameter.switches:
            values[parameter.name] *= 1.0 / factor if parameter.is_limit else factor
    return values


def _shift(shown: Showcase) -> float:
    """Return the change of the path [m], or of poses, wheel angles or the integrated gyro [m, rad]."""
    if not shown.effect.is_sensor:
        return _distance(shown.motion, shown.without)
    poses = float(np.hypot(shown.seen.x - shown.motion.x, shown.seen.y - shown.motion.y).max())
    gyro = float(np.abs(np.cumsum(shown.seen.yaw_rate - np.gradient(shown.motion.theta, shown.time))).max() * DT)
    wheels = float(np.abs(shown.seen.angle_left - shown.motion.angle_left).max())
    return max(poses, wheels, gyro, heading_error(shown))


def heading_error(shown: Showcase) -> float:
    """Return the largest change of the measured headings [rad]; 0 for a clock effect."""
    if "pose" not in shown.effect.equations:
        return 0.0
    return float(np.abs(shown.seen.theta - shown.motion.theta).max())


def reckoned(shown: Showcase) -> Trajectory:
    """Return the dead-reckoned path of the encoders, from the first measured pose on."""
    seen = shown.seen
    start = RobotState.at_rest(seen.x[0], seen.y[0], seen.theta[0])
    return roll(seen.angle_left, seen.angle_right, ROBOT, start)


def _distance(first: Trajectory, second: Trajectory) -> float:
    return float(np.hypot(first.x - second.x, first.y - second.y).max())
