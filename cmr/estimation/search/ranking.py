"""Fit the promising effects beside a model, and judge them.

1. Of the screening's effects, those with a large score are fitted quickly: only their own parameters iterate, the
   slopes of the model's parameters are taken from its last fit (`Problem.fit_beside`).
2. The FINALISTS are fitted with everything free (Levenberg-Marquardt, gauss_newton.py), effects of a place from their
   best place.
3. Each has its drop of S, D = S(model) - S(model with it), and is ranked by the evidence D - PER_FURTHER (k - 1) -
   rarity with k parameters of its own (Schwarz, Annals of Statistics 6, 1978).
4. `judged` adds the verdict of criteria.py and, if needed, of cross_validation.py.

Reference: D. W. Marquardt, Journal of the Society for Industrial and Applied Mathematics 11, 1963.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

from cmr.estimation.candidates import Excitation
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.criteria import TOO_SMALL, CandidateEffect, held_out_gain, needed, why_not
from cmr.estimation.search.cross_validation import as_seen, contradicted, why_not_elsewhere
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.placement import placed
from cmr.estimation.search.screening import Score, Screening, start_of
from cmr.model.catalogue import CATALOGUE

PROMISING = 12  # effects that are fitted after the score test,
PROMISING_SHARE = 0.08  # if they explain this share of what the best explains
FINALISTS = 3  # that are fitted with everything free
TRUSTED_SHARE = 0.3  # of a trial's size: a score found at a share closer to it than this is reliable
CLOSE = 0.7  # of the best drop: an effect that explains less is no finalist
LEAST_DROP = 20.0  # of a finalist
LEAST_SCORE = 10.0  # least drop of the sum of squares for a fit


def fit_where_asked(
    problem: Problem, current: Fit, ranked: list[CandidateEffect], inflation: Inflation
) -> list[CandidateEffect]:
    """Refit candidates with everything free, as far as needed to judge the best valid one.

    Fitting them side by side is faster than one after the other.
    """
    reasons = [why_not(problem, current, tested, inflation) for tested in ranked]
    asked = reasons.index("") + 1 if "" in reasons else len(reasons)
    unsure = [tested.fit is None and why in ("", TOO_SMALL) for tested, why in zip(ranked, reasons, strict=True)]
    return fit_fully(problem, current, ranked, [*unsure[:asked], *[False] * (len(ranked) - asked)])


def judged(
    problem: Problem, current: Fit, tested: CandidateEffect, inflation: Inflation
) -> tuple[CandidateEffect, str]:
    """Return an effect and the reason why it is not named; an acceptable one is refitted with everything free."""
    why = why_not(problem, current, tested, inflation)
    if tested.fit is None and why in ("", TOO_SMALL):
        tested = fit_fully(problem, current, [tested], [True])[0]
        why = why_not(problem, current, tested, inflation)
    if not why and (problem.several or not problem.one_step):
        significant = needed(tested.effect) * inflation.of(tested.effect.name)
        why = why_not_elsewhere(problem, current, tested.fit, significant)
    return tested, why


def ranked_fits(
    problem: Problem,
    current: Fit,
    screening: Screening,
    least: float | None = None,
    known: Sequence[CandidateEffect] = (),
) -> list[CandidateEffect]:
    """Fit the promising effects beside the model, the best ones with everything free; best first.

    Promising effects have a score above `least`, by default a share of the best one. `known` parameters stay as given.
    """
    if least is None:
        least = max([LEAST_SCORE, *(PROMISING_SHARE * score.drop for score in screening.scores[:1])])
    there = {tested.effect.name for tested in known}
    promising = [score for score in screening.scores if score.drop > least][:PROMISING]
    promising = [score for score in promising if score.trial.effect not in there]
    if not promising:
        return list(known)
    effects = [CATALOGUE[score.trial.effect] for score in promising]
    names = [[parameter.name for parameter in effect.parameters] for effect in effects]
    quick = problem.fit_beside(current, [start_of(score) for score in promising], names)
    tested = [
        CandidateEffect(effect, current.squares - squares, values)
        for effect, (values, squares) in zip(effects, quick, strict=True)
    ]
    stuck = [_stuck(one, score, problem.excitation) for one, score in zip(tested, promising, strict=True)]
    possible = [replace(one, values=as_seen(one.values, problem.excitation)) for one in tested]
    tested = fit_fully(problem, current, possible, stuck)
    tested = sorted([*known, *tested], key=lambda one: -one.evidence)
    least = max(CLOSE * tested[0].drop, LEAST_DROP)
    final = [one.fit is None and one.drop > least for one in tested[:FINALISTS]]
    finalists = fit_fully(problem, current, tested[:FINALISTS], final)
    return sorted([*finalists, *tested[FINALISTS:]], key=lambda one: -one.evidence)


def _stuck(tested: CandidateEffect, score: Score, excitation: Excitation) -> bool:
    """Return whether a quick fit failed: it got worse although the score, near this size, predicted an improvement, or
    it ended at a limit that the robot exceeded.
    """
    predicted_better = TRUSTED_SHARE < abs(score.share) < 1.0 / TRUSTED_SHARE
    return contradicted(tested.values, excitation) or (tested.drop < 0.0 and predicted_better)


def fit_fully(
    problem: Problem, current: Fit, tested: Sequence[CandidateEffect], chosen: Sequence[bool]
) -> list[CandidateEffect]:
    """Return the candidates, with the chosen ones fitted with everything free."""
    models = []
    for one in compress(tested, chosen):
        own = [parameter.name for parameter in one.effect.parameters]
        models.append((placed(problem, one.effect, one.values, current.noise), (*current.names, *own)))
    fits = iter(problem.fits(models, current.noise))
    return [
        _fully(problem, current, one, next(fits)) if fully else one for one, fully in zip(tested, chosen, strict=True)
    ]


def _fully(problem: Problem, current: Fit, tested: CandidateEffect, fit: Fit) -> CandidateEffect:
    return CandidateEffect(
        tested.effect, current.squares - fit.squares, fit.values, fit, held_out_gain(problem, current, fit)
    )
