"""Shifts of the paper's parameters with each effect: parameters absorb missing physics of the model."""

from collections.abc import Sequence
from itertools import pairwise

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.search.selection import Search

Moved = dict[str, float]  # change of each baseline parameter, in its unit


def shifts(found: Search) -> list[Moved]:
    """Return the shift of the baseline parameters with each named effect added, in order.

    The models are nested: the paper's, with the first effect, with the first two, and so on to the final one. So the
    shifts add up to the difference between the first and the last.
    """
    return [moved(before, after, found.base.names) for before, after in pairwise(_nested(found))]


def moved(before: Fit, after: Fit, names: Sequence[str]) -> Moved:
    """Return the differences of the parameters `names` between two fits."""
    return {name: after.values[name] - before.values[name] for name in names}


def _nested(found: Search) -> list[Fit]:
    """Return the baseline, the fit with the first effect, with the first two, and so on to the final one.

    An effect that is not fitted, because it is random or read off the data, changes no fit. The change of the baseline
    due to its removal from the data is assigned to the next effect, or to itself if it is the only one.
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
