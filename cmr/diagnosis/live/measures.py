"""The differences measured in each second, and regressors that explain them without a change.

No robot matches its model exactly. Initial deviations proportional to these regressors are learned (`expectation`) and
expected: they are effects of the catalogue to first order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from cmr.diagnosis.live.second import Second

MOVING_SECONDS, RESTING_SECONDS = 20, 3  # seconds learned before judging

Row = tuple[float, ...]


@dataclass(frozen=True)
class Measure:
    """One difference, in `unit`: measured minus predicted value of a second; NaN if unknown.

    `regressors` of a second may explain it; `prior` are the usual sizes of their coefficients. `scale` is roughly the
    expected noise, which grows with distance. It is judged after `fewest` seconds of learning.
    """

    name: str
    unit: str
    value: Callable[[Second], float]
    regressors: Callable[[Second], Row]
    prior: Row
    scale: Callable[[Second], float]
    fewest: int = MOVING_SECONDS


def common(left: float, right: float) -> float:
    """Return the mean of both sides."""
    return (left + right) / 2.0


def opposite(left: float, right: float) -> float:
    """Return the component that turns the robot counter-clockwise."""
    return (right - left) / 2.0


def _drive(second: Second) -> float:
    return common(*second.turned) - common(*second.wanted.turned)


def _drive_regressors(second: Second) -> Row:
    speed, steer = common(*second.wanted.turned), opposite(*second.wanted.turned)
    friction, drag = common(*second.wanted.direction), common(*second.wanted.square)
    return speed, steer, friction, drag, common(*second.wanted.speed_change), math.copysign(steer, speed)


def _steer(second: Second) -> float:
    return opposite(*second.turned) - opposite(*second.wanted.turned)


def _steer_regressors(second: Second) -> Row:
    speed, steer = common(*second.wanted.turned), opposite(*second.wanted.turned)
    friction, drag = opposite(*second.wanted.direction), opposite(*second.wanted.square)
    return steer, speed, friction, drag, opposite(*second.wanted.speed_change)


def _wheel_scale(second: Second) -> float:
    return math.hypot(0.02, 0.003 * common(*map(abs, second.wanted.turned)))


def _turn_by_gyro(second: Second) -> float:
    return second.gyro - second.floor.turn if second.moving else math.nan


def _turn_by_pose(second: Second) -> float:
    known = second.pose is not None and second.moving and math.isnan(second.gyro)
    return second.pose.turn - second.floor.turn if known and second.pose else math.nan


def _turn_regressors(second: Second) -> Row:
    floor = second.floor
    straight = floor.forward / second.parameters.base_width
    return floor.turn, straight, floor.turn_square, floor.turn_path, floor.lag.turn


def _slip_of_turns(second: Second) -> float:
    return 0.003 * common(*second.floor.path) / float(second.parameters.base_width)


def _heading(second: Second) -> float:
    return second.pose.turn - second.gyro if second.pose and second.moving else math.nan


def _forward(second: Second) -> float:
    return second.pose.forward - second.floor.forward if second.pose and second.moving else math.nan


def _sideways(second: Second) -> float:
    return second.pose.sideways - second.floor.sideways if second.pose and second.moving else math.nan


def _place_scale(second: Second) -> float:
    return math.hypot(0.006, 0.005 * common(*second.floor.path))


MEASURES = (
    Measure("drive", "rad", _drive, _drive_regressors, (0.2, 0.2, 2.0, 0.2, 0.3, 0.2), _wheel_scale),
    Measure("steer", "rad", _steer, _steer_regressors, (0.3, 0.1, 2.0, 0.2, 0.3), _wheel_scale),
    Measure(
        "turn_by_gyro",
        "rad",
        _turn_by_gyro,
        lambda second: (*_turn_regressors(second), 1.0),
        (0.3, 0.1, 0.1, 0.1, 0.3, 0.05),
        lambda second: math.hypot(0.002, _slip_of_turns(second)),
    ),
    Measure(
        "turn_by_pose",
        "rad",
        _turn_by_pose,
        _turn_regressors,
        (0.3, 0.1, 0.1, 0.1, 0.3),
        lambda second: math.hypot(0.006, _slip_of_turns(second)),
    ),
    Measure(
        "heading",
        "rad",
        _heading,
        lambda second: (second.gyro, second.floor.lag.turn, 1.0),
        (0.1, 0.3, 0.05),
        lambda _second: 0.006,
    ),
    Measure(
        "forward",
        "m",
        _forward,
        lambda second: (second.floor.forward, second.floor.lag.forward, second.floor.forward * abs(second.floor.turn)),
        (0.2, 0.3, 0.1),
        _place_scale,
    ),
    Measure(
        "sideways",
        "m",
        _sideways,
        lambda second: (
            second.floor.forward,
            second.floor.turn,
            second.floor.forward * second.floor.turn,
            second.floor.lag.sideways,
        ),
        (0.1, 0.3, 0.5, 0.3),
        _place_scale,
    ),
    Measure(
        "gyro_at_rest",
        "rad",
        lambda second: second.gyro if second.resting else math.nan,
        lambda _second: (1.0,),
        (0.05,),
        lambda _second: 0.002,
        RESTING_SECONDS,
    ),
)
