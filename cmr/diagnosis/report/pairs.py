"""Every residual over every regressor, before and after: what the report plots, and chooses from."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cmr.diagnosis.report.binned import MOST_SAMPLES, Bins, binned, thinned
from cmr.diagnosis.report.terms import as_shown, place
from cmr.diagnosis.result import Residual
from cmr.recordings.signal import Floats


@dataclass(frozen=True)
class Pair:
    """One signal's residual over one regressor: samples of shape (n,), and their binned means.

    `before` is what the simpler of two models leaves: the paper's, or the extended one without one of its effects.
    `removed` is the share of the mean square of `before` that is structure over the regressor and gone in `after`.
    """

    signal: str
    unit: str
    regressor: str
    over: Floats
    before: Floats
    after: Floats

    @cached_property
    def means_before(self) -> Bins:
        """Binned means of what the simpler model leaves."""
        return binned(self.over, self.before)

    @cached_property
    def means_after(self) -> Bins:
        """Binned means of what the extended model leaves."""
        return binned(self.over, self.after)

    @cached_property
    def removed(self) -> float:
        """See above; below zero where structure was added."""
        total = float(np.nansum(self.before**2))
        return (self.means_before.structure - self.means_after.structure) / total if total else 0.0


def pairs_of(residuals: Iterable[Residual]) -> tuple[Pair, ...]:
    """Return the pairs of all signals and regressors; of long recordings, samples evenly spread."""
    return tuple(pair for residual in residuals for pair in _pairs(residual))


def pairs_without(residuals: Iterable[Residual], effect: str) -> tuple[Pair, ...]:
    """Return the pairs whose `before` is what the extended model leaves without one effect; none if that is unknown."""
    known = [residual for residual in residuals if effect in residual.without]
    return pairs_of(replace(residual, before=residual.without[effect]) for residual in known)


def _pairs(residual: Residual) -> list[Pair]:
    chosen = thinned(len(residual.before), MOST_SAMPLES)
    before, after = residual.before[chosen], residual.after[chosen]
    return [
        Pair(residual.signal, residual.unit, name, as_shown(name, values[chosen]), before, after)
        for name, values in sorted(residual.regressors.items(), key=lambda item: place(item[0]))
    ]
