"""Populations: virtual robots that differ as real ones do, with randomly drawn parameters.

From several calibrated robots, mean and covariance of their parameters are taken; of the logarithms if all have the
same sign and none is 0, so that positive parameters stay positive. A few robots do not determine correlations: these
are shrunk as if as many robots without correlations as there are varying parameters had been added, and two robots,
whose parameters always lie on a line, removed. Variances are kept. From a single robot, the standard deviations in its
file are used, without correlations, which a file does not contain.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmr.model.catalogue import definition
from cmr.model.parameters import DEFINITIONS, RobotParameters
from cmr.parameters.file import ParameterFile, ParameterFileError, load

Floats = NDArray[np.float64]
FURTHEST = 3.0  # standard deviations along each axis of the covariance; robots further out would not be used


class PopulationError(Exception):
    """No population can be drawn from these files; the text gives the reason and the remedy."""


@dataclass(frozen=True)
class Population:
    """A population of robots: normal in `names`, or in the logarithms of the `logarithmic` ones.

    `mean` and `logarithmic` are of shape (p,), `spread`, of shape (p, p), is a square root of the covariance.
    `signs` (p,) are those of the logarithmic ones.
    """

    names: tuple[str, ...]
    mean: Floats
    spread: Floats
    logarithmic: NDArray[np.bool_]
    signs: Floats

    def draw(self, seed: int, robot_id: int) -> RobotParameters:
        """Return the parameters of one robot; the same for the same seed and id, whoever else is drawn."""
        random = np.random.default_rng([seed, robot_id])
        deviation = np.clip(random.standard_normal(len(self.names)), -FURTHEST, FURTHEST)
        drawn = self.mean + self.spread @ deviation
        drawn[self.logarithmic] = np.exp(drawn[self.logarithmic])
        return RobotParameters.of({n: _within(n, v) for n, v in zip(self.names, drawn * self.signs, strict=True)})


def population_of(files: Sequence[ParameterFile]) -> Population:
    """Return the population represented by these robots, or by one robot with its standard deviations.

    Effects of diagnosed robots are included; a robot that lacks one has its neutral value. Raises PopulationError if
    nothing determines how robots differ, or a file lacks one of the paper's parameters.
    """
    if not files:
        raise PopulationError("A population needs parameter files: several robots', or one with standard deviations.")
    try:
        robots = [dict(file.robot_parameters.values) for file in files]
    except ParameterFileError as error:
        raise PopulationError(f"A file of the population lacks a parameter: {error}") from error
    names = tuple(dict.fromkeys(name for robot in robots for name in (*DEFINITIONS, *robot)))
    values = _table(names, robots)
    logarithmic = np.all(values > 0.0, axis=0) | np.all(values < 0.0, axis=0)
    signs = np.where(logarithmic & (values[0] < 0.0), -1.0, 1.0)
    transformed = np.where(logarithmic, np.log(np.abs(np.where(logarithmic, values, 1.0))), values)
    spread = _spread_of_one(files[0], names, values[0], logarithmic) if len(files) == 1 else _spread(transformed)
    if not spread.any():
        raise PopulationError("The robots of the population are all the same. Give files of different robots.")
    return Population(names, transformed.mean(axis=0), spread, logarithmic, signs)


def drawn_from(paths: Sequence[Path], robot_ids: Sequence[int], seed: int) -> dict[int, RobotParameters]:
    """Return parameters, by robot id, drawn from the robots of these files.

    Raises PopulationError if a file cannot be read, or nothing determines how robots differ.
    """
    try:
        population = population_of([load(path) for path in paths])
    except ParameterFileError as error:
        raise PopulationError(str(error)) from error
    return {robot_id: population.draw(seed, robot_id) for robot_id in robot_ids}


def _table(names: Sequence[str], robots: Sequence[Mapping[str, object]]) -> Floats:
    """Return the robots' values, shape (n, p).

    If a robot lacks an effect, the parameter that switches it on is neutral; conditions of the effect take the mean of
    the others.
    """
    table = np.array([[robot.get(name, np.nan) for name in names] for robot in robots], dtype=float)
    for column, name in zip(table.T, names, strict=True):
        lacking = np.isnan(column)
        neutral = definition(name).neutral
        column[lacking] = neutral if definition(name).switches and neutral is not None else column[~lacking].mean()
    return table


def _spread(values: Floats) -> Floats:
    """Return a square root of the covariance of robots, (n, p), with correlations shrunk."""
    deviations = values.std(axis=0, ddof=1)
    scaled = (values - values.mean(axis=0)) / np.where(deviations > 0.0, deviations, 1.0)
    correlations = scaled.T @ scaled / (len(values) - 1)
    np.fill_diagonal(correlations, 1.0)
    varying = max(int(np.count_nonzero(deviations)), 1)
    kept = (len(values) - 2.0) / (len(values) - 2.0 + varying)
    shrunk = kept * correlations + (1.0 - kept) * np.eye(len(correlations))
    sizes, axes = np.linalg.eigh(shrunk)
    root: Floats = deviations[:, None] * (axes * np.sqrt(np.maximum(sizes, 0.0)) @ axes.T)
    return root


def _spread_of_one(file: ParameterFile, names: Sequence[str], values: Floats, logarithmic: NDArray[np.bool_]) -> Floats:
    deviations = np.array([(file.values[n].std or 0.0) if n in file.values else 0.0 for n in names])
    if not deviations.any():
        raise PopulationError(
            f"The file of robot {file.robot_id} has no standard deviations. Give files of several calibrated robots, "
            "or one that cmr-calibrate wrote."
        )
    return np.diag(np.where(logarithmic, deviations / np.abs(np.where(logarithmic, values, 1.0)), deviations))


def _within(name: str, value: float) -> float:
    bounds = definition(name)
    return float(np.clip(value, bounds.lower, bounds.upper))
