"""Find the cause that best fits the observations since a change: weighted least squares for each."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.live.causes import CAUSES, Cause, Voltage
from cmr.diagnosis.live.changes import BY_NAME, Sizes
from cmr.diagnosis.live.detection import Residuals
from cmr.diagnosis.live.expectation import Residual
from cmr.diagnosis.live.second import Second
from cmr.recordings.signal import Floats

ROUGH = 0.1  # relative model error of a large shift
RIVAL = 3.0  # nats; causes within this of the best are named, too
MOST_RIVALS = 2
FEWEST = 3  # seconds that a change must have lasted
KEPT = 3.0  # nats by which another explanation must exceed the current one
LEAST_SHARE = 0.5  # of the observations must be explained


class Observed(NamedTuple):
    """A second, with the deviations of its measures from the start, and from the current explanation."""

    second: Second
    residuals: Residuals
    beyond_present: Residuals


class Explanation(NamedTuple):
    """Causes with the sizes of their changes by name, and others that fit as well.

    No causes: everything is as at the start. `complete`: little remains unexplained.
    """

    causes: tuple[tuple[Cause, Sizes], ...] = ()
    rivals: tuple[tuple[Cause, Sizes], ...] = ()
    complete: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """The causes' keys."""
        return tuple(cause.key for cause, _ in self.causes)

    @property
    def sizes(self) -> Sizes:
        """The sizes of all changes by name."""
        return {name: size for _, sizes in self.causes for name, size in sizes.items()}


def explain(observed: Sequence[Observed], present: Explanation, voltage: Voltage) -> Explanation:
    """Return the best explanation of the observations, and its onset; before it, `present` holds.

    `voltage` is the battery voltage.
    """
    by_speed = any(item.second.by_speed for item in observed)
    known = [cause for cause in CAUSES if cause.fits(voltage) and cause.by_speed in (None, by_speed)]
    candidates = list(_candidates(known, [cause for cause, _ in present.causes]))
    spoilt_before = np.cumsum([0.0, *(0.5 * _power(item.beyond_present) for item in observed)])
    possible: list[tuple[float, Explanation]] = []
    for onset in range(max(1, len(observed) - FEWEST + 1)):
        after = _After.of(observed[onset:])
        for score, fit in filter(None, (after.fit(causes) for causes in candidates)):
            bonus = KEPT if fit.names == present.names else 0.0
            possible.append((score + bonus - spoilt_before[onset], fit))
    by_score = sorted(possible, key=lambda fit: fit[0])
    # Of each explanation the best onset; the best explanation first.
    fits = sorted({fit.names: (score, fit) for score, fit in by_score}.values(), key=lambda fit: -fit[0])
    best_score, best = fits[0]
    rivals = [fit.causes[0] for score, fit in fits[1:] if score > best_score - RIVAL and len(fit.causes) == 1]
    return best._replace(rivals=tuple(rivals[:MOST_RIVALS]) if len(best.causes) == 1 else ())


class _After(NamedTuple):
    """The residuals since the onset of a change, shape (n,), and the shifts by each change, all in units of noise."""

    seen: Floats
    columns: Mapping[str, Floats]

    @classmethod
    def of(cls, observed: Sequence[Observed]) -> "_After":
        residuals = [residual for item in observed for residual in item.residuals.values()]
        noise = np.array([_noise(residual) for residual in residuals])
        columns = {name: _column(name, observed) / noise for name in BY_NAME}
        return cls(np.array([residual.value for residual in residuals]) / noise, columns)

    def fit(self, causes: Sequence[Cause]) -> tuple[float, Explanation] | None:
        """Fit causes; return the log-likelihood minus what chance gives, and their sizes; None if implausible."""
        names = [name for cause in causes for name in cause.changes]
        design = np.array([self.columns[name] for name in names]).reshape(len(names), len(self.seen))
        values = np.linalg.lstsq(design.T, self.seen, rcond=None)[0]
        sizes = dict(zip(names, values.tolist(), strict=True))
        if not all(cause.allows(sizes) for cause in causes):
            return None
        left = self.seen - values @ design
        power, unexplained = float(self.seen @ self.seen), float(left @ left)
        complete = unexplained <= max((1.0 - LEAST_SHARE) * power, 2.0 * len(left))
        # The chance gain of fitting each size, and of choosing the best cause.
        chance = len(names) * (1.0 + 0.5 * math.log(max(len(left), 1))) + len(causes) * math.log(len(CAUSES))
        found = tuple((cause, {name: sizes[name] for name in cause.changes}) for cause in causes)
        return -0.5 * unexplained - chance, Explanation(found, (), complete)


def _noise(residual: Residual) -> float:
    """Return the standard deviation of a residual about the shift that a change makes."""
    return math.hypot(residual.noise, residual.doubt, ROUGH * residual.value)


def _power(residuals: Residuals) -> float:
    return sum((residual.value / _noise(residual)) ** 2 for residual in residuals.values())


def _candidates(known: Sequence[Cause], present: Sequence[Cause]) -> Iterator[tuple[Cause, ...]]:
    """Yield possible explanations: no cause, one cause, or one of the current causes and another."""
    yield ()
    for cause in known:
        yield (cause,)
    for old in present:
        for cause in known:
            if not old.changes.keys() & cause.changes.keys():
                yield old, cause


def _column(name: str, observed: Sequence[Observed]) -> Floats:
    """Return the shift of every residual by a change of size 1."""
    shifts = [BY_NAME[name].shifts(item.second) for item in observed]
    return np.array(
        [shift.get(measure, 0.0) for item, shift in zip(observed, shifts, strict=True) for measure in item.residuals]
    )
