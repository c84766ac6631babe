"""Collections of laws: compare the same law over robots and days, and make one entry for all.

The spread of a coefficient over robots beyond what their standard deviations explain is that of a random-effects model
(R. DerSimonian and N. Laird, Meta-analysis in clinical trials, Controlled Clinical Trials 7, 1986): the estimates are
weighted by one over the sum of their variance and that of the spread.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from cmr.diagnosis.job import DOCUMENT
from cmr.model.catalogue import LAWS, unlearn
from cmr.model.laws import Law
from cmr.parameters.file import ParameterFile, Value, load
from cmr.parameters.laws import Coefficient, LawFile
from cmr.recordings.signal import Floats

# The paper's parameters, and what else changes them.
GOES_WITH = {"k1": "the battery, or the motors", "k2_over_k3": "the payload, or the battery", "base_width": "the floor"}
SURE = 0.01  # probability by chance below which a difference or correlation is reported
FEWEST = 4  # files needed to test what a coefficient correlates with
MOST_FILES = 10_000


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """A law in the parameter file of a robot: coefficients by number, from 0 on, and the paper's parameters by name."""

    law: Law
    coefficients: tuple[Coefficient, ...]
    robot_id: int
    written: datetime
    source: str
    paper: Mapping[str, float]


@dataclass(frozen=True)
class Family:
    """One coefficient of the same law on several robots or days.

    `mean` and `mean_std` are those of the family, `spread` is the standard deviation of the coefficient over robots
    and days beyond what their own explain. `between` and `within` are the probabilities that chance makes robots
    differ, and days of one robot; NaN where there is only one of them. `goes_with` are parameters with the correlation.
    """

    mean: float
    mean_std: float
    spread: float
    between: float
    within: float
    goes_with: Mapping[str, float]

    @property
    def std(self) -> float:
        """The standard deviation of the coefficient for a new robot of the family."""
        return math.hypot(self.spread, self.mean_std)


def sightings(paths: Sequence[Path]) -> list[Sighting]:
    """Return the laws in parameter files, and in those of the folders, ordered by law, robot and time.

    The laws known to this process are restored afterwards. Raises ParameterFileError for an invalid file.
    """
    found = [one for path in _files(paths) for one in _in_file(path)]
    return sorted(found, key=lambda one: (key_of(one.law), one.robot_id, one.written))


def key_of(law: Law) -> tuple[str, ...]:
    """Return the identity of a law apart from its name."""
    return (law.place, law.side, *law.formulas, *sorted(law.constants))


def families(found: Sequence[Sighting]) -> list[list[Sighting]]:
    """Group sightings of the same law, in the order of `sightings`."""
    by_key: dict[tuple[str, ...], list[Sighting]] = {}
    for one in found:
        by_key.setdefault(key_of(one.law), []).append(one)
    return list(by_key.values())


def family_of(found: Sequence[Sighting], number: int) -> Family:
    """Combine one coefficient, by number, over all sightings of a law."""
    values = np.array([one.coefficients[number].value for one in found])
    stds = np.array([one.coefficients[number].std or math.nan for one in found])
    stds = np.where(np.isfinite(stds) & (stds > 0.0), stds, _usual(stds, values))
    robots = np.array([one.robot_id for one in found])
    mean, _, total = _weighted(values, stds)
    weights = stds**-2.0
    freedom = len(values) - 1
    surplus = max(0.0, total - freedom)
    spread = math.sqrt(surplus / float(np.sum(weights) - np.sum(weights**2) / np.sum(weights))) if freedom else 0.0
    mean, mean_std, _ = _weighted(values, np.hypot(stds, spread))
    days = sum(_weighted(values[robots == robot], stds[robots == robot])[2] for robot in np.unique(robots))
    count = len(np.unique(robots))
    return Family(
        mean=mean,
        mean_std=mean_std,
        spread=spread,
        between=_by_chance(total - days, count - 1),
        within=_by_chance(days, len(values) - count),
        goes_with=dict(_goes_with(found, values, np.hypot(stds, spread))),
    )


def proposal(found: Sequence[Sighting], name: str = "", description: str = "") -> LawFile:
    """Return one entry for all sightings of a law: coefficients with their spread, under a new name.

    Raises LawError for an invalid name.
    """
    newest = max(found, key=lambda one: one.written).law
    constants = {
        constant: float(np.median([one.law.constants[constant] for one in found])) for constant in newest.constants
    }
    law = replace(
        newest,
        name=name or newest.name,
        description=description or newest.description,
        constants=constants,
    )
    coefficients = {}
    for number, parameter in enumerate(law.coefficients):
        family = family_of(found, number)
        coefficients[parameter] = Coefficient(family.mean, family.std)
    return LawFile(law, coefficients, tuple(one.source for one in found))


def renamed(file: ParameterFile, old: Law, new: Law) -> ParameterFile:
    """Rename a law in parameters; this process must have learned it."""
    names = dict(zip((*old.coefficients, *map(old.parameter_of, old.constants)), _parameters(new), strict=True))
    values: dict[str, Value] = {names.get(name, name): value for name, value in file.values.items()}
    effects = tuple(new.name if name == old.name else name for name in file.effects)
    return replace(file, values=values, effects=effects)


def _parameters(law: Law) -> tuple[str, ...]:
    return (*law.coefficients, *map(law.parameter_of, law.constants))


def _files(paths: Sequence[Path]) -> Iterator[Path]:
    """Yield parameter files; those of a folder are called robot_N.yaml, as a diagnosis writes them."""
    for path in paths:
        if path.name == DOCUMENT:
            yield from sorted(path.parent.glob("robot_*.yaml"))
        elif path.is_dir():
            yield from sorted(path.rglob("robot_*.yaml"))[:MOST_FILES]
        else:
            yield path


def _in_file(path: Path) -> Iterator[Sighting]:
    known = set(LAWS)
    file = load(path)
    laws = file.laws
    for name in set(LAWS) - known:
        unlearn(name)  # other files may have another law of this name
    paper = {name: file.value(name) for name in GOES_WITH if file.has(name)}
    for law in laws:
        values = [file.values.get(name, Value(0.0)) for name in law.coefficients]
        yield Sighting(
            law=law,
            coefficients=tuple(Coefficient(one.value, one.std) for one in values),
            robot_id=file.robot_id,
            written=file.written,
            source=str(path),
            paper=paper,
        )


def _usual(stds: Floats, values: Floats) -> float:
    """Replace missing standard deviations by the usual one, or by a tenth of the coefficient."""
    known = stds[np.isfinite(stds) & (stds > 0.0)]
    return float(np.median(known)) if len(known) else 0.1 * float(np.median(np.abs(values))) or 1.0


def _weighted(values: Floats, stds: Floats) -> tuple[float, float, float]:
    """Return the weighted mean, its standard deviation, and the squares about it in units of the variances."""
    weights = stds**-2.0
    mean = float(np.sum(weights * values) / np.sum(weights))
    return mean, float(np.sum(weights) ** -0.5), float(np.sum(weights * (values - mean) ** 2))


def _by_chance(squares: float, freedom: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(freedom, max(squares, 0.0))) if freedom > 0 else math.nan


def _goes_with(found: Sequence[Sighting], values: Floats, stds: Floats) -> Iterator[tuple[str, float]]:
    """Yield the parameters that a coefficient correlates with at level SURE, and the correlation."""
    from scipy.special import stdtr

    if len(found) < FEWEST:
        return
    for name in GOES_WITH:
        others = np.array([one.paper.get(name, math.nan) for one in found])
        if not np.all(np.isfinite(others)) or np.ptp(others) == 0.0:
            continue
        weights = stds**-2.0 / np.sum(stds**-2.0)
        off, beside = values - np.sum(weights * values), others - np.sum(weights * others)
        both = float(np.sum(weights * off * beside))
        size = math.sqrt(float(np.sum(weights * off**2) * np.sum(weights * beside**2)))
        share = min(max(both / size, -1.0), 1.0) if size else 0.0
        freedom = len(found) - 2
        t = abs(share) * math.sqrt(freedom / max(1.0 - share * share, 1e-12))
        if 2.0 * float(stdtr(freedom, -t)) * len(GOES_WITH) < SURE:
            yield name, share
