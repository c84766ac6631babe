"""What remains unexplained, and the generic term that extends the model all the same."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain


@dataclass(frozen=True, kw_only=True)
class GenericTerm:
    """A term without physical cause, by which the extended model predicts better what nothing explains.

    `estimates` are its coefficients by name, `formula` is it in words. `held_out` is the log-likelihood that it adds
    on data it was not fitted on, `gain` that over the same model without it. `shift` says how far each parameter of
    the paper's model moved, in its unit, when the term was added to all effects named.
    """

    estimates: Mapping[str, Estimate]
    formula: str
    held_out: float
    gain: Gain
    shift: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Structure that remains and that no effect of the catalogue explains.

    `signal` is the one that has most of it. `share` is that of the variance of its one-step prediction errors, in its
    own unit and with large ones cut off, which `regressors` predict on data they were not fitted on. Where errors come
    in `bursts` instead, so many, nothing predicts them but the time: `share` is then what the bursts have, beyond what
    is usual, of all its squared errors over their variances. `generic` is the term that extends the model all the same,
    None where none is any better. `not_judged` is a sentence that says why no structure was looked for, empty where it
    was; `share` is then NaN.
    """

    present: bool = False
    signal: str | None = None
    regressors: tuple[str, ...] = ()
    share: float = 0.0
    bursts: int = 0
    generic: GenericTerm | None = None
    not_judged: str = ""


def not_judged(reason: str) -> Unexplained:
    """Return that no structure was looked for, for a reason given in a sentence: nothing is known of its share."""
    return Unexplained(share=math.nan, not_judged=reason)
