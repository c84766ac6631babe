"""Structure in the prediction errors of the whole drive that no named effect explains.

A robot may do something that the catalogue does not contain. One effect is still the best candidate, and may even be
named. The remaining structure shows that it is wrong. The diagnosis of the whole drive then searches for a law.
"""

from dataclasses import replace

from cmr.estimation.problem import Problem
from cmr.estimation.unexplained.remaining import remaining
from cmr.estimation.unexplained.result import Unexplained
from cmr.investigation.judging import NOTHING, Judgement, own_parameters


def unexplained_by(judgement: Judgement) -> Unexplained:
    """Return the remaining structure beside the named effects, and the likeliest further effect, if any."""
    beliefs, named = judgement.problem, judgement.named
    likeliest = () if judgement.best.name == NOTHING else (judgement.best.name,)
    problem = Problem(beliefs.predictors, beliefs.gains, beliefs.excitation)
    models = [
        (dict(judgement.best.values), (*beliefs.own, *own_parameters((*named, *likeliest)))),
        (_without_effects(judgement), beliefs.own),
    ]
    fit, base = beliefs.fits(models, judgement.noise)
    count = beliefs.rows_of_data
    fit, base = (replace(one, rest=one.rest[:count], slopes=one.slopes[:count]) for one in (fit, base))
    return remaining(problem, fit, base).unexplained


def _without_effects(judgement: Judgement) -> dict[str, float]:
    known = judgement.problem.excitation.parameters
    return {name: judgement.base.values.get(name, value) for name, value in known.items()}
