"""Judge an effect that was tested: is it there, does it hold on other data, are its values possible, does it matter?"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cmr.estimation.candidates import USUAL_RATE, locality, rarity, unlikelihood, worth_naming
from cmr.estimation.estimates import Estimate
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.problem import Problem
from cmr.estimation.search.cross_validation import contradicted
from cmr.estimation.search.inflation import Inflation
from cmr.model.catalogue import definition
from cmr.model.effect import Effect
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import ParameterDefinition

THRESHOLD = 30.0  # drop of the sum of squares that one parameter must bring
PER_PARAMETER = 5.0  # more for each further one
OF_A_PLACE = 50.0  # more for the best of thousands of places: poses that err slowly make one stand out
CLEARLY = 3.0  # times what an effect must explain: with more to first order it is needed
PER_FURTHER = 10.0  # the logarithm of some ten thousand errors: what each further parameter must explain to be better
ABSURD = 4.0  # factor by which the paper's parameters may not change when an effect comes in
AT_ITS_END = 1e-3  # of a bound; nearer than this a value is at it
TOO_SMALL = "It is too small to matter."


@dataclass(frozen=True)
class CandidateEffect:
    """An effect fitted beside others: its drop of the sum of squared white errors, and what it gains on left-out data.

    `fit` is None where only a quick fit was made.
    """

    effect: Effect
    drop: float
    values: Mapping[str, float]
    fit: Fit | None = None
    held_out: float = float("nan")

    @property
    def evidence(self) -> float:
        """The drop less what further parameters explain by chance (Schwarz, Annals of Statistics 6, 1978)."""
        return self.drop - PER_FURTHER * (len(self.effect.parameters) - 1) - rarity(self.effect.name)


@dataclass(frozen=True)
class SelectedEffect:
    """An effect accepted, with its rivals: effects that explain the data as well in its place.

    `estimates` are those of parameters that no fit has, because they act by chance or are read off the data.
    """

    candidate: CandidateEffect
    rivals: tuple[str, ...]
    before: Fit
    estimates: Mapping[str, Estimate] = field(default_factory=dict)


def why_not(problem: Problem, before: Fit, candidate: CandidateEffect, inflation: Inflation) -> str:
    """Return why an effect is not named, empty if nothing speaks against it; TOO_SMALL if nothing else does."""
    inflated = inflation.of(candidate.effect.name)
    if candidate.drop < needed(candidate.effect) * inflated:
        return "What it explains may be chance."
    further = unlikelihood(candidate.values, problem.excitation) - unlikelihood(before.values, problem.excitation)
    if candidate.drop < (needed(candidate.effect) + further) * inflated:
        return "It explains too little for sizes that are so unusual."
    names = [parameter.name for parameter in candidate.effect.parameters]
    moment = candidate.values.get(f"{candidate.effect.name}_time")
    if moment is not None and not problem.moving[0] < moment < problem.moving[1]:
        return "It would begin where the drive begins or ends."
    if contradicted({name: candidate.values[name] for name in names}, problem.excitation):
        return "The robot was seen to turn faster."
    stds = {name: candidate.fit.std(name) for name in names} if candidate.fit else {}
    if needs_another_robot(before, candidate.values):
        return "It would need absurd values of the paper's parameters."
    if any(at_its_end(definition(name), candidate.values[name]) for name in names):
        return "It would need absurd values of its own parameters."
    if any(not stds[name] > 0.0 for name in names if name in stds and definition(name).switches):
        return "These drives do not tell its size."
    if candidate.fit is not None and not candidate.held_out > 0.0:
        return "It does not hold on data that it was not fitted on."
    return "" if worth_naming({name: candidate.values[name] for name in names}, stds, problem.excitation) else TOO_SMALL


def needs_another_robot(before: Fit, after: Mapping[str, float]) -> bool:
    """Tell whether the paper's parameters change so much that the robot would be another one.

    The motor's rate may change towards what is usual: without the effect that is there, it can be far off.
    """
    ratios = [after[name] / before.values[name] for name in before.names if name in PAPER and name != "k2_over_k3"]
    if any(not 1.0 / ABSURD < ratio < ABSURD for ratio in ratios):
        return True
    rates = [abs(np.log(one["k1"] * one["k2_over_k3"] / USUAL_RATE)) for one in (before.values, after)]
    return "k2_over_k3" in before.names and rates[1] > rates[0] + np.log(ABSURD)


def at_its_end(parameter: ParameterDefinition, value: float) -> bool:
    """Tell whether a value is as far from neutral as the parameter allows."""
    bounds = [bound for bound in (parameter.lower, parameter.upper) if bound != parameter.neutral]
    return parameter.switches and any(abs(value - bound) <= AT_ITS_END * abs(bound) for bound in bounds)


def needed(effect: Effect) -> float:
    """Return the drop of the sum of squares below which an effect may be chance."""
    chosen = OF_A_PLACE if locality(effect) == "place" else 0.0
    return THRESHOLD + PER_PARAMETER * (len(effect.parameters) - 1) + chosen


def held_out_gain(problem: Problem, before: Fit, after: Fit) -> float:
    """Return the log-likelihood that a fit gains over another on folds that both leave out."""
    return 0.5 * (left_out(before, problem.folds) - left_out(after, problem.folds))


def left_out(fit: Fit, folds: np.typing.NDArray[np.int64]) -> float:
    """Return the sum of squared white errors of folds, each foretold by a fit without it (to first order).

    When and where an effect acts stays as found: without the moment itself, slopes say nothing of it.
    """
    total = 0.0
    refitted = [name in PAPER or definition(name).switches for name in fit.names]
    every = fit.slopes[:, refitted]
    normal, right = every.T @ every, every.T @ fit.rest
    for fold in np.unique(folds):
        inside = folds == fold
        slopes, rest = every[inside], fit.rest[inside]
        remaining = normal - slopes.T @ slopes
        step = -np.linalg.lstsq(remaining, right - slopes.T @ rest, rcond=1e-10)[0]
        foretold = rest + slopes @ step
        total += float(foretold @ foretold)
    return total
