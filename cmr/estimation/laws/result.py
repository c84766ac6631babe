"""Results of a search for laws: the laws found, their rivals, and the data of their plots."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.model.laws.law import Law
from cmr.recordings.signal import Floats

LAW = "law"
APPROXIMATION = "approximation"
TIE = "tie"
NO_LAW = "no law"
ANSWERS = (LAW, APPROXIMATION, TIE, NO_LAW)


@dataclass(frozen=True, kw_only=True)
class LawFound:
    """A law in the model, with its gains.

    `estimates` are those of its parameters by name. `gain` is that of free runs over the model without the law, on
    left-out data; `held_out` is the log-likelihood added by the law there. `score` is the drop of -2 log likelihood on
    the fitted data, minus the expected chance gain of a search of this size; `left` is the best score of any further
    law beside it.
    """

    law: Law
    estimates: Mapping[str, Estimate]
    gain: Gain
    held_out: float
    score: float
    left: float


@dataclass(frozen=True, kw_only=True)
class Course:
    """A residual against a law's own variable, in equal bins: the data of a plot.

    `at` (n,) are the bins' centres in the variable's unit, `count` (n,) how many errors each holds. `before` and
    `after` (n,) are the residuals without and with the law, in the unit of the law's place, `std` (n,) is the standard
    deviation of the mean, and `law` (n,) the values of the law itself. NaN where a bin is empty.
    """

    at: Floats
    count: Floats
    before: Floats
    after: Floats
    std: Floats
    law: Floats


@dataclass(frozen=True, kw_only=True)
class Curve:
    """The plot data of one law, on the fitted data and on held-out data, if any.

    `law` names the law, `variable` is a variable or an expression of the grammar, with its `unit`; `place_unit` is that
    of the law's place.
    """

    law: str
    variable: str
    unit: str
    place_unit: str
    training: Course
    held_out: Course | None = None


@dataclass(frozen=True, kw_only=True)
class Laws:
    """The result of a search for laws.

    `answer` is one of ANSWERS. `found` are at most two laws, both in the model. `rivals` explain the data as well as
    the first one, or are the tied laws if none is claimed. `names_withdrawn` are effects of the catalogue search that
    the laws replace. `reasons` are sentences that justify the answer. `manoeuvre` is the drive that would decide, empty
    if this one did.
    """

    answer: str = NO_LAW
    found: tuple[LawFound, ...] = ()
    rivals: tuple[LawFound, ...] = ()
    names_withdrawn: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    curve: tuple[Curve, ...] = field(default=())
    manoeuvre: str = ""
