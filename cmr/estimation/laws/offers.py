"""The result of a search for laws, accepted or refused, and the data for fitting and testing laws."""

from dataclasses import dataclass, field, replace

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.further import Further
from cmr.estimation.laws.linearised import Linearised
from cmr.estimation.laws.misfit import variables_of_law
from cmr.estimation.laws.refining import Refined, refined
from cmr.estimation.laws.rest import times_of
from cmr.estimation.problem import Problem
from cmr.recordings.signal import Mask

LEFT = 15.0  # score of a further law from which a law is only an approximation
TRAINING = 2.0 / 3.0  # share of the time used for fitting, if no data are held out


@dataclass(frozen=True)
class Offer:
    """Laws beside a model: the fits `before` and `after`, and their scores. `settled` is the fit to use.

    `gain` is the drop of -2 log likelihood on the fitted data, `held_out` that on held-out data, `score` that of the
    laws, and `left` the best further law beside them. `alike` are other fits that cannot be distinguished; `tied` are
    those of them that are as good. `misfit` is the gain from letting the laws' coefficients change along their own
    variables, beyond the allowed model error: above 0 the formula is not the right one. `further` are laws beside them.
    `undetermined` says that other constants explain as much but imply something else.
    """

    before: Refined
    after: Refined
    settled: Refined
    gain: float
    score: float
    held_out: float
    left: float
    further: Further
    alike: tuple[Refined, ...]
    tied: tuple[Refined, ...] = ()
    misfit: float = 0.0
    undetermined: bool = False

    @property
    def laws(self) -> tuple[Candidate, ...]:
        """The laws."""
        return self.settled.laws

    @property
    def series(self) -> bool:
        """Whether two laws at one place have the same variables: terms of a series, in place of an unknown formula."""
        if len(self.laws) < 2:
            return False
        places, variables = ({of(law) for law in self.laws} for of in (_where, variables_of_law))
        return len(places) == len(variables) == 1

    @property
    def approximate(self) -> bool:
        """Whether structure remains, the formula is slightly wrong, or its constants are not determined."""
        return self.left > LEFT or self.misfit > 0.0 or self.series or self.undetermined


@dataclass(frozen=True)
class Refused:
    """Why no law is accepted beside a model, in a sentence; `before` is the model, None if it is not determined.

    `several` means that another drive could decide. `seen` is the best fit with a formula if structure exists that no
    formula explains.
    """

    reason: str
    before: Refined | None = None
    several: bool = False
    rivals: tuple[Refined, ...] = ()
    seen: Refined | None = None


@dataclass(frozen=True)
class Data:
    """A problem, the errors used for fitting, and those for testing a law: other rows of it, or another problem."""

    problem: Problem
    fitted: Mask
    tried: Mask | None
    other: Problem | None = None
    _elsewhere: dict[Refined, Refined | None] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem, model: Linearised, other: Problem | None) -> "Data":
        """Return the data; of a problem alone, the last third of the time is for testing."""
        times = times_of(model)
        if other is not None:
            return cls(problem, np.ones(len(times), np.bool_), None, other)
        border = float(times.min()) + TRAINING * float(np.ptp(times))
        return cls(problem, times < border, times >= border)

    def held_out(self, before: Refined, after: Refined) -> float:
        """Return the drop of -2 log likelihood by laws on data that nothing was fitted to."""
        if self.other is None:
            assert self.tried is not None
            return before.quality(self.tried) - after.quality(self.tried)
        return self._left_elsewhere(before) - self._left_elsewhere(after)

    @property
    def share_tried(self) -> float:
        """The ratio of errors for testing a law to those for fitting it, at most 1."""
        tried = self.other.batch.rows if self.other is not None else int(np.count_nonzero(~self.fitted))
        return min(1.0, tried / max(int(np.count_nonzero(self.fitted)), 1))

    def tried_on(self, fit: Refined) -> tuple[Refined | None, Mask | None]:
        """Return where a fit was tested: the other problem with the same values, or other rows of the same one."""
        if self.other is None:
            return None, self.tried
        if fit not in self._elsewhere:
            model = replace(Linearised.about(self.other, fit.values, ()), speeds=fit.model.speeds)
            self._elsewhere[fit] = refined(model, fit.laws, fixed=fit.coefficients)
        return self._elsewhere[fit], None

    def _left_elsewhere(self, fit: Refined) -> float:
        """Return -2 log likelihood of the other problem with the same values."""
        fixed, _ = self.tried_on(fit)
        return np.inf if fixed is None else fixed.quality()


def _where(law: Candidate) -> tuple[str, ...]:
    return law.place, law.side
