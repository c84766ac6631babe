"""Compose the extended model: Python source of one compiled step with the statements of all given effects.

The step is defined in `step_statements`. It has no branches: choices become selections, and loops over LANES robots are
vectorised.

Only this and other stages of effects are composed: `step`, `begin` and `packet`. The loops around them are ordinary
functions in `stepping`, which use the fixed row numbers below. The loop over blocks is composed too: in a separate
function, the step would be slower by an eighth.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from cmr.model.effect import Effect
from cmr.model.extended.loops import loops
from cmr.model.extended.statements import SIDES, Statements, memories
from cmr.model.extended.step_statements import (
    CHANGED,
    COEFFICIENTS,
    COLLOCATION,
    HELD,
    NOT_LATE,
    step_parts,
)
from cmr.model.parameters import DEFINITIONS as _PAPER
from cmr.model.parameters import ParameterDefinition

# Robots side by side; the distance between rows is a compile-time constant, so the compiler knows that they do not
# overlap.
LANES = 16
SIMD_WIDTH = 8  # robots per widest SIMD register
COMMANDS = ("command_left", "command_right", "left_before", "right_before")
# The rows common to all robots, before memory: see `Layout`.
ALWAYS = ("dt", *COEFFICIENTS, *_PAPER, *COMMANDS, *CHANGED)
YAW_RATES = ("yaw_rate_first", "yaw_rate_second", "yaw_rate_end")  # what a step also writes, after all rows
# Their offsets from the beginning of a block. `DT` here is `dt` in the statements of effects.
DT, KEPT_FIRST, GAINED_FIRST, GROWN_FIRST, KEPT_SECOND, GAINED_SECOND, GROWN_SECOND = range(0, 7 * LANES, LANES)
KEPT_END, GAINED_END, GROWN_END, WHEEL_RADIUS, K2_OVER_K3, K1, BASE_WIDTH = range(7 * LANES, 14 * LANES, LANES)
COMMAND_LEFT, COMMAND_RIGHT, LEFT_BEFORE, RIGHT_BEFORE, X, Y, THETA = range(14 * LANES, 21 * LANES, LANES)
PSI_LEFT, PSI_RIGHT, ANGLE_LEFT, ANGLE_RIGHT, DOMEGA_LEFT, DOMEGA_RIGHT, TIME = range(21 * LANES, 28 * LANES, LANES)
COEFFICIENTS_END = WHEEL_RADIUS
RECORDED = 7  # rows from X on that a drive records

IMPORTS = f'''"""Composed by cmr.model.extended.compose: do not edit, it is written again whenever an effect changes."""

from math import sqrt

from cmr.model.compiled import compiled, select
from cmr.model.elementary import cos, exp, expm1, sin, sincos
from cmr.model.extended.step_helpers import after, random_number, share, sign

{COLLOCATION}'''
FUNCTIONS = '''

@compiled("void(f8[::1], f8[::1], i8[::1], i8)")
def step(rows, work, varying, lanes):
    """Let a step pass for the first `lanes` robots of each block: all, or as many as SIMD_WIDTH goes into.

    How long it is, each robot has in its row DT, with the coefficients that go with it.
    """
    stride = OWN + len(varying) * LANES
    for block in range(len(rows) // stride):
        here = rows[block * stride : (block + 1) * stride]
        for j in range(OWN):
            work[j] = here[j]
        for row in range(len(varying)):
            place = work[varying[row] : varying[row] + LANES]
            for i in range(LANES):
                place[i] = here[OWN + row * LANES + i]
    STEP
        for j in range(X, MEMORY):
            here[j] = work[j]


@compiled("void(f8[::1])")
def begin(rows):
    """Set the memory of a block of robots to what it is where a drive begins."""
    for i in range(LANES):
    START


@compiled("void(f8[::1], i8[::1], i8, i8, f8[:, ::1])")
def packet(rows, robots, seed, count, lateness):
    """Write how late the next command comes to each robot of a block, and whether it is lost, as 1.0."""
    for i in range(LANES):
        robot, dt = robots[i], rows[DT + i]
    PACKET
        lateness[0, i], lateness[1, i] = delay, 1.0 if lost else 0.0
'''


class Layout(NamedTuple):
    """The ends of the parts of a block of robots with some effects, as offsets from the block's beginning.

    First come the rows of `ALWAYS`, then memory, up to `memory`; then parameters of late commands, up to `own`: these
    are separate for each robot; then the other parameters, up to `size`. After that a step writes YAW_RATES.
    """

    memory: int
    own: int
    size: int


def rows_of(effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]) -> list[str]:
    """Return the names of a robot's rows: those of all robots, memory, and the parameters of effects."""
    return [*ALWAYS, *memories(effects), *(name for name in definitions if name not in _PAPER)]


def layout_of(effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]) -> Layout:
    """Return the ends of the parts of a block."""
    memory = len(ALWAYS) + len(memories(effects))
    own = memory + sum(len(effect.parameters) for effect in late(effects))
    return Layout(*(LANES * rows for rows in (memory, own, len(rows_of(effects, definitions)))))


def compose(effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]) -> str:
    """Return the source of a module with what these effects do in a step, where a drive begins, and to a command.

    `definitions` are the parameters that robots have: the paper's first, then those of effects with a stage `packet`.
    Those of sensors may be missing. Raises ValueError if a statement reads an undefined name.
    """
    statements = Statements(effects, definitions)
    rows = [*rows_of(effects, definitions), *YAW_RATES]
    body, extra = loops(step_parts(statements), rows, (*CHANGED, *memories(effects), "yaw_rate_end"))
    layout, functions = layout_of(effects, definitions), FUNCTIONS
    for place, lines, depth in (
        ("STEP", body, 8),
        ("START", _start(statements, effects, definitions), 8),
        ("PACKET", _packet(statements, effects), 8),
    ):
        functions = functions.replace(f"    {place}\n", _indented(lines, depth))
    constants = {name.upper(): LANES * i for i, name in enumerate((*rows, *extra))}
    return "\n".join(
        [
            *(IMPORTS, f"LANES = {LANES}"),
            *(f"{name} = {value}" for name, value in constants.items()),
            f"MEMORY, OWN, WORK = {layout.memory}, {layout.own}, {LANES * len(constants)}",
            functions,
        ]
    )


def late(effects: Iterable[Effect]) -> list[Effect]:
    """Return the effects that delay or lose commands."""
    return [effect for effect in effects if "packet" in effect.equations]


def _start(
    statements: Statements, effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]
) -> list[str]:
    """Return the lines that initialise the memory of a robot."""
    remembered = memories(effects)
    return [
        *(f"{name} = rows[{name.upper()} + i]" for name in ("psi_left", "psi_right", *definitions)),
        *(f"{name} = 0.0" for name in remembered),
        *HELD,
        *(f"rows[{side.upper()}_BEFORE + i] = duty_{side}" for side in SIDES),
        *statements.both("start"),
        *(f"rows[{name.upper()} + i] = {name}" for name in remembered),
    ]


def _packet(statements: Statements, effects: Sequence[Effect]) -> list[str]:
    """Return the lines that compute the delay of a robot's command, or its loss."""
    own = [*_PAPER, *(parameter.name for effect in late(effects) for parameter in effect.parameters)]
    return [
        *(f"{name} = rows[{name.upper()} + i]" for name in own),
        *NOT_LATE,
        *statements.of("packet"),
    ]


def _indented(lines: Iterable[str], by: int) -> str:
    return "".join(" " * by + line + "\n" for line in lines)
