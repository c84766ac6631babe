"""The model with effects: composed from the catalogue, written to a cache folder, compiled when first needed."""

import hashlib
import importlib.util
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.litter import temporary_beside
from cmr.model.cache import cache_folder
from cmr.model.catalogue import CATALOGUE, GENERIC_TERMS, LAWS, MODELLED, needed, remembered
from cmr.model.effect import Effect
from cmr.model.extended.compose import LANES, RECORDED, compose, late, layout_of, rows_of
from cmr.model.extended.step_statements import LONGEST_STEP
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import ParameterDefinition

if TYPE_CHECKING:
    from cmr.model.extended.stepping import Equations

Floats = NDArray[np.float64]
START = ("x", "y", "theta", "psi_left", "psi_right")
CACHE_LINE = 64  # bytes


class ExtendedModel:
    """The compiled model with some effects; `row` gives the row of each value of a robot, `layout` the parts of a
    block.
    """

    def __init__(self, effects: Sequence[Effect]) -> None:
        self.effects = tuple(effect for effect in effects if not effect.is_sensor)
        self.late = [parameter for effect in late(self.effects) for parameter in effect.parameters]
        others = [parameter for effect in self.effects for parameter in effect.all_parameters]
        self.definitions = {parameter.name: parameter for parameter in (*PAPER.values(), *self.late, *others)}
        self.row = {name: index for index, name in enumerate(rows_of(self.effects, self.definitions))}
        self.layout = layout_of(self.effects, self.definitions)
        self._module: Any = composed_module(lambda: compose(self.effects, self.definitions), self.effects)
        self.work: int = self._module.WORK  # work space of a step

    @property
    def step(self) -> Any:
        """The compiled step of robots (`cmr.model.extended.compose`), callable from Python."""
        return self._module.step

    @cached_property
    def equations(self) -> "Equations":
        """The compiled equations of the effects."""
        from cmr.model.compiled import address
        from cmr.model.extended.stepping import Equations

        return Equations(*(address(getattr(self._module, name)) for name in Equations._fields))

    def on(self, values: Mapping[str, ArrayLike], shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Return for which robots the values, by name, switch on an effect on the motion."""
        return self._differs([p for effect in self.effects for p in effect.parameters if p.switches], values, shape)

    def packets_under_way(self, values: Mapping[str, Floats], dt: Floats) -> int:
        """Return the largest number of commands in transit, one per step of `dt` [s]; 0 without delays."""
        late = {parameter.name: parameter for parameter in self.late if parameter.name in values}
        if not np.any(self._differs(list(late.values()), values, values["k1"].shape)):
            return 0
        longest = sum(float(np.max(values[name])) for name, parameter in late.items() if parameter.unit == "s")
        ends = np.cumsum(dt)
        return int(np.max(np.searchsorted(ends, ends + longest, side="right") - np.arange(len(ends)), initial=1)) + 1

    def robots(self, values: Mapping[str, Floats], start: Sequence[Floats] | Floats, time: float) -> "Blocks":
        """Return robots with these values, by name, starting at these states: x, y, theta and both psi."""
        return Candidates(self, values, len(start[0])).begun(start, time)

    def _differs(
        self, definitions: Sequence[ParameterDefinition], values: Mapping[str, ArrayLike], shape: tuple[int, ...]
    ) -> NDArray[np.bool_]:
        result = np.zeros(shape, dtype=bool)
        for definition in definitions:
            if definition.name in values:
                result |= np.asarray(values[definition.name]) != definition.neutral
        return result


class Candidates:
    """Robots with these values, by name, not yet started: they can start at many states."""

    def __init__(self, model: ExtendedModel, values: Mapping[str, Floats], count: int) -> None:
        self.model = model
        self._count = count
        lanes = np.arange(-(-count // LANES) * LANES)
        self._filled = np.minimum(lanes, count - 1)  # remaining lanes repeat the last robot
        self._rows = np.zeros((len(lanes) // LANES, len(model.row), LANES))
        for name, definition in model.definitions.items():
            given = values[name][self._filled].reshape(-1, LANES) if name in values else definition.neutral
            self._rows[:, model.row[name]] = given
        own = model.layout.own // LANES
        differ = np.any(self._rows != self._rows[:1, :, :1], axis=(0, 2))
        self._places = own + np.flatnonzero(differ[own:])

    @property
    def rows(self) -> Floats:
        """All rows of all blocks, flat: robots at the origin, without memory; read-only."""
        return self._rows.reshape(-1)

    def begun(self, start: Sequence[Floats] | Floats, time: float) -> "Blocks":
        """Return the robots at these states: x, y, theta and both psi, each (count,)."""
        from cmr.model.extended.stepping import start as start_all

        rows = self._rows.copy()
        for name, numbers in zip(START, start, strict=True):
            rows[:, self.model.row[name]] = np.asarray(numbers)[self._filled].reshape(-1, LANES)
        rows[:, self.model.row["time"]] = time
        start_all(self.model.equations.begin, rows.reshape(-1), self.model.layout.size)
        return Blocks(self.model, rows, self._places)


class Blocks:
    """Robots arranged for the compiled functions.

    Robots are arranged in blocks of LANES. A block has its own rows for changing values, and for parameters that differ
    between robots, at `places`; shared parameters exist once, in `work`, where a block is computed. That halves the
    memory traffic.
    """

    def __init__(self, model: ExtendedModel, rows: Floats, places: NDArray[np.int64]) -> None:
        from cmr.model.extended.stepping import Robots

        own = model.layout.own // LANES
        self._row = model.row
        flat = aligned(len(rows) * (own + len(places)) * LANES)
        self.rows = flat.reshape(len(rows), own + len(places), LANES)
        self.rows[:, :own], self.rows[:, own:] = rows[:, :own], rows[:, places]
        self.stride = LANES * self.rows.shape[1]
        work = aligned(model.work)
        work[: model.layout.size] = rows[0].reshape(-1)
        self.arguments: Robots = Robots(flat, work, places * LANES)

    def put(self, name: str, values: Floats, slots: NDArray[np.int64]) -> None:
        """Set changing values, by name, of the robots in these slots."""
        self.rows[slots // LANES, self._row[name], slots % LANES] = values

    def all(self, name: str) -> Floats:
        """Return changing values, by name, of all robots, and of the remaining lanes."""
        return np.asarray(self.rows[:, self._row[name]].reshape(-1))

    def get(self, name: str, slots: NDArray[np.int64]) -> Floats:
        """Return changing values, by name, of the robots in these slots."""
        return np.asarray(self.rows[slots // LANES, self._row[name], slots % LANES])


def aligned(count: int) -> Floats:
    """Return zeros aligned to a cache line: otherwise a step takes up to a quarter longer."""
    numbers = np.zeros(count + CACHE_LINE // 8)
    first = -numbers.ctypes.data % CACHE_LINE // 8
    return numbers[first : first + count]


def model_of(names: Collection[str]) -> ExtendedModel:
    """Return the model for parameters with these names: generic terms and laws are included only if used.

    Generic terms would slow down all other models by an eighth.
    """
    used = {effect.name for effect in needed(MODELLED, names) if effect.name in LAWS}
    return _extended_model(
        any(parameter.name in names for e in GENERIC_TERMS.values() for parameter in e.parameters), frozenset(used)
    )


@remembered
def _extended_model(generic: bool, laws: frozenset[str]) -> ExtendedModel:
    """Return the model with all effects of the catalogue, of laws these, with or without generic terms."""
    effects = MODELLED if generic else CATALOGUE
    return ExtendedModel([effect for name, effect in effects.items() if name not in LAWS or name in laws])


def drive(
    left: Floats,
    right: Floats,
    dt: Floats,
    values: Mapping[str, Floats],
    start: Sequence[Floats] | Floats,
    at: NDArray[np.int64],
    time: float = 0.0,
    seed: int = 0,
    model: ExtendedModel | None = None,
) -> Floats:
    """Drive T spans with C candidates and return the states at the borders `at`, shape (7, len(at), C).

    `values` by name and `start` (x, y, theta, psi_left, psi_right) have shape (C,). `time` [s] is that of the first
    border; `seed` determines the random numbers, equal for all candidates.
    """
    from cmr.model.extended.stepping import Spans
    from cmr.model.extended.stepping import drive as drive_all

    model = model or model_of(values)
    count = len(start[0])
    parts = np.ceil(dt / LONGEST_STEP).astype(np.int64)  # none for a span without duration
    borders = np.concatenate([[0], np.cumsum(parts)])[at]
    spans = Spans(*(np.repeat(array, parts) for array in (left, right, dt / np.maximum(parts, 1))))
    blocks = model.robots(values, start, time)
    recorded = np.empty((len(at), count, RECORDED))
    ring = model.packets_under_way(values, spans.dt)
    drive_all(model.equations, model.layout.own, blocks.arguments, count, spans, ring, seed, borders, recorded)
    return np.ascontiguousarray(recorded.transpose(2, 0, 1))


def composed_module(compose: Callable[[], str], parts: object) -> ModuleType:
    """Return the module composed from these parts, loaded from or written to the cache folder, and compiled by Numba.

    Like Numba's own cache, it is reused until a source file of the model or the parts change.
    """
    key = hashlib.sha256(_sources() + repr(parts).encode()).hexdigest()[:16]
    name = f"cmr_model_{key}"
    path = cache_folder() / f"{name}.py"
    if not path.exists():
        temporary = temporary_beside(path)
        temporary.write_text(compose(), encoding="utf-8")
        temporary.replace(path)
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None:
        raise ImportError(f"cannot load {path}")
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # where Numba searches for it when it loads code compiled by another process
    specification.loader.exec_module(module)
    return module


@cache
def _sources() -> bytes:
    """Return a digest of the model's source files."""
    folder = Path(__file__).parents[1]
    return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(folder.rglob("*.py")))).digest()
