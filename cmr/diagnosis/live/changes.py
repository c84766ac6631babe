"""Possible changes of a robot, its floor or its sensors, as shifts of the measures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from cmr.diagnosis.live.measures import common, opposite
from cmr.diagnosis.live.second import Second

Shifts: TypeAlias = Mapping[str, float]  # by measure
Sizes: TypeAlias = Mapping[str, float]  # by change


@dataclass(frozen=True)
class Change:
    """One way to change. `size` is the size to detect; less than half of it is ignored, and more than `largest` is
    implausible.

    `shifts` gives the shift of each measure in a second for a size of 1. `clause` describes the observation in words,
    for a size.
    """

    name: str
    size: float
    shifts: Callable[[Second], Shifts]
    clause: Callable[[float], str]
    largest: float = 1.1


def per_cent(size: float) -> str:
    """Format a share as in `6 %`."""
    return f"{100.0 * abs(size):.0f} %"


def _wheels(left: float, right: float) -> Shifts:
    return {"drive": common(left, right), "steer": opposite(left, right)}


def _ground(second: Second, left: float, right: float) -> Shifts:
    """Return the shifts if the sides travel less far over the ground than their wheels turned, by these shares [-]."""
    parameters = second.parameters
    lost_left, lost_right = (
        share * parameters.wheel_radius * angle for share, angle in zip((left, right), second.turned, strict=True)
    )
    turn = -(lost_right - lost_left) / parameters.base_width
    return {"forward": -common(lost_left, lost_right), **_turn(turn)}


def _turn(angle: float) -> Shifts:
    """Return the shifts if the robot turns by this angle [rad] more than its wheels indicate."""
    return {"turn_by_gyro": angle, "turn_by_pose": angle}


def _gyro(angle: float) -> Shifts:
    """Return the shifts where the gyro reports this angle [rad] too much."""
    return {"turn_by_gyro": angle, "heading": -angle}


def _pose(forward: float, turn: float) -> Shifts:
    """Return the shifts if the poses move this much further [m], and turn more [rad], than the robot."""
    return {"forward": forward, "turn_by_pose": turn, "heading": turn}


def _of_wheels(side: str) -> Callable[[float], str]:
    return lambda size: (
        f"the {side} wheels run {per_cent(size)} {'faster' if size > 0.0 else 'slower'} for the same commands"
        " than at the start"
    )


def _of_ground(side: str) -> Callable[[float], str]:
    return lambda size: (
        f"the {side} side moves {per_cent(size)} {'less' if size > 0.0 else 'more'} than its wheels turn"
    )


CHANGES = (
    Change(
        "speed",
        0.04,
        lambda second: _wheels(*second.wanted.turned),
        lambda size: (
            f"both sides' wheels run {per_cent(size)} {'faster' if size > 0.0 else 'slower'} "
            "for the same commands than at the start"
        ),
    ),
    Change("left_speed", 0.06, lambda second: _wheels(second.wanted.turned[0], 0.0), _of_wheels("left")),
    Change("right_speed", 0.06, lambda second: _wheels(0.0, second.wanted.turned[1]), _of_wheels("right")),
    Change(
        "response",
        0.4,
        lambda second: _wheels(*(-second.time_constant * change for change in second.wanted.speed_change)),
        lambda size: (
            f"the wheels take {per_cent(size)} {'longer' if size > 0.0 else 'less long'} to follow a change "
            "of the commands than at the start"
        ),
    ),
    Change(
        "turning",
        0.04,
        lambda second: _turn(second.floor.turn),
        lambda size: (
            f"the robot turns {per_cent(size)} {'more' if size > 0.0 else 'less'} "
            "for the same turning of its wheels than at the start"
        ),
    ),
    Change("left_slip", 0.1, lambda second: _ground(second, 1.0, 0.0), _of_ground("left")),
    Change("right_slip", 0.1, lambda second: _ground(second, 0.0, 1.0), _of_ground("right")),
    Change(
        "slip",
        0.1,
        lambda second: _ground(second, 1.0, 1.0),
        lambda size: (
            f"the robot moves and turns {per_cent(size)} {'less far' if size > 0.0 else 'further'} than its wheels turn"
        ),
    ),
    Change(
        "skid",
        0.1,
        lambda second: {"sideways": -second.floor.forward * second.floor.turn},
        lambda size: (
            f"the robot moves {abs(size):.2f} m/s {'outwards' if size > 0.0 else 'inwards'} "
            "at 1 m/s and 1 rad/s, more than at the start"
        ),
    ),
    Change(
        "gyro_offset",
        0.01,
        lambda second: {"gyro_at_rest": 1.0, **_gyro(1.0 if second.moving else 0.0)},
        lambda size: (
            f"the gyro reads {abs(size):.3f} rad/s {'more' if size > 0.0 else 'less'} than at the start, "
            "but wheels and poses do not"
        ),
    ),
    Change(
        "gyro_factor",
        0.05,
        lambda second: _gyro(second.floor.turn),
        lambda size: (
            f"the gyro measures {per_cent(size)} {'larger' if size > 0.0 else 'smaller'} turns than at the "
            "start, but wheels and poses do not"
        ),
    ),
    Change(
        "pose_late",
        0.1,
        lambda second: {
            "sideways": second.floor.lag.sideways,
            **_pose(second.floor.lag.forward, second.floor.lag.turn),
        },
        lambda size: (
            f"the poses follow the motion {abs(size):.2f} s {'later' if size > 0.0 else 'sooner'} than at the start"
        ),
    ),
    Change(
        "pose_way",
        0.05,
        lambda second: {"forward": second.floor.forward},
        lambda size: (
            f"the poses move {per_cent(size)} {'further' if size > 0.0 else 'less far'} than the wheels "
            "compared with the start; turns agree"
        ),
    ),
    Change(
        "pose_still",
        0.5,
        lambda second: _pose(-second.floor.forward, -second.floor.turn),
        lambda size: (
            f"the poses follow the wheels {per_cent(size)} {'less far' if size > 0.0 else 'further'} than at the start"
        ),
    ),
)
BY_NAME = {change.name: change for change in CHANGES}
