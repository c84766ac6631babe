"""What a search for laws offers or refuses, and the data on which laws are fitted and tried."""

from dataclasses import dataclass, field, replace

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.further import Further
from cmr.estimation.laws.linearised import Linearised
from cmr.estimation.laws.misfit import variables_of_law
from cmr.estimation.laws.polish import Polished, polished
from cmr.estimation.laws.rest import times_of
from cmr.estimation.problem import Problem
from cmr.recordings.signal import Mask

LEFT = 15.0  # score of a further law from which a law is only an approximation
TRAINING = 2.0 / 3.0  # of the time that is fitted where no data are held out


@dataclass(frozen=True)
class Offer:
    """Laws beside a model: the fit `before` them and `after`, and what they are worth. `settled` is what is to stand.

    `gain` is the drop of -2 log likelihood on the data fitted, `held_out` that on data held out, `score` that of the
    laws, and `left` the best further law beside them. `alike` are other fits that are not distinguished, and `tied`
    those of them that are as good. `misfit` is what the laws' coefficients would explain if they changed along the
    laws' own variables, beyond what is exact enough: above 0 the formula is not the right one. `further` are laws
    beside them. `undetermined` says that other constants explain as much, and say something else.
    """

    before: Polished
    after: Polished
    settled: Polished
    gain: float
    score: float
    held_out: float
    left: float
    further: Further
    alike: tuple[Polished, ...]
    tied: tuple[Polished, ...] = ()
    misfit: float = 0.0
    undetermined: bool = False

    @property
    def laws(self) -> tuple[Candidate, ...]:
        """The laws."""
        return self.settled.laws

    @property
    def series(self) -> bool:
        """Whether two laws at one place have the same variables: terms of a series, in place of a formula unknown."""
        if len(self.laws) < 2:
            return False
        places, variables = ({of(law) for law in self.laws} for of in (_where, variables_of_law))
        return len(places) == len(variables) == 1

    @property
    def approximate(self) -> bool:
        """Whether structure is left, or the formula is not quite right, or its constants need not be."""
        return self.left > LEFT or self.misfit > 0.0 or self.series or self.undetermined


@dataclass(frozen=True)
class Refused:
    """Why no law stands beside a model, in a sentence; `before` is the model, None where nothing determines it.

    `several` says that another drive could tell. `seen` is the best fit with a formula where something is there that
    no formula holds for.
    """

    reason: str
    before: Polished | None = None
    several: bool = False
    rivals: tuple[Polished, ...] = ()
    seen: Polished | None = None


@dataclass(frozen=True)
class Data:
    """A problem, which of its errors are fitted, and on which a law is tried: others of them, or another problem."""

    problem: Problem
    fitted: Mask
    tried: Mask | None
    other: Problem | None = None
    _elsewhere: dict[Polished, Polished | None] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem, model: Linearised, other: Problem | None) -> "Data":
        """Return the data: of a problem alone, the last third of the time is for trying."""
        times = times_of(model)
        if other is not None:
            return cls(problem, np.ones(len(times), np.bool_), None, other)
        border = float(times.min()) + TRAINING * float(np.ptp(times))
        return cls(problem, times < border, times >= border)

    def held_out(self, before: Polished, after: Polished) -> float:
        """Return by how much -2 log likelihood drops with laws on data that nothing was fitted on."""
        if self.other is None:
            assert self.tried is not None
            return before.quality(self.tried) - after.quality(self.tried)
        return self._left_elsewhere(before) - self._left_elsewhere(after)

    @property
    def share_tried(self) -> float:
        """How many errors a law is tried on for each that it is fitted to, at most 1."""
        tried = self.other.batch.rows if self.other is not None else int(np.count_nonzero(~self.fitted))
        return min(1.0, tried / max(int(np.count_nonzero(self.fitted)), 1))

    def tried_on(self, fit: Polished) -> tuple[Polished | None, Mask | None]:
        """Return where a fit was tried: the other problem, with all as it was fitted, or rows of the same."""
        if self.other is None:
            return None, self.tried
        if fit not in self._elsewhere:
            model = replace(Linearised.about(self.other, fit.values, ()), speeds=fit.model.speeds)
            self._elsewhere[fit] = polished(model, fit.laws, fixed=fit.coefficients)
        return self._elsewhere[fit], None

    def _left_elsewhere(self, fit: Polished) -> float:
        """Return -2 log likelihood of the other problem with all as it was fitted."""
        fixed, _ = self.tried_on(fit)
        return np.inf if fixed is None else fixed.quality()


def _where(law: Candidate) -> tuple[str, ...]:
    return law.place, law.side
