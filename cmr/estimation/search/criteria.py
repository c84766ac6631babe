"""Acceptance criteria of an effect: significance, validity on other data, possible values, and size.

With the drop D = S(before) - S(after) by its k parameters, and the inflation of its score (inflation.py):

    significant   D >= inflation (THRESHOLD + PER_PARAMETER (k - 1) + OF_A_PLACE if it chose a place)
    usual sizes   D >= inflation (the same + unlikelihood of its sizes, minus that of the model before)
    own readings  a gyro or tracker effect may not raise S of its own sensor's readings by as much
    lasting       with a start time or a place, D without its best AT_ONCE seconds is sufficient as well
    holds         G > 0, with G = (S_left_out(before) - S_left_out(after)) / 2
    possible      values inside their ranges, and the paper's parameters not those of another robot
    large enough  a parameter larger than SMALLEST of its typical size, and than SURE standard deviations; of NEARLY
                  this size, if free runs on left-out data are much better with it (elimination.py)

S_left_out predicts each fold f without it, to first order from the fit's errors w (n,) and slopes J (n, p):

    w_f + J_f step_f,    step_f = -(J'J - J_f'J_f)^-1 (J'w - J_f'w_f)

References: S. S. Wilks, Annals of Mathematical Statistics 9, 1938 (likelihood ratio); D. M. Allen, Technometrics 16,
1974 (prediction errors of left-out data).
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cmr.estimation.candidates import USUAL_RATE, Excitation, rarity, unlikelihood, worth_naming
from cmr.estimation.estimates import Estimate
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.prediction import POSE_SIGNALS, SIGNALS
from cmr.estimation.problem import Problem
from cmr.estimation.search.cross_validation import as_seen
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.measures import (
    at_the_end,
    implausible_change,
    left_out_gain,
    likelihood_ratio,
    moment_at_an_end,
    of_one_moment,
    place_everywhere,
    readings_lost,
    size_below_limit,
    turns_exceeded,
    undetermined,
)
from cmr.estimation.search.trace import Measure
from cmr.model.catalogue import definition
from cmr.model.effect import Effect
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import ParameterDefinition
from cmr.recordings.signal import Floats

THRESHOLD = 30.0  # drop of the sum of squares required of one parameter
PER_PARAMETER = 5.0  # additional, per further parameter
# additional, for the best of thousands of places, because slowly varying pose errors make some stand out
OF_A_PLACE = 50.0
CLEARLY = 3.0  # times the required drop: an effect above it to first order is needed
PER_FURTHER = 10.0  # about the log of the number of errors: required drop of each further parameter (BIC)
NEARLY = 0.5  # of the size that is large enough: an effect of this size stays in the search, and matters,
MUCH_BETTER = 0.25  # if it explains this share of the squares of wheels or poses in free runs on left-out data
ABSURD = 4.0  # factor of change of the paper's parameters that rules out an effect
LARGEST_STRETCH = 0.5  # largest distortion of poses, relative to a usual distance from the origin
FARTHEST = 1.5  # times its RMS distance from the origin, about the largest distance on a drive of loops
AT_ONCE = 1.0  # s; an effect of one such moment may be a bump, or a command with a late stamp
AT_ITS_END = 1e-3  # of a bound; nearer values count as being at it
READINGS = {"gyro": ("yaw_rate",), "pose": POSE_SIGNALS}  # of sensors that do not affect the motion, by their stage
TOO_SMALL = "It is too small to matter."
MAY_BE_CHANCE = "Its improvement of the fit may be chance."
IN_ONE_MOMENT = "It explains only one moment."
TOO_UNUSUAL = "It explains too little for sizes that are so unusual."


@dataclass(frozen=True)
class CandidateEffect:
    """An effect fitted beside others: its drop of the sum of squared white errors, and its gain on left-out data.

    `fit` is None after a quick fit. `measure` is the number that rules the effect out, if any.
    """

    effect: Effect
    drop: float
    values: Mapping[str, float]
    fit: Fit | None = None
    held_out: float = float("nan")
    measure: Measure | None = None

    def reason(self, why: str) -> str:
        """Return the reason why the effect is not named: the sentence of its measure, otherwise `why`."""
        return self.measure.sentence if self.measure else why

    @property
    def evidence(self) -> float:
        """The drop minus the penalty of further parameters (Schwarz, Annals of Statistics 6, 1978)."""
        return self.drop - PER_FURTHER * (len(self.effect.parameters) - 1) - rarity(self.effect.name)


@dataclass(frozen=True)
class SelectedEffect:
    """An accepted effect with its rivals: effects that explain the data as well instead of it.

    `estimates` are those of parameters that are not fitted, because they are random or read off the data.
    """

    candidate: CandidateEffect
    rivals: tuple[str, ...]
    before: Fit
    estimates: Mapping[str, Estimate] = field(default_factory=dict)


def why_not(problem: Problem, before: Fit, candidate: CandidateEffect, inflation: Inflation) -> str:
    """Return why an effect is not named, empty if it may be named; TOO_SMALL if that is the only reason."""
    return next((why for why, _ in _objections(problem, before, candidate, inflation)), "")


def measured(
    problem: Problem, before: Fit, candidate: CandidateEffect, inflation: Inflation, why: str
) -> CandidateEffect:
    """Return an effect with the measure behind a reason of `why_not`; unchanged for any other reason."""
    measures = (measure for reason, measure in _objections(problem, before, candidate, inflation) if reason == why)
    return replace(candidate, measure=next(measures, candidate.measure))


def too_small(candidate: CandidateEffect, excitation: Excitation) -> Measure | None:
    """Return by how much an effect is too small to be named; None if it is large enough."""
    return size_below_limit(candidate.effect, candidate.values, _stds(candidate), excitation)


def nearly_large(candidate: CandidateEffect, excitation: Excitation) -> bool:
    """Return whether an effect is at least NEARLY as large as one that is large enough."""
    own = {one.name: candidate.values[one.name] for one in candidate.effect.parameters}
    return worth_naming(own, _stds(candidate), excitation, NEARLY)


def _stds(candidate: CandidateEffect) -> dict[str, float]:
    """Return the standard deviations of an effect's parameters if everything was free in its fit, otherwise none.

    A shape parameter at its bound does not question the existence of the effect and is omitted.
    """
    if candidate.fit is None:
        return {}
    own = candidate.effect.parameters
    ended = [one.name for one in own if not one.switches and candidate.values[one.name] in (one.lower, one.upper)]
    return {one.name: candidate.fit.std_beside(one.name, ended) for one in own}


def _objections(
    problem: Problem, before: Fit, candidate: CandidateEffect, inflation: Inflation
) -> Iterator[tuple[str, Measure]]:
    """Yield objections to naming an effect, each with the measure that decides."""
    values, drop, inflated = candidate.values, candidate.drop, inflation.of(candidate.effect.name)
    # A rare effect may only imitate small errors of others: its rarity counts twice.
    least = needed(candidate.effect) + rarity(candidate.effect.name)
    if drop < least * inflated:
        yield MAY_BE_CHANCE, likelihood_ratio(drop, least * inflated)
    least += unlikelihood(values, problem.excitation) - unlikelihood(before.values, problem.excitation)
    if drop < least * inflated:
        yield TOO_UNUSUAL, likelihood_ratio(drop, least * inflated, unusual=True)
    lost = _lost_readings(problem, before, candidate)
    if lost > least * inflated:
        yield "It makes the readings of its own sensor less likely.", readings_lost(lost, least * inflated)
    if candidate.effect.locality and drop - (at_once := _at_once(problem, before, candidate)) < least * inflated:
        yield IN_ONE_MOMENT, of_one_moment(drop - at_once, least * inflated, AT_ONCE)
    stds = _stds(candidate)
    yield from _impossible(problem, before, candidate, stds)
    if candidate.fit is not None and not candidate.held_out > 0.0:
        yield "It does not hold on data left out of the fit.", left_out_gain(candidate.held_out)
    small = too_small(candidate, problem.excitation)
    if small is not None:
        yield TOO_SMALL, small


def _lost_readings(problem: Problem, before: Fit, candidate: CandidateEffect) -> float:
    """Return how much a gyro or tracker effect raises the squares of its own sensor's white errors; 0 for others.

    The estimated position decides whether the robot is inside a place that acts on its wheels. So a tracker effect may
    improve the prediction of wheels by chance, at the expense of the poses.
    """
    effect, fit = candidate.effect, candidate.fit
    if fit is None or not effect.is_sensor or not problem.one_step:
        return 0.0
    own = {name for stage in effect.equations for name in READINGS.get(stage.partition("_")[0], SIGNALS)}
    rows = np.flatnonzero(problem.rows_of(own))  # by number: prior terms, which belong to no sensor, come last
    return float(np.sum(fit.rest[rows] ** 2) - np.sum(before.rest[rows] ** 2)) if own < {*SIGNALS} else 0.0


def _at_once(problem: Problem, before: Fit, candidate: CandidateEffect) -> float:
    """Return the largest gain of an effect within AT_ONCE; 0 if no fit localises it in time."""
    if candidate.fit is None or not problem.one_step:
        return 0.0
    return most_at_once(problem, before.rest**2 - candidate.fit.rest**2)


def most_at_once(problem: Problem, gained: Floats) -> float:
    """Return the largest sum within AT_ONCE of the gains at each white error, (n,); prior terms come after."""
    when = np.concatenate([t + p.segment.observations.time for p in problem.predictors for t in p.times.values()])
    of = np.concatenate([np.full(len(t), p.segment.recording) for p in problem.predictors for t in p.times.values()])
    most = 0.0
    for phase in (0.0, 0.5):
        number = np.floor(when / AT_ONCE + phase).astype(np.int64)
        _, moments = np.unique(np.stack([of, number]), axis=1, return_inverse=True)
        most = max(most, float(np.bincount(moments.ravel(), gained[: len(when)]).max()))
    return most


def _impossible(
    problem: Problem, before: Fit, candidate: CandidateEffect, stds: Mapping[str, float]
) -> Iterator[tuple[str, Measure]]:
    """Yield objections to impossible or undetermined values of an effect, or of the paper's parameters beside it."""
    values, names = candidate.values, [parameter.name for parameter in candidate.effect.parameters]
    if candidate.effect.locality == "time":
        time = candidate.effect.parameter_of("time")
        if not problem.moving[0] < values[time] < problem.moving[1]:
            at_an_end = moment_at_an_end(time, values[time], problem.moving)
            yield "It would begin where the drive begins or ends.", at_an_end
    if candidate.effect.locality == "place":
        x, y, radius = (candidate.effect.parameter_of(kind) for kind in ("x", "y", "radius"))
        reach, extent = values[radius] - math.hypot(values[x], values[y]), FARTHEST * problem.excitation.extent
        if reach > extent:
            everywhere = place_everywhere(radius, reach, extent)
            yield "It would be everywhere, not at a place.", everywhere
    own = {name: values[name] for name in names}
    seen = as_seen(own, problem.excitation)
    for name in (name for name in names if seen[name] != own[name]):
        yield "The robot was seen to turn faster.", turns_exceeded(name, own[name], seen[name])
    if needs_another_robot(before, values):
        name, factor = _most_changed(before, values)
        change = implausible_change(name, factor, ABSURD)
        yield "It would need implausible values of the paper's parameters.", change
    for name in (name for name in names if definition(name).kind == "stretch"):
        stretch = abs(values[name]) * problem.excitation.extent**2
        if stretch > LARGEST_STRETCH:
            yield "It would need implausible values of its own parameters.", at_the_end(name, values[name])
    for name in (name for name in names if at_its_end(definition(name), values[name])):
        yield "It would need implausible values of its own parameters.", at_the_end(name, values[name])
    for name, std in stds.items():
        if definition(name).switches and not std > 0.0:
            yield "These drives do not determine its size.", undetermined(name, std)


def _most_changed(before: Fit, after: Mapping[str, float]) -> tuple[str, float]:
    """Return the paper's parameter that an effect changes most, and its ratio; for k2_over_k3, the motor's rate."""
    ratios = {name: after[name] / before.values[name] for name in before.names if name in PAPER}
    if "k2_over_k3" in ratios:
        rates = [one["k1"] * one["k2_over_k3"] for one in (before.values, after)]
        ratios["k2_over_k3"] = rates[1] / rates[0]
    worst = max(ratios, key=lambda name: abs(math.log(ratios[name])) if ratios[name] > 0.0 else math.inf)
    return "the motor's rate, k1 k2_over_k3," if worst == "k2_over_k3" else worst, ratios[worst]


def needs_another_robot(before: Fit, after: Mapping[str, float]) -> bool:
    """Return whether the paper's parameters change implausibly.

    The motor's rate may change towards usual values, because without a present effect it can be far off.
    """
    ratios = [after[name] / before.values[name] for name in before.names if name in PAPER and name != "k2_over_k3"]
    if any(not 1.0 / ABSURD < ratio < ABSURD for ratio in ratios):
        return True
    rates = [abs(np.log(one["k1"] * one["k2_over_k3"] / USUAL_RATE)) for one in (before.values, after)]
    return "k2_over_k3" in before.names and rates[1] > rates[0] + np.log(ABSURD)


def at_its_end(parameter: ParameterDefinition, value: float) -> bool:
    """Return whether a value is at the bound farthest from neutral."""
    bounds = [bound for bound in (parameter.lower, parameter.upper) if bound != parameter.neutral]
    return parameter.switches and any(abs(value - bound) <= AT_ITS_END * abs(bound) for bound in bounds)


def needed(effect: Effect) -> float:
    """Return the drop of the sum of squares below which an effect may be chance; rare effects need more."""
    chosen = OF_A_PLACE if effect.locality == "place" else 0.0
    return THRESHOLD + PER_PARAMETER * (len(effect.parameters) - 1) + chosen + rarity(effect.name)


def held_out_gain(problem: Problem, before: Fit, after: Fit) -> float:
    """Return the log-likelihood that a fit gains over another on folds that both leave out."""
    return 0.5 * (left_out(before, problem.folds) - left_out(after, problem.folds))


def left_out(fit: Fit, folds: np.typing.NDArray[np.int64]) -> float:
    """Return the sum of squared white errors of folds, each predicted by a fit without it (to first order).

    It is infinite if the fitted model is invalid.
    """
    if not math.isfinite(fit.squares):
        return math.inf
    errors = left_out_errors(fit, folds)
    return float(errors @ errors)


def left_out_errors(fit: Fit, folds: np.typing.NDArray[np.int64]) -> Floats:
    """Return the white errors (n,), those of each of the `folds` (n,) predicted by a fit without it (to first order).

    The time and place of an effect are kept: without the data around them, slopes do not determine them.
    """
    errors = np.empty_like(fit.rest)
    refitted = [name in PAPER or definition(name).switches for name in fit.names]
    every = fit.slopes[:, refitted]
    normal, right = every.T @ every, every.T @ fit.rest
    for fold in np.unique(folds):
        inside = folds == fold
        slopes, rest = every[inside], fit.rest[inside]
        remaining = normal - slopes.T @ slopes
        step = -np.linalg.lstsq(remaining, right - slopes.T @ rest, rcond=1e-10)[0]
        errors[inside] = rest + slopes @ step
    return errors
