"""The statements of a stage as a function of arrays: for sensors, and for values known before the simulation."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.model.catalogue import CATALOGUE, DEFINITIONS, LAWS, remembered
from cmr.model.extended.statements import OF_A_SIDE, SIDES, Statements, changed_by

Floats = NDArray[np.float64]
Evaluated = Callable[[Mapping[str, ArrayLike | None]], dict[str, Floats]]
FUNCTIONS = {name: getattr(np, name) for name in ("exp", "cos", "sin", "sqrt", "floor", "where", "sign", "inf", "pi")}


@remembered
def evaluated(effects: tuple[str, ...], stage: str, side: str | None = None) -> Evaluated:
    """Return a function from the variables of a stage, by name, to their values after these effects."""
    statements = Statements(tuple(CATALOGUE[name] for name in effects), DEFINITIONS)
    lines = statements.of(stage) if side is None else statements.of_side(stage, side)
    code = compile("\n".join(lines), f"<stage {stage}>", "exec")

    def run(variables: Mapping[str, ArrayLike | None]) -> dict[str, Floats]:
        names = {name: f"{name}_{side}" if side and name in OF_A_SIDE else name for name in variables}
        scope: dict[str, Any] = {names[name]: value for name, value in variables.items()}
        with np.errstate(divide="ignore", invalid="ignore"):
            exec(code, dict(FUNCTIONS, min=np.minimum, max=np.maximum), scope)
        return {name: scope[names[name]] for name in variables}

    return run


def mean_radii(values: Mapping[str, Floats]) -> NDArray[np.float64]:
    """Return the radius of each side's wheels [m] with all effects, averaged over a revolution: shape (2, C), left,
    right.

    `values` of parameters, by name, are arrays (C,); missing ones are neutral.
    """
    turn = np.array([0.0, np.pi])[:, None]  # opposite angles cancel out-of-roundness
    begin = {**_neutral_radii(), **values, "angle": turn, "radius": values["wheel_radius"] + 0.0 * turn}
    sides = [evaluated(_of_radii(), "ground", side)(begin) for side in SIDES]
    return np.stack([one["radius"].mean(axis=0) for one in sides])


def slip_time(values: Mapping[str, Floats]) -> NDArray[np.float64]:
    """Return the lag of ground speed behind the wheel, per acceleration [s], (C,), the same on both sides.

    `values` of parameters, by name, are arrays (C,); missing ones are neutral.
    """
    turning = 0.0 * values["wheel_radius"]
    known = {parameter.name: parameter.neutral for name in _of_slip() for parameter in CATALOGUE[name].parameters}
    begin = {**known, **values, "psi": turning, "domega": turning + 1.0, "rolling": turning}
    return np.asarray(-evaluated(_of_slip(), "ground", "left")(begin)["rolling"], np.float64)


@cache
def _of_slip() -> tuple[str, ...]:
    """Return the effects that make the ground speed lag behind the wheels, independent of history and motion."""
    lagging = (name for name, one in CATALOGUE.items() if "rolling" in changed_by(one, "ground") and not one.memory)
    return tuple(name for name in lagging if name not in LAWS)


@cache
def _of_radii() -> tuple[str, ...]:
    return tuple(name for name, effect in CATALOGUE.items() if "radius" in changed_by(effect, "ground"))


@cache
def _neutral_radii() -> dict[str, float | None]:
    return {known.name: known.neutral for name in _of_radii() for known in CATALOGUE[name].parameters}
