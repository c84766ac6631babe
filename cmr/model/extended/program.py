"""One robot's model as plain statements, for translation to other languages.

The statements are those compiled by `cmr.model.extended.compose`, with only the effects that the robot's parameters
switch on. They are Python assignments with conditional expressions and calls of the functions in
`cmr.model.stages.FUNCTIONS`, of those in `helpers()` and of `sincos`; nothing about an effect is repeated.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from cmr.model.catalogue import LAWS, effects_on
from cmr.model.effect import Effect
from cmr.model.extended.statements import Statements, memories
from cmr.model.extended.step_statements import CHANGED, COLLOCATION, HELD, NOT_LATE, step_parts
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import ParameterDefinition, RobotParameters

HELPERS = "cmr.model.extended.step_helpers"
OF_SENSORS = ("encoder_time", "encoder", "gyro_time", "gyro", "pose_time", "pose")


@dataclass(frozen=True)
class Constant:
    """A number read by statements, with its meaning."""

    value: float
    definition: ParameterDefinition


@dataclass(frozen=True)
class Program:
    """The statements of one robot. Names in them are variables, `constants`, or those of COLLOCATION.

    `state` is kept between steps. `begin` sets memory and `duty_left`, `duty_right`, which hold the speeds, from
    psi_left and psi_right. `packet` sets `delay` [s] and `lost` of the command with number `count`, using `dt`, `seed`
    and `robot`. `step` maps command_left, command_right, dt and COEFFICIENTS to the new state, and sets `yaw_rate_end`
    [rad/s]. `sensors` are stages by name, without laws: they change `moment` (initially the stamp), `filtered`,
    `reading` (per side: reading_left, reading_right) and x, y, theta, and read `time`, the stamp.
    """

    effects: tuple[Effect, ...]
    constants: Mapping[str, Constant]
    memory: tuple[str, ...]
    begin: list[str]
    packet: list[str]
    step: list[str]
    sensors: Mapping[str, list[str]]

    @property
    def state(self) -> tuple[str, ...]:
        """The names of the values kept between steps."""
        return (*CHANGED, *self.memory)

    @property
    def is_late(self) -> bool:
        """Whether commands are delayed or lost."""
        return self.packet != NOT_LATE


def program_of(parameters: RobotParameters) -> Program:
    """Return the statements of one robot with numeric parameters.

    Raises KeyError for an unknown parameter.
    """
    effects = effects_on(parameters.values)
    motion = [effect for effect in effects if not effect.is_sensor]
    # Laws of sensors read the motion at the sensor's time, which is not part of these stages.
    sensing = [effect for effect in effects if effect.is_sensor and effect.name not in LAWS]
    constants = _constants(effects, parameters)
    of_motion, of_sensors = Statements(motion, constants), Statements(sensing, constants)
    return Program(
        effects=tuple(effects),
        constants=constants,
        memory=tuple(memories(motion)),
        begin=[*(f"{name} = 0.0" for name in memories(motion)), *HELD, *of_motion.both("start")],
        packet=[*NOT_LATE, *of_motion.of("packet")],
        step=[line for part in step_parts(of_motion) for line in part],
        sensors={stage: _sensor(of_sensors, stage) for stage in OF_SENSORS},
    )


def _sensor(statements: Statements, stage: str) -> list[str]:
    return statements.both(stage) if stage == "encoder" else statements.of(stage)


def _constants(effects: list[Effect], parameters: RobotParameters) -> dict[str, Constant]:
    """Return the paper's parameters and those of the effects; missing ones are neutral."""
    definitions = [*PAPER.values(), *(parameter for effect in effects for parameter in effect.all_parameters)]
    values = {**{one.name: one.neutral for one in definitions}, **parameters.values}  # all of the paper's are given
    return {one.name: Constant(float(values[one.name]), one) for one in definitions}


@cache
def helpers() -> dict[str, ast.FunctionDef]:
    """Return the non-elementary functions that statements may call, by name, without decorators.

    They are read as source, because importing them would import Numba. `random_number` uses 64-bit arithmetic with
    wrap-around.
    """
    specification = find_spec(HELPERS)
    assert specification is not None, f"{HELPERS} is part of this package"
    assert specification.origin is not None, f"{HELPERS} is a file"
    tree = ast.parse(Path(specification.origin).read_text(encoding="utf-8"))
    found = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    for function in found.values():
        function.decorator_list = []
    return found


@cache
def collocation() -> dict[str, float]:
    """Return the constants of COLLOCATION by name."""
    scope: dict[str, float] = {}
    exec(COLLOCATION, {}, scope)
    return scope
