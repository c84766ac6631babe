"""Find the cause that fits best what has been seen since something changed: weighted least squares for each."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.live.causes import CAUSES, Cause, Sizes
from cmr.diagnosis.live.changes import BY_NAME
from cmr.diagnosis.live.detection import Residuals
from cmr.diagnosis.live.second import Second
from cmr.recordings.signal import Floats

ROUGH = 0.1  # share to which a large shift follows the form of a change
RIVAL = 3.0  # nats; what fits as well within this is named, too
KEPT = 3.0  # nats by which another explanation must be better than the present one
LEAST_SHARE = 0.5  # of what is seen an explanation must explain


class Observed(NamedTuple):
    """A second, and by how much its measures differ from what was expected at the start."""

    second: Second
    residuals: Residuals


class Explanation(NamedTuple):
    """Causes with the sizes of their changes by name, and others that explain the same as well.

    No causes: everything is as at the start. `complete`: little of what is seen is left.
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


def explain(observed: Sequence[Observed], present: Explanation) -> Explanation:
    """Return the best explanation of what has been seen since something changed, `present` being the one so far."""
    residuals = [residual for item in observed for residual in item.residuals.values()]
    noise = np.array([math.hypot(r.noise, r.doubt, ROUGH * r.value) for r in residuals])
    seen = np.array([r.value for r in residuals]) / noise
    columns = {name: _column(name, observed) / noise for name in BY_NAME}
    fits = [_fit(seen, causes, columns) for causes in _candidates([cause for cause, _ in present.causes])]
    possible = [(score + KEPT * (fit.names == present.names), fit) for score, fit in filter(None, fits)]
    best_score, best = max(possible, key=lambda fit: fit[0])
    rivals = [fit.causes[0] for score, fit in possible if len(fit.causes) == 1 and score > best_score - RIVAL]
    return best._replace(rivals=tuple(rival for rival in rivals if len(best.causes) == 1 and rival not in best.causes))


def _fit(seen: Floats, causes: Sequence[Cause], columns: Mapping[str, Floats]) -> tuple[float, Explanation] | None:
    """Return the log-likelihood of the causes, less what chance would give them, and their sizes; None if absurd."""
    names = [name for cause in causes for name in cause.changes]
    design = np.array([columns[name] for name in names]).reshape(len(names), len(seen))
    values = np.linalg.lstsq(design.T, seen, rcond=None)[0]
    sizes = dict(zip(names, values.tolist(), strict=True))
    if not all(cause.allows(sizes) for cause in causes):
        return None
    left = seen - values @ design
    power, unexplained = float(seen @ seen), float(left @ left)
    complete = unexplained <= max((1.0 - LEAST_SHARE) * power, 2.0 * len(seen))
    chance = len(names) * (1.0 + 0.5 * math.log(max(len(seen), 1)))
    found = tuple((cause, {name: sizes[name] for name in cause.changes}) for cause in causes)
    return -0.5 * unexplained - chance, Explanation(found, (), complete)


def _candidates(present: Sequence[Cause]) -> Iterator[tuple[Cause, ...]]:
    """Yield what may explain everything: nothing, one cause, one of those suspected so far and another."""
    yield ()
    for cause in CAUSES:
        yield (cause,)
    for old in present:
        for cause in CAUSES:
            if not old.changes.keys() & cause.changes.keys():
                yield old, cause


def _column(name: str, observed: Sequence[Observed]) -> Floats:
    """Return the shift of every residual by a change of size 1."""
    shifts = [BY_NAME[name].shifts(item.second) for item in observed]
    return np.array(
        [shift.get(measure, 0.0) for item, shift in zip(observed, shifts, strict=True) for measure in item.residuals]
    )
