"""Prepare the statements of effects for the step: validate them, and rename variables to avoid collisions."""

import ast
import zlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from textwrap import dedent

from cmr.model.effect import Effect
from cmr.model.stages import ALWAYS, FUNCTIONS, STAGES

SIDES = {"left": 1.0, "right": -1.0}
ACROSS = {"left": "right", "right": "left"}
# Motion variables read by sensor stages beyond what their sensor measures.
OF_MOTION = {"gyro": ("speed", "x", "y", "theta"), "pose": ("speed", "yaw_rate")}
OTHER = "other_"  # prefix of variables of the wheel on the other side
OF_A_SIDE = {name for stage in STAGES.values() if stage.per_side for name in (*stage.changes, *stage.reads)} - {
    *("load_share", "cosine", "sine", "time")
}


def memories(effects: Iterable[Effect], *, lasting: bool = False) -> list[str]:
    """Return the names of all memory in the step, or of `lasting` memory: prefixed by effect, with side."""
    return [
        name
        for effect in effects
        for memory in effect.memory
        if memory.lasting or not lasting
        for name in _for_sides(f"{effect.name}_{memory.name}", memory.per_side)
    ]


def _for_sides(name: str, per_side: bool) -> list[str]:
    return [f"{name}_{side}" for side in SIDES] if per_side else [name]


class Statements:
    """The statements of all effects; `parameters` may be read by all of them.

    Raises ValueError if a statement reads an undefined name.
    """

    def __init__(self, effects: Sequence[Effect], parameters: Collection[str]) -> None:
        self._effects = effects
        self._names = {effect.name: _own_names(effect) for effect in effects}
        for effect in effects:
            for stage in effect.equations:
                _check(effect, stage, {*parameters, *self._names[effect.name]})

    def of(self, stage: str) -> list[str]:
        """Return the statements of a stage for the whole robot."""
        return [line for effect in self._effects for line in self._lines(effect, stage, None)]

    def both(self, stage: str) -> list[str]:
        """Return the statements of a per-side stage, for both sides."""
        return [line for side in SIDES for line in self.of_side(stage, side)]

    def of_side(self, stage: str, side: str) -> list[str]:
        """Return the statements of a per-side stage, for one side."""
        return [line for effect in self._effects for line in self._lines(effect, stage, side)]

    def _lines(self, effect: Effect, stage: str, side: str | None) -> list[str]:
        if stage not in effect.equations:
            return []
        tree = _parsed(effect, stage)
        return ast.unparse(_Rename(effect.name, self._names[effect.name], side).visit(tree)).splitlines()


def _parsed(effect: Effect, stage: str) -> ast.Module:
    try:
        return ast.parse(dedent(effect.equations[stage]))
    except SyntaxError as error:
        raise ValueError(f"effect {effect.name}, stage {stage}: {error}") from None


def changed_by(effect: Effect, stage: str) -> set[str]:
    """Return the variables of a stage that an effect changes."""
    if stage not in effect.equations:
        return set()
    return _stored(effect, stage) & {*STAGES[stage].changes}


def changed_with(effect: Effect, stage: str, variable: str) -> set[str]:
    """Return the names read by the statements of an effect that change a variable of a stage."""
    changes = [
        node
        for node in (_parsed(effect, stage).body if stage in effect.equations else ())
        if isinstance(node, ast.Assign) and variable in map(ast.unparse, node.targets)
    ]
    return {name.id for node in changes for name in ast.walk(node.value) if isinstance(name, ast.Name)}


def read_by(effect: Effect, stage: str) -> set[str]:
    """Return the names read by an effect's statements in a stage."""
    if stage not in effect.equations:
        return set()
    return {node.id for node in ast.walk(_parsed(effect, stage)) if isinstance(node, ast.Name)}


def _stored(effect: Effect, stage: str) -> set[str]:
    nodes = ast.walk(_parsed(effect, stage))
    return {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


def _own_names(effect: Effect) -> dict[str, bool]:
    """Return the names owned by an effect, memory and assigned variables, each with whether it is per side."""
    own = {}
    for memory in effect.memory:
        own[memory.name] = memory.per_side
        if memory.per_side:
            own.update(dict.fromkeys(_for_sides(memory.name, True), False))
    for stage in effect.equations:
        for name in sorted(_stored(effect, stage) - {*STAGES[stage].changes}):
            own.setdefault(name, STAGES[stage].per_side)
    return own


def _check(effect: Effect, name: str, known: set[str]) -> None:
    stage = STAGES[name]
    given = {*known, *FUNCTIONS, *ALWAYS, *stage.changes, *stage.reads, *(("side",) if stage.per_side else ())}
    unknown = sorted(read_by(effect, name) - given)
    if unknown:
        raise ValueError(f"effect {effect.name}, stage {name}: nothing gives {', '.join(unknown)}")


class _Rename(ast.NodeTransformer):
    """Add the side to names in an effect's statements, and the effect's name to its own names."""

    def __init__(self, effect: str, own: Mapping[str, bool], side: str | None) -> None:
        self._effect, self._own, self._side = effect, own, side

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Rename one name."""
        name = node.id
        if name == "side" and self._side:
            return ast.Constant(SIDES[self._side])
        if name == "random":
            stream = zlib.crc32(self._effect.encode())  # separates its random numbers from those of other effects
            return ast.parse(f"random_number(seed, count, robot, {stream})", mode="eval").body
        if name in self._own:
            return self._named(f"{self._effect}_{name}", node, self._own[name])
        if self._side and name in OF_A_SIDE and name.startswith(OTHER):
            return ast.Name(f"{name.removeprefix(OTHER)}_{ACROSS[self._side]}", node.ctx)
        return self._named(name, node, name in OF_A_SIDE)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Pass the step to functions that need it."""
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "after":
            node.args = [ast.Name("time"), ast.Name("dt"), *node.args]
        return node

    def _named(self, name: str, node: ast.Name, per_side: bool) -> ast.Name:
        return ast.Name(f"{name}_{self._side}" if per_side and self._side else name, node.ctx)
