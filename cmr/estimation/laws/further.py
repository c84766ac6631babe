"""Further laws beside a fit: the gains of all are predicted, and the observer runs for the most promising."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cmr.estimation.laws.candidates import Candidate, candidates
from cmr.estimation.laws.foreseen import Expected, Foreseen
from cmr.estimation.laws.linearised import Linearised
from cmr.estimation.laws.local import local_laws
from cmr.estimation.laws.refining import with_best_constants
from cmr.estimation.laws.rest import Rest
from cmr.estimation.laws.scan import Score, scan
from cmr.estimation.search.inflation import MEDIAN_OF_CHI2


@dataclass(frozen=True)
class Further:
    """Laws beside a model with residuals: `expected` gains of all, and the best `scores` to first order."""

    foreseen: Foreseen
    expected: Expected
    scores: Sequence[Score]

    @classmethod
    def beside(cls, model: Linearised, rest: Rest) -> "Further":
        """Search for laws beside a model with these residuals."""
        foreseen = Foreseen(model, rest)
        expected = foreseen.expected([one for one in candidates() if model.shows(one)])
        return cls(foreseen, expected, scan(model, rest, expected.best()))

    def inflation(self, place: str = "") -> float:
        """Return the inflation of the usual law's gain relative to chance, at least 1.

        For laws at one place it measures the model error there; with noisy encoders, only for the motors.
        """
        gains = self.expected.of_one_coefficient(place)
        return max(1.0, float(np.median(gains)) / MEDIAN_OF_CHI2) if len(gains) else 1.0

    def best(self, inflation: float, known: Callable[[Candidate], bool]) -> float:
        """Return the best score among laws that are not `known`, with this inflation; 0 without any.

        Exclude what the model's effects already explain.
        """
        again = [(one.gain / inflation - (one.gain - one.score), one.candidate) for one in self.scores]
        ordered = sorted(again, key=lambda one: -one[0])
        return next((score for score, law in ordered if score <= 0.0 or not known(law)), 0.0)

    def with_local(self) -> list[Score]:
        """Return the best scores of all laws, with those local in time, space or frequency.

        The best one also gets its best time or place: between grid points it may explain far more.
        """
        model, rest = self.foreseen.model, self.foreseen.rest
        local = scan(model, rest, self.foreseen.promising(local_laws(model, rest)))
        refined = scan(model, rest, [with_best_constants(model, one.candidate, rest) for one in local[:1]])
        return sorted([*self.scores, *refined, *local], key=lambda one: -one.score)
