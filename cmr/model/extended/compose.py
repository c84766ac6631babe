"""Compose the extended model: Python source of one compiled step with the statements of all given effects.

What the step is, `step_statements` says. There is no branch in it: choices become selections, and the loops over LANES
robots are vectorised.

Only this, and what else effects say, is composed: `step`, `begin` and `packet`. The loops around it are ordinary
functions, in `stepping`; they know the rows that every robot has by the numbers below. The one over blocks is composed
too: in a function of its own, the compiler makes the step slower by an eighth.
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

LANES = 16  # robots side by side; the distance between rows is known to the compiler, so it sees that none overlap
ABREAST = 8  # robots that a processor's widest registers take at once
COMMANDS = ("command_left", "command_right", "left_before", "right_before")
# The rows that every robot has, whatever effects there are, before its memory: see `Layout`.
ALWAYS = ("dt", *COEFFICIENTS, *_PAPER, *COMMANDS, *CHANGED)
YAW_RATES = ("yaw_rate_first", "yaw_rate_second", "yaw_rate_end")  # what a step also leaves, behind all rows
# Where they begin, in numbers, from the beginning of a block. What is `DT` here is `dt` in the statements of effects.
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
    """Let a step pass for the first `lanes` robots of each block: all, or as many as ABREAST goes into.

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
    """Where something ends in a block of robots with some effects, in numbers from the block's beginning.

    First come the rows of `ALWAYS`, then memory, up to `memory`; what late commands depend on, up to `own`: so much
    each robot has for itself; and the other parameters, up to `size`. Behind that a step leaves YAW_RATES.
    """

    memory: int
    own: int
    size: int


def rows_of(effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]) -> list[str]:
    """Return the names of a robot's rows: those of all robots, memory, and the parameters of effects."""
    return [*ALWAYS, *memories(effects), *(name for name in definitions if name not in _PAPER)]


def layout_of(effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]) -> Layout:
    """Return where the parts of a block end."""
    memory = len(ALWAYS) + len(memories(effects))
    own = memory + sum(len(effect.parameters) for effect in late(effects))
    return Layout(*(LANES * rows for rows in (memory, own, len(rows_of(effects, definitions)))))


def compose(effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]) -> str:
    """Return the source of a module with what these effects do in a step, where a drive begins, and to a command.

    `definitions` are the parameters that robots have: the paper's first, then those of effects with a stage `packet`.
    Those of sensors need not be among them. Raises ValueError where a statement reads a name that nothing gives it.
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
    """Return the effects that make commands late or lose them."""
    return [effect for effect in effects if "packet" in effect.equations]


def _start(
    statements: Statements, effects: Sequence[Effect], definitions: Mapping[str, ParameterDefinition]
) -> list[str]:
    """Return the lines that set the memory of a robot where a drive begins."""
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
    """Return the lines that say how late a robot's command comes, or that it is lost."""
    own = [*_PAPER, *(parameter.name for effect in late(effects) for parameter in effect.parameters)]
    return [
        *(f"{name} = rows[{name.upper()} + i]" for name in own),
        *NOT_LATE,
        *statements.of("packet"),
    ]


def _indented(lines: Iterable[str], by: int) -> str:
    return "".join(" " * by + line + "\n" for line in lines)
