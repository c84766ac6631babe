"""Estimate a robot's parameters together with the effects that its recordings show.

Calibration and diagnosis both call this module, so they give the same numbers for the same recordings. `estimate` reads
in the order of its stages, each with formulas and references in its module:

    data                  checks.py, segments.py; preparation.py also fits the paper's model
    criterion             criterion.py: errors of one-step predictions, or of free runs
    selection             search/selection.py, which repeats until nothing improves:
        screening         search/screening.py, with search/inflation.py
        fit               search/ranking.py, search/adding.py
        judgement         search/criteria.py
        cross-validation  search/cross_validation.py
        exchange          search/exchange.py, search/leap.py
    backward elimination  search/elimination.py
    what remains          unexplained/extending.py
    laws                  laws/proposing.py, laws/searching.py: formulas for what no effect describes
    verdict               usefulness.py: effects that do not help on left-out data are withdrawn
    averaging             averaging.py: parameters averaged over undetected effects

docs/reference/thresholds.md lists the numbers by which they decide; scripts/trace_search lists the functions that
control passes through for a log.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from cmr.estimation.candidates import size
from cmr.estimation.checks import Checked, findings_of, looked_at, require_of_use_held_out, with_lags_found
from cmr.estimation.criterion import search_effects
from cmr.estimation.estimates import Estimate, EstimationError, model_form_std
from cmr.estimation.gain import Measured, NominalMeasured, measure_nominal, with_mean_of_chance
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.preparation import ACTING_BY_CHANCE, Ready, prepare
from cmr.estimation.search.late_wheels import with_late_wheels
from cmr.estimation.search.selection import Search
from cmr.estimation.segments import Segment
from cmr.estimation.unexplained.extending import extended
from cmr.estimation.usefulness import Whole, that_holds
from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.effect import Effect
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.velocity_controller import VelocityController
from cmr.parameters.file import MOTOR, ParameterFile
from cmr.recordings.faults.late_wheels import IN_TIME
from cmr.recordings.lags import Lag
from cmr.recordings.recording import Recording

SEEN_IN_A_PATH = 0.02  # of the typical size: a larger effect, even if not named, changes predicted paths


@dataclass(frozen=True)
class Estimation:
    """The result of an estimation from recordings of one robot.

    `ready` are the prepared recordings, or the reason for their refusal; then all else is None. `nominal`, the robot as
    given, is also None if it was not requested, or if parameters needed for a simulation are missing. `controller` is
    the robot's velocity controller, None if it takes duties. `against` means that the baseline is the robot as given,
    including effects.
    """

    looked: tuple[Checked, ...]
    ready: Ready
    whole: Whole | None = None
    measured: Measured | None = None
    nominal: NominalMeasured | None = None
    controller: VelocityController | None = None
    against: bool = False

    @property
    def found(self) -> Search:
        """The result of the search."""
        assert self.whole is not None
        return self.whole.extended.found

    @property
    def segments(self) -> list[Segment]:
        """The recordings cut into segments, before any are thinned."""
        return [segment for one in self.looked if not one.useless for segment in one.segments]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The parameters of the whole model: the paper's that the data determine, and those of effects in use."""
        assert self.whole is not None
        in_use = self.parameters
        return {name: self.estimate(name) for name in self.whole.model.names if name in in_use}

    @property
    def baseline(self) -> dict[str, Estimate]:
        """The parameters of the paper's model fitted alone."""
        return {name: fit_estimate(self.found.base, name, self.found) for name in self.found.base.names}

    def estimate(self, name: str) -> Estimate:
        """Return a parameter of the whole model, or of a random effect."""
        assert self.whole is not None
        by_chance = [one.estimates[name] for one in self.found.named if name in one.estimates]
        if by_chance:
            return by_chance[0]
        if self.whole.average is None:
            return fit_estimate(self.whole.extended.final, name, self.found, self.whole.extra_stds)
        average = self.whole.average
        doubt = np.hypot(self.whole.extra_stds.get(name, 0.0), self._model_form_std(name))
        return Estimate(average.values[name], float(np.hypot(average.std(name), doubt)))

    def cause(self, effect: Effect) -> str:
        """Return the sentence that names the cause of a selected effect, worded for this kind of robot."""
        values = {parameter.name: self.estimate(parameter.name).value for parameter in effect.parameters}
        if self.controller is None:
            return effect.sentence(values)
        assert self.whole is not None
        return effect.sentence_of_speed(values, self.controller.top_wheel_speed, self.whole.model.values["k2_over_k3"])

    @property
    def parameters(self) -> dict[str, float]:
        """All values of the whole model, by name, except meaningless ones.

        Effects that were not named are kept if they change the predicted path.
        """
        assert self.whole is not None
        values = dict(self.whole.model.values)
        term = self.whole.extended.term
        named: set[str] = set(term.names if term else ())
        for one in self.found.named:
            named.update(parameter.name for parameter in one.candidate.effect.parameters)
            values.update({name: estimate.value for name, estimate in one.estimates.items()})
        for effect in CATALOGUE.values() if self.whole.average else ():
            own = {parameter.name: parameter for parameter in effect.parameters}
            if not named & set(own) and (effect.is_sensor or not any(map(self._shows, own))):
                values = self.found.problem.excitation.without(values, own)
        idle = {one.name for effect in CATALOGUE.values() if not effect.is_on(values) for one in effect.given}
        known = {name: v for name, v in values.items() if name not in self.ready.unknown and name not in idle}
        return {name: value for name, value in known.items() if name in PAPER or value != definition(name).neutral}

    def _shows(self, name: str) -> bool:
        """Return whether the mean of a parameter of an unnamed effect changes a predicted path."""
        assert self.whole is not None
        parameter, excitation = definition(name), self.found.problem.excitation
        if not parameter.switches or parameter.neutral is None:
            return False
        neutral = excitation.neutral(name)
        return abs(self.whole.model.values.get(name, neutral) - neutral) > SEEN_IN_A_PATH * size(parameter, excitation)

    def _model_form_std(self, name: str) -> float:
        assert self.whole is not None
        named = {parameter.name for one in self.found.named for parameter in one.candidate.effect.parameters}
        there = {n: value for n, value in self.whole.model.values.items() if n in PAPER or n in named or n == name}
        return model_form_std(name, there, self.found.problem.excitation)


def estimate(
    recordings: Sequence[Recording],
    nominal: ParameterFile,
    *,
    held_out: Sequence[Recording] = (),
    sources: Sequence[str] = (),
    held_out_sources: Sequence[str] = (),
    against_nominal: bool = True,
    departing: bool = False,
    progress: Callable[[str], None] = lambda _sentence: None,
) -> Estimation:
    """Estimate one robot's parameters from one or more of its recordings; `ready` reports problems of the data.

    `nominal` gives at least wheel_radius. On `held_out` the gain is measured, and nothing is fitted. `sources` and
    `held_out_sources` name the recordings. With `against_nominal` the robot as given is measured, too. With
    `departing`, `nominal` is a complete robot, including effects, and the search is for deviations from it. `progress`
    receives sentences on the current step. Raises EstimationError if nothing can be fitted for a reason other than
    bad data.
    """
    # OpenBLAS threads spin on matrices as small as these: a fit of 4 s would take 40 s on two processors.
    with threadpool_limits(1, "blas"):
        progress("Checking the data ...")
        looked = tuple(looked_at(recordings, sources))
        ready = prepare(looked, nominal, departing=departing)
        if (problem := ready.problem) is None:
            return Estimation(looked, ready, against=departing)
        late = looked[0].findings.wheels_late
        unseen = looked_at(held_out, held_out_sources, "held-out recording", late or IN_TIME)
        ready = _with_held_out(ready, looked, unseen)
        found = with_late_wheels(search_effects(ready, progress), late)
        progress("Analysing the residuals ...")
        segments = [predictor.segment for predictor in problem.predictors]
        others = [segment for one in unseen for segment in one.segments]
        whole = extended(problem if found.problem.one_step else found.problem, found, others)
        progress("Averaging over undetected effects ...")
        delivered, measured = that_holds(whole, segments, others)
        given = _nominal_values(nominal, ready, departing) if against_nominal else {}
        nominal_measured = measure_nominal(problem, given, measured, segments, others, delivered.model.values)
        estimation = Estimation(looked, ready, delivered, measured, nominal_measured, against=departing)
        return _with_checks(estimation, unseen)


def _with_checks(estimation: Estimation, held_out: Sequence[Checked]) -> Estimation:
    """Return the estimation with clock lags in the checks replaced by those of the model, so that reports are
    consistent.
    """
    late: dict[str, list[Estimate]] = {}
    for effect in (one.candidate.effect for one in estimation.found.named):
        if effect.lateness_of:
            late.setdefault(effect.lateness_of, []).append(estimation.estimate(effect.name))
    lags = [
        Lag(sensor, "wheels", sum(one.value for one in found), math.hypot(*(one.std for one in found)))
        for sensor, found in late.items()
    ]
    looked = with_lags_found(estimation.looked, lags)
    return replace(estimation, ready=replace(estimation.ready, checks=findings_of([*looked, *held_out])))


def _with_held_out(ready: Ready, fitted: Sequence[Checked], held_out: Sequence[Checked]) -> Ready:
    """Return the prepared recordings with the findings and notes of held-out ones, which must be usable."""
    assert ready.problem is not None
    path = any(len(predictor.segment.observations.pose) for predictor in ready.problem.predictors)
    require_of_use_held_out(held_out, path=path)
    mended = [f"{one.name}: {one.note}" for one in held_out if one.note]
    return replace(ready, checks=findings_of([*fitted, *held_out]), notes=(*ready.notes, *mended))


def _nominal_values(nominal: ParameterFile, ready: Ready, departing: bool) -> dict[str, float]:
    """Return all values of the robot as it was given, by name; empty if it cannot be simulated with them.

    If the model is driven by measured wheel speeds, motor parameters are not needed. With deviations from a given
    robot, both models are run alike: random effects are replaced by their means.
    """
    motors = {name: ready.start[name] for name in MOTOR} if ready.rolling else {}
    values = {**motors, **{name: value.value for name, value in nominal.values.items()}}
    if departing:
        values = with_mean_of_chance({name: v for name, v in values.items() if name not in ACTING_BY_CHANCE}, values)
    return values if set(PAPER) <= set(values) else {}


def nominal_of(recordings: Sequence[Recording], given: ParameterFile | None) -> ParameterFile:
    """Return the parameters given, else the first that a recording announces.

    Raises EstimationError if they lack the wheel radius.
    """
    nominal = given or next((r.parameters for r in recordings if r.parameters is not None), None)
    if nominal is None or not nominal.has("wheel_radius"):
        raise EstimationError(
            "The wheel radius is not known: the log announces no parameters. Give a file with at least wheel_radius "
            "by --parameters."
        )
    return nominal


def fit_estimate(fit: Fit, name: str, found: Search, extra_stds: Mapping[str, float] | None = None) -> Estimate:
    """Return a parameter of a fit; its standard deviation includes `extra_stds`, by default those of the search."""
    value = fit.values[name]
    extra_stds = found.extra_stds if extra_stds is None else extra_stds
    doubt = np.hypot(extra_stds.get(name, 0.0), model_form_std(name, fit.values, found.problem.excitation))
    return Estimate(value, float(np.sqrt(found.inflation * fit.std(name) ** 2 + doubt**2)))
