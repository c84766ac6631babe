"""Compose the effects of sensors: functions that turn the motion in a block's `own` into readings.

Only the statements of effects are composed. The loops around them (`loops`, `ideal_sensors`) are compiled once, for all
effects and laws, and call these functions by their addresses.
"""

import ast
from collections.abc import Sequence
from textwrap import indent
from types import ModuleType
from typing import NamedTuple

from cmr.model.catalogue import CATALOGUE, DEFINITIONS, LAWS, remembered
from cmr.model.compiled import address
from cmr.model.effect import Effect
from cmr.model.extended.compose import LANES
from cmr.model.extended.model import composed_module
from cmr.model.extended.statements import OF_MOTION, Statements, read_by
from cmr.model.observer.helpers import SENSORS
from cmr.model.observer.structures import Sensors
from cmr.model.parameters import DEFINITIONS as PAPER

SOURCE = '''"""Composed by cmr.model.observer.sensor_effects. Do not edit: it is rewritten when an effect changes."""

from math import inf, pi, sqrt

from numpy import floor

from cmr.model.compiled import compiled
from cmr.model.elementary import cos, exp, sin
from cmr.model.extended.step_helpers import sign, where
from cmr.model.observer.helpers import (
    AT_THETA, AT_TIME, AT_X, AT_Y, EAST_X, EAST_Y, FILTERED, GYRO_AT, GYRO_READING, GYRO_SPEED, GYRO_THETA, GYRO_X,
    GYRO_Y, NEARBY, NORTH_X, NORTH_Y, POSE_SPEED, POSE_YAW_RATE, READING_LEFT, READING_RIGHT, SEEN_THETA, SEEN_X,
    SEEN_Y,
)

ROWS

@compiled("void(f8[::1], f8, i8)")
def gyro_time(own, time, lanes):
    """Write the moment [s] that a gyro reading shows."""
    for i in range(lanes):
        moment = time
    GYRO_TIME
        own[GYRO_AT + i] = moment


@compiled("void(f8[::1], f8, i8)")
def gyro(own, time, lanes):
    """Replace the yaw rate by the reading."""
    for i in range(lanes):
        yaw_rate = own[GYRO_READING + i]
        reading = yaw_rate
    GYRO
        own[GYRO_READING + i] = reading


@compiled("void(f8[::1], f8, i8)")
def encoder(own, time, lanes):
    """Replace the angles of the wheels by the readings."""
    for i in range(lanes):
        reading_left, reading_right = own[READING_LEFT + i], own[READING_RIGHT + i]
    ENCODER
        own[READING_LEFT + i], own[READING_RIGHT + i] = reading_left, reading_right


@compiled("void(f8[::1], f8, i8)")
def pose_time(own, time, lanes):
    """Write the moment [s] that a pose shows, and the time constant [s] of its filter."""
    for i in range(lanes):
        moment, filtered = time, 0.0
    POSE_TIME
        own[AT_TIME + i], own[FILTERED + i] = moment, filtered


@compiled("void(f8[::1], f8, i8)")
def pose(own, time, lanes):
    """Write the readings of robots displaced by NEARBY to the east, and to the north, and of the robots themselves."""
    for i in range(lanes):
        x, y, theta = own[AT_X + i] + NEARBY, own[AT_Y + i], own[AT_THETA + i]
    POSE
        own[EAST_X + i], own[EAST_Y + i] = x, y
        x, y, theta = own[AT_X + i], own[AT_Y + i] + NEARBY, own[AT_THETA + i]
    POSE
        own[NORTH_X + i], own[NORTH_Y + i] = x, y
        x, y, theta = own[AT_X + i], own[AT_Y + i], own[AT_THETA + i]
    POSE
        own[SEEN_X + i], own[SEEN_Y + i], own[SEEN_THETA + i] = x, y, theta
'''


def sensor_laws(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return the names of those of the effects that are laws of sensors."""
    return tuple(effect.name for effect in effects if effect.is_sensor and effect.name in LAWS)


@remembered
def parameters_read(laws: tuple[str, ...]) -> tuple[str, ...]:
    """Return the parameters that effects of sensors and these laws may read: the paper's, then their own.

    They are the rows of `own` from SENSORS on.
    """
    return (*PAPER, *(parameter.name for effect in _effects(laws) for parameter in effect.all_parameters))


class Sensing(NamedTuple):
    """Effects of sensors, compiled: `sensors` are addresses within the `module`, which is kept with them."""

    module: ModuleType
    sensors: Sensors


@remembered
def sensing(laws: tuple[str, ...]) -> Sensing:
    """Return the compiled effects of sensors: those of the catalogue, and these laws."""
    effects = _effects(laws)
    module = composed_module(lambda: _source(laws), effects)
    sensors = Sensors(
        gyro_time=address(module.gyro_time),
        gyro=address(module.gyro),
        encoder=address(module.encoder),
        pose_time=address(module.pose_time),
        pose=address(module.pose),
        gyro_moves=any(read_by(effect, "gyro") & {*OF_MOTION["gyro"]} for effect in effects),
        pose_moves=any(read_by(effect, "pose") & {*OF_MOTION["pose"]} for effect in effects),
    )
    return Sensing(module, sensors)


def _effects(laws: tuple[str, ...]) -> list[Effect]:
    return [one for name, one in CATALOGUE.items() if one.is_sensor and (name not in LAWS or name in laws)]


def _source(laws: tuple[str, ...]) -> str:
    """Return the source of the functions with these effects."""
    statements, parameters = Statements(_effects(laws), DEFINITIONS), parameters_read(laws)
    rows = [f"{name.upper()} = {SENSORS + LANES * row}" for row, name in enumerate(parameters)]
    source = SOURCE.replace("ROWS\n", "\n".join([*rows, ""]))
    for stage in ("gyro_time", "gyro", "encoder", "pose_time", "pose"):
        lines = statements.both(stage) if stage == "encoder" else statements.of(stage)
        names = {node.id for node in ast.walk(ast.parse("\n".join(lines))) if isinstance(node, ast.Name)}
        given = {name: name for name in parameters} | {name: f"{stage}_{name}" for name in OF_MOTION.get(stage, ())}
        reads = [f"{name} = own[{row.upper()} + i]" for name, row in given.items() if name in names]
        source = source.replace(f"    {stage.upper()}\n", indent("\n".join([*reads, *lines, ""]), " " * 8))
    return source
