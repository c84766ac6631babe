"""How far the paper's parameters moved with each effect: what a model lacks hides in the parameters that it has."""

from collections.abc import Sequence
from itertools import pairwise

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.search.selection import Search

Moved = dict[str, float]  # by how much each parameter of the baseline moved, in its unit


def shifts(found: Search) -> list[Moved]:
    """Return how far each effect named, in their order, moved the parameters of the baseline when it was added.

    The models are nested: the paper's, with the first effect, with the first two, and so on to the final one. So the
    shifts add up to what lies between the first and the last.
    """
    return [moved(before, after, found.base.names) for before, after in pairwise(_nested(found))]


def moved(before: Fit, after: Fit, names: Sequence[str]) -> Moved:
    """Return how far the parameters `names` lie apart in two fits."""
    return {name: after.values[name] - before.values[name] for name in names}


def _nested(found: Search) -> list[Fit]:
    """Return the baseline, the fit with the first effect, with the first two, and so on to the final one.

    An effect that no fit knows, because it acts by chance or is read off the data, changes no fit. What it did to the
    baseline, as it was taken out of the data, counts as the next one's, or its own where it stands alone.
    """
    fits = [found.base]
    last = max((number for number, one in enumerate(found.named) if not one.estimates), default=0)
    for number, one in enumerate(found.named):
        if number == last:
            fits.append(found.final)
        elif one.estimates:
            fits.append(fits[-1])
        else:
            own = [parameter.name for parameter in one.candidate.effect.parameters]
            start = {**fits[-1].values, **{name: found.final.values[name] for name in own}}
            fits.append(found.problem.fit(start, (*fits[-1].names, *own), found.final.noise, renew=0))
    return fits
