"""What manoeuvres make of robots: their duties, and the motion that follows by the model."""

from typing import Any

import numpy as np

from cmr.manoeuvres import TYPICAL, in_sequence
from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters

DT = 0.01  # s
SMALL = RobotParameters(wheel_radius=0.042, k2_over_k3=60.0, k1=0.05, base_width=0.17)
LARGE = RobotParameters(wheel_radius=0.165, k2_over_k3=20.0, k1=0.165, base_width=1.0)


def duties_of(name: str, robot: RobotParameters = TYPICAL, speed: float = 1.0) -> tuple[Any, Any, Any]:
    """Return the times [s] of 10 ms steps from beginning to end, and the duties of both sides."""
    duties = in_sequence(name).duties(robot, speed)
    time = np.arange(round(duties.duration / DT) + 1) * DT
    return time, *duties.at(time)


def motion_of(
    name: str,
    robot: RobotParameters = TYPICAL,
    *,
    believed: RobotParameters | None = None,
    gains: tuple[float, float] = (1.0, 1.0),
    speed: float = 1.0,
) -> Trajectory:
    """Return how a robot moves that is believed to have other parameters, and whose motors differ by `gains`."""
    time, left, right = duties_of(name, believed or robot, speed)
    spans = np.full(len(time), DT)
    return drive(gains[0] * left, gains[1] * right, spans, robot, RobotState.at_rest())
