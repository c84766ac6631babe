"""Choose the effect that a search adds next: the one that explains most, with its rivals and the rejected ones."""

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import THRESHOLD, TOO_SMALL, CandidateEffect, SelectedEffect, nearly_large
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.ranking import PROMISING_SHARE, fit_where_asked, judged, ranked_fits
from cmr.estimation.search.rivals import is_possible_instead, margin_of
from cmr.estimation.search.screening import Screening
from cmr.estimation.search.ties import decided

LESS = "It explains less than the effect named."


def next_effect(
    problem: Problem, current: Fit, screening: Screening, inflation: Inflation
) -> tuple[SelectedEffect | None, list[tuple[CandidateEffect, str]]]:
    """Return the effect to add next, and for each other effect the reason why it is not added.

    If one that is too small explains so much that others do not seem promising beside it, these are fitted, too.
    """
    chosen, others = _choose(problem, current, ranked_fits(problem, current, screening), inflation)
    significant = THRESHOLD * inflation.all
    hiding = any(why == TOO_SMALL and PROMISING_SHARE * candidate.drop > significant for candidate, why in others)
    if chosen is None and hiding:
        known = [candidate for candidate, _ in others]
        ranked = ranked_fits(problem, current, screening, significant, known)
        return _choose(problem, current, ranked, inflation)
    return chosen, others


def _choose(
    problem: Problem, current: Fit, ranked: list[CandidateEffect], inflation: Inflation
) -> tuple[SelectedEffect | None, list[tuple[CandidateEffect, str]]]:
    """Return the best valid effect with its rivals, and for each other effect the reason why it is not added.

    An effect that is too small to be named is added first if it explains more than a nameable one, which may only
    imitate it, or if it is nearly large enough: free runs decide in the end.
    """
    others: list[tuple[CandidateEffect, str]] = []
    chosen: CandidateEffect | None = None
    for fitted in fit_where_asked(problem, current, ranked, inflation):
        candidate, why = fitted, LESS
        if chosen is None:
            candidate, why = judged(problem, current, candidate, inflation)
        if chosen is None and not why:
            chosen = candidate
        else:
            others.append((candidate, why))
    small = next((candidate for candidate, why in others if why == TOO_SMALL), None)
    if chosen is None and not (small and nearly_large(small, problem.excitation)):
        return None, others
    if small is not None:
        others = [other for other in others if other[0] is not small]
        others = [(chosen, LESS), *others] if chosen else others
        chosen = small
    assert chosen is not None
    margin = margin_of(chosen, inflation)
    close = [candidate for candidate, _ in others if chosen.drop - candidate.drop < margin]
    if small is None:
        tie = decided(problem, current, chosen, close, inflation)
        others = [(chosen, LESS) if one.effect is tie.named.effect else (one, why) for one, why in others]
        chosen = tie.named
        if not problem.one_step:
            rivals = tuple(one.effect.name for one in tie.alike if one is not chosen)
            return SelectedEffect(chosen, rivals, current), others
        close = [one for one, _ in others if chosen.drop - one.drop < margin]
    as_well = (one for one in close if is_possible_instead(problem, current, one, inflation))
    return SelectedEffect(chosen, tuple(one.effect.name for one in as_well), current), others
