"""Names must not make free runs worse on data that they were not fitted on: those that do are taken back."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from cmr.estimation.averaging import Posterior, averaged
from cmr.estimation.gain import Gain
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.measured_gain import Measured, Model
from cmr.estimation.search.criteria import SelectedEffect
from cmr.estimation.search.elimination import without
from cmr.estimation.search.selection import Search
from cmr.estimation.search.trace import with_removed
from cmr.estimation.unexplained.extending import Extended

# A gain that is surely less than the first, or, unless it is surely one, of any signal less than the second.
WORSE, MUCH_WORSE = 0.95, 0.8
TAKEN_BACK = "Free runs stray farther with it on data that it was not fitted on."


@dataclass(frozen=True)
class Whole:
    """What was found, and the average over what may be hidden beside it; None where errors of moments tell nothing."""

    extended: Extended
    average: Posterior | None

    @property
    def model(self) -> Fit | Posterior:
        """The model that is delivered."""
        return self.extended.final if self.average is None else self.average


def that_holds(whole: Extended, measure: Callable[[Extended, Model], Measured]) -> tuple[Whole, Measured]:
    """Return the model without the effects with which free runs stray farther, the weakest first, and its errors.

    The fit with the names is judged, the average about it delivered: an average makes little of what is in doubt.
    """
    alone = _as_the_paper_if_alone(whole)
    measured = measure(alone, alone.final)
    while whole.term is None and _strays(measured.gain) and _fitted(whole.found):
        whole = replace(whole, found=_without(whole.found, _fitted(whole.found)[-1]))
        alone = _as_the_paper_if_alone(whole)
        measured = measure(alone, alone.final)
    found = whole.found
    if not found.problem.by_moments:
        return Whole(alone, None), measured
    names = [one.candidate.effect.name for one in found.named]
    average = averaged(found.problem, whole.final, found.inflation, names)
    return Whole(whole, average), measure(whole, average)


def _as_the_paper_if_alone(whole: Extended) -> Extended:
    """Return the paper's model for one in which nothing is left that extends it."""
    alone = whole.term is None and not whole.found.named
    return replace(whole, found=as_the_paper_has_it(whole.found)) if alone else whole


def _strays(gain: Gain) -> bool:
    if gain.interval[0] > 1.0:
        return False
    return gain.interval[1] < WORSE or any(ratio < MUCH_WORSE for ratio in gain.signals.values())


def as_the_paper_has_it(found: Search) -> Search:
    """Return what was found with the paper's model for the final one.

    Both fits weigh the same data otherwise, by plain noise and by that which was found. So what lies between them is in
    doubt, and what each of them leaves open.
    """
    doubts = {
        name: math.hypot(found.final.std(name), found.final.values[name] - found.base.values[name])
        for name in found.base.names
    }
    return replace(found, final=found.base, doubts=doubts)


def _fitted(found: Search) -> list[SelectedEffect]:
    """Return the effects that a fit knows, the strongest first; the others act by chance or are read off the data."""
    return [one for one in found.named if not one.estimates]


def _without(found: Search, weakest: SelectedEffect) -> Search:
    return replace(
        found,
        final=found.problem.fit(*without(found.final, [weakest]), found.final.noise, renew=0),
        named=[one for one in found.named if one is not weakest],
        others=[(weakest.candidate, TAKEN_BACK), *found.others],
        decisions=with_removed(found.decisions, [(weakest.candidate.effect.name, weakest.candidate.drop)], TAKEN_BACK),
    )
