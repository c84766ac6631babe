"""Results: unexplained structure, and the generic term that extends the model."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain


@dataclass(frozen=True, kw_only=True)
class GenericTerm:
    """A term without physical meaning that improves the predictions of the extended model.

    `estimates` are its coefficients by name, `formula` describes it in words. `held_out` is the log-likelihood that it
    adds on data that it was not fitted to, `gain` that over the same model without it. `shift` is the change of each
    parameter of the paper's model, in its unit, when the term was added to all named effects.
    """

    estimates: Mapping[str, Estimate]
    formula: str
    held_out: float
    gain: Gain
    shift: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Structure that no effect of the catalogue explains.

    `signal` is the one with most of it. `share` is the share of the variance of its one-step prediction errors, in its
    own unit and with large ones clipped, that `regressors` predict on left-out data. With `bursts`, their number, no
    regressor predicts them: `share` is then the excess of the bursts relative to all of its normalised squared errors.
    `generic` is the term that extends the model, None if none improves it. `not_judged` is a sentence on why no
    structure was searched for, empty if it was; `share` is then NaN.
    """

    present: bool = False
    signal: str | None = None
    regressors: tuple[str, ...] = ()
    share: float = 0.0
    bursts: int = 0
    generic: GenericTerm | None = None
    not_judged: str = ""


def not_judged(reason: str) -> Unexplained:
    """Return a result for a search that was not made, with the reason."""
    return Unexplained(share=math.nan, not_judged=reason)
