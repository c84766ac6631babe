"""The model with effects: composed from the catalogue, written into a cache folder, compiled when first needed."""

import hashlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmr.model import composed_loops, elementary, step_helpers
from cmr.model.catalogue import CATALOGUE
from cmr.model.compose import LANES, STATE, compose, rows_of
from cmr.model.effect import Effect
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import ParameterDefinition

Floats = NDArray[np.float64]
START = ("x", "y", "theta", "psi_left", "psi_right")
RECORDED = 7
LONGEST_STEP = 0.0100001  # s; longer spans are split


class ExtendedModel:
    """The compiled model with some effects; `module` holds its functions, `row` the place of each number of a robot."""

    def __init__(self, effects: Sequence[Effect]) -> None:
        self.effects = tuple(effect for effect in effects if not effect.is_sensor)
        self.definitions: dict[str, ParameterDefinition] = dict(PAPER)
        for effect in self.effects:
            self.definitions.update({parameter.name: parameter for parameter in effect.parameters})
        self.row = {name: index for index, name in enumerate(rows_of(self.effects, self.definitions))}
        self.late = [
            parameter for effect in self.effects if "packet" in effect.equations for parameter in effect.parameters
        ]
        self.module: Any = _module(compose(self.effects, self.definitions))

    def on(self, values: Mapping[str, Any], shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Tell for which robots the values, by name, switch on any effect on the motion."""
        return self._differs([p for effect in self.effects for p in effect.parameters if p.switches], values, shape)

    def is_late(self, values: Mapping[str, Any], shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Tell for which robots commands may be late or lost."""
        return self._differs(self.late, values, shape)

    def robots(self, values: Mapping[str, Floats], start: Sequence[Floats] | Floats, time: float) -> Floats:
        """Return the rows of robots that start with these values and at these states, shape (blocks, rows, LANES)."""
        count = len(start[0])
        rows = np.ones((-(-count // LANES), len(self.row), LANES))
        rows[:, : len(STATE)] = 0.0
        for name, definition in self.definitions.items():
            if definition.neutral is not None:
                rows[:, self.row[name]] = definition.neutral
            if name in values:
                self.put(rows, name, values[name])
        for name, numbers in zip((*START, "time"), (*start, np.full(count, time)), strict=True):
            self.put(rows, name, numbers)
        flat = rows.reshape(-1)
        for slot in range(count):
            self.module.start(flat, slot)
        return rows

    def put(self, rows: Floats, name: str, values: Any, slots: Any = None) -> None:
        """Write a value of the robots in these slots, by default of the first ones."""
        where = np.arange(len(values)) if slots is None else slots
        rows[where // LANES, self.row[name], where % LANES] = values

    def get(self, rows: Floats, name: str, slots: NDArray[np.int64]) -> Floats:
        """Return a value of the robots in these slots."""
        return np.asarray(rows[slots // LANES, self.row[name], slots % LANES])

    def _differs(
        self, definitions: Sequence[ParameterDefinition], values: Mapping[str, Any], shape: tuple[int, ...]
    ) -> NDArray[np.bool_]:
        result = np.zeros(shape, dtype=bool)
        for definition in definitions:
            if definition.name in values:
                result |= np.asarray(values[definition.name]) != definition.neutral
        return result


@cache
def extended_model() -> ExtendedModel:
    """Return the model with all effects of the catalogue."""
    return ExtendedModel(tuple(CATALOGUE.values()))


def drive(
    left: Floats,
    right: Floats,
    dt: Floats,
    values: Mapping[str, Floats],
    start: Sequence[Floats],
    at: NDArray[np.int64],
    time: float = 0.0,
    seed: int = 0,
    model: ExtendedModel | None = None,
) -> Floats:
    """Drive T spans with C candidates and return the states at the borders `at`, shape (7, len(at), C).

    `values` by name and `start` (x, y, theta, psi_left, psi_right) have shape (C,). `time` [s] is that of the first
    border; `seed` fixes the random numbers, the same for all candidates.
    """
    model = model or extended_model()
    count = len(start[0])
    parts = np.maximum(np.ceil(dt / LONGEST_STEP), 1.0).astype(np.int64)
    borders = np.concatenate([[0], np.cumsum(parts)])[at]
    left, right, dt = (np.repeat(array, parts) for array in (left, right, dt / parts))
    rows = model.robots(values, start, time)
    packets = np.empty(3 * len(dt) * count if np.any(model.is_late(values, (count,))) else 0)
    recorded = np.empty((len(at), count, RECORDED))
    model.module.drive(rows.reshape(-1), count, left, right, dt, packets, seed, borders, recorded)
    return np.ascontiguousarray(recorded.transpose(2, 0, 1))


def _module(source: str) -> ModuleType:
    """Return the module with this source, from the cache folder or written there, and compiled by Numba."""
    inlined = "".join(
        Path(module.__file__ or "").read_text("utf-8") for module in (elementary, step_helpers, composed_loops)
    )
    key = hashlib.sha256((source + inlined).encode()).hexdigest()[:16]
    name = f"cmr_model_{key}"
    path = _cache_folder() / f"{name}.py"
    if not path.exists():
        with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=path.parent, suffix=".new", delete=False) as file:
            file.write(source)
        Path(file.name).replace(path)
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None:
        raise ImportError(f"cannot load {path}")
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # where Numba looks for the globals of what it finds in its cache
    sys.modules[name] = module  # where Numba looks for it when it loads what another process compiled
    specification.loader.exec_module(module)
    return module


def _cache_folder() -> Path:
    """Return the user's cache folder for composed models, or a temporary one where that cannot be written."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cmr"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="cmr-"))
