"""Residuals over regressors, before and after extending the model: the candidates for plots."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cmr.diagnosis.report.binned import MOST_SAMPLES, Bins, binned, edges_of, thinned
from cmr.diagnosis.report.terms import as_shown, place
from cmr.diagnosis.result import Residual
from cmr.recordings.signal import Floats


@dataclass(frozen=True)
class Pair:
    """One signal's residual over one regressor: samples of shape (n,), and their binned means.

    `before` are the residuals of the simpler model: the paper's, or the extended one without one of its effects.
    `removed` is the share of the mean square of `before` that is structure over the regressor and gone in `after`.
    `same` is another pair with the same regressor and the same `after`, whose means are shared.
    """

    signal: str
    unit: str
    regressor: str
    over: Floats
    before: Floats
    after: Floats
    same: "Pair | None" = None

    @cached_property
    def means_before(self) -> Bins:
        """Binned residuals of the simpler model."""
        return binned(self.over, self.before, self._edges)

    @cached_property
    def means_after(self) -> Bins:
        """Binned residuals of the extended model."""
        return self.same.means_after if self.same else binned(self.over, self.after, self._edges)

    @cached_property
    def _edges(self) -> Floats:
        """The bin edges for a residual without gaps."""
        return self.same._edges if self.same else edges_of(self.over[np.isfinite(self.over)])

    @cached_property
    def removed(self) -> float:
        """See above; negative if structure was added."""
        total = float(np.nansum(self.before**2))
        return (self.means_before.structure - self.means_after.structure) / total if total else 0.0


def pairs_of(residuals: Iterable[Residual]) -> tuple[Pair, ...]:
    """Return the pairs of all signals and regressors; of long recordings, samples evenly spread."""
    return tuple(pair for residual in residuals for pair in _pairs(residual))


def pairs_without(residuals: Iterable[Residual], effect: str, pairs: Iterable[Pair] = ()) -> tuple[Pair, ...]:
    """Return the pairs whose `before` is the extended model without one effect; empty if unknown.

    `pairs` are those of the same residuals, if already computed.
    """
    known = [residual for residual in residuals if effect in residual.without]
    same = {(pair.signal, pair.regressor): pair for pair in pairs}
    without = pairs_of(replace(residual, before=residual.without[effect]) for residual in known)
    return tuple(replace(pair, same=same.get((pair.signal, pair.regressor))) for pair in without)


def _pairs(residual: Residual) -> list[Pair]:
    chosen = thinned(len(residual.before), MOST_SAMPLES)
    before, after = residual.before[chosen], residual.after[chosen]
    return [
        Pair(residual.signal, residual.unit, name, as_shown(name, values[chosen]), before, after)
        for name, values in sorted(residual.regressors.items(), key=lambda item: place(item[0]))
    ]
