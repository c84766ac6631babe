"""Diagnose the errors of the paper's model for a robot, and their causes."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cmr.diagnosis.against_file import compared, with_given_baseline
from cmr.diagnosis.against_nominal import notes_on_nominal
from cmr.diagnosis.laws import experiment_to_decide
from cmr.diagnosis.next_experiment import (
    WITHOUT_POSES,
    AnyDriver,
    Driver,
    Pilot,
    experiment_to_explain,
    experiment_to_show,
    experiment_to_tell_apart,
    showable,
    without_commands,
)
from cmr.diagnosis.paths import most_telling, paths_of
from cmr.diagnosis.result import (
    BAD_DATA,
    Against,
    Candidate,
    Diagnosis,
    Evidence,
    Fitted,
    NamedEffect,
)
from cmr.diagnosis.sentence import sentence_of, verdict_of
from cmr.diagnosis.showing import residuals_of
from cmr.estimation.averaging import Posterior
from cmr.estimation.commanded_speeds import (
    as_duties,
    as_motor,
    controller_of,
    correlation_of_motor,
    in_words_of,
    values_in_words_of,
)
from cmr.estimation.estimates import Estimate
from cmr.estimation.estimation import Estimation, estimate, fit_estimate, nominal_of
from cmr.estimation.free_runs import WINDOW, Errors
from cmr.estimation.gain import Gain
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.laws.result import Laws
from cmr.estimation.preparation import Ready
from cmr.estimation.search.criteria import TOO_SMALL, CandidateEffect, SelectedEffect
from cmr.estimation.search.cross_validation import alternatives
from cmr.estimation.search.selection import Search
from cmr.estimation.search.shifts import moved, shifts
from cmr.estimation.search.trace import Decision, with_rivals
from cmr.estimation.unexplained.extending import Extended
from cmr.estimation.unexplained.generic import formula
from cmr.estimation.unexplained.result import GenericTerm, Unexplained, not_judged
from cmr.geometry.manoeuvres.in_words import Pace
from cmr.model.catalogue import CATALOGUE, definitions_of
from cmr.model.laws import Law
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.lateness import Lateness, lateness_of
from cmr.recordings.recording import Recording

BY_FREE_RUNS = "Effects were fitted to simulated paths (simulation error), not to one-step predictions."
FASTEST = 0.98  # of the time a robot is slower than this speed, its pace
NOTHING_FITTED = "The data cannot be used, so nothing was fitted."


def diagnose(
    recordings: Recording | Sequence[Recording],
    nominal: ParameterFile | None = None,
    *,
    against: Against | None = None,
    held_out: Sequence[Recording] = (),
    sources: Sequence[str] = (),
    held_out_sources: Sequence[str] = (),
    laws: Sequence[Law] = (),
    progress: Callable[[str], None] = lambda _sentence: None,
) -> Diagnosis:
    """Diagnose one robot from one or more of its recordings.

    `nominal` gives at least wheel_radius; the default is announced in the first recording. With `against`, the file it
    comes from, it is a complete robot including effects, and differences from it are reported. `held_out` recordings
    are used only to measure the gain. `sources` and `held_out_sources` are the names of recordings. `laws` known to
    this process are tested by name, as are those of `nominal`. `progress` receives sentences on the current step.
    Raises EstimationError when the paper's model cannot be fitted for a reason other than bad data, or when no gain can
    be measured on one of `held_out`.
    """
    recordings = [recordings] if isinstance(recordings, Recording) else list(recordings)
    nominal = _with_laws(nominal_of(recordings, nominal), laws)
    controller = controller_of([*recordings, *held_out], nominal)
    estimation = estimate(
        [as_duties(recording, controller) for recording in recordings],
        as_motor(nominal, controller),
        held_out=[as_duties(recording, controller) for recording in held_out],
        sources=sources,
        held_out_sources=held_out_sources,
        departing=against is not None,
        progress=progress,
    )
    estimation = replace(with_given_baseline(estimation) if against else estimation, controller=controller)
    if estimation.whole is None:
        return replace(_refused(recordings[0].robot_id, estimation.ready, tuple(sources)), against=against)
    found = _found(recordings, estimation, nominal, named=bool(sources))
    if against is not None:
        return compared(found, estimation, nominal, against)
    return replace(found, notes=(*found.notes, *notes_on_nominal(nominal, found)))


def _found(
    recordings: Sequence[Recording], estimation: Estimation, nominal: ParameterFile, *, named: bool
) -> Diagnosis:
    """Return the diagnosis of usable recordings; `named` says that the recordings have names."""
    evidence = _evidence(estimation)
    fitted = tuple(one.name for one in estimation.looked if not one.useless) if named else ()
    driver = _driver(recordings, estimation, evidence, nominal)
    return _diagnosis(recordings[0].robot_id, estimation, evidence, fitted, driver)


def _lateness(estimation: Estimation) -> dict[str, Lateness]:
    """Return how late commands took effect in each recording, by name, in which that was measured."""
    found = {one.name: lateness_of(one.recording) for one in estimation.looked if not one.useless}
    return {name: one for name, one in found.items() if one is not None}


def _with_laws(nominal: ParameterFile, laws: Sequence[Law]) -> ParameterFile:
    """Return the robot as given with possible laws added, with coefficients of 0."""
    new = [law for law in laws if law.name not in nominal.effects]
    zero = {name: Value(0.0) for law in new for name in law.coefficients}
    constants = {law.parameter_of(name): Value(float(value)) for law in new for name, value in law.constants.items()}
    effects = (*nominal.effects, *(law.name for law in new))
    return replace(nominal, values={**nominal.values, **zero, **constants}, effects=effects)


def _refused(robot_id: int, ready: Ready, sources: tuple[str, ...]) -> Diagnosis:
    """Return the diagnosis of data that cannot be trusted."""
    return Diagnosis(
        robot_id=robot_id,
        verdict=BAD_DATA,
        sentence=ready.refused,
        unexplained=not_judged(NOTHING_FITTED),
        checks=ready.checks,
        notes=ready.notes,
        sources=sources,
    )


def _driver(
    recordings: Sequence[Recording], estimation: Estimation, evidence: Evidence, nominal: ParameterFile
) -> Driver:
    """Return `cmr-pilot` if the robot takes commands from the bus, otherwise any driver at the pace of these
    recordings.
    """
    robot = RobotParameters.of({name: estimation.found.final.values[name] for name in PAPER})
    if all(recording.driven_on_the_bus for recording in recordings):
        return Pilot(recordings[0].robot_id, robot)
    speed, turn_rate = (
        float(max((np.quantile(np.abs(one.regressors[name]), FASTEST) for one in evidence.residuals), default=0.0))
        for name in ("speed", "yaw_rate")
    )
    width = nominal.value("base_width") if nominal.has("base_width") else float(robot.base_width)
    return AnyDriver(Pace.seen(speed, turn_rate, width))


def _evidence(estimation: Estimation) -> Evidence:
    """Return the report's data on the paper's model and on the extended one."""
    assert estimation.whole is not None
    models = estimation.found.base.values, estimation.whole.model.values
    segments = [predictor.segment for predictor in estimation.found.problem.predictors]
    paths = paths_of(segments, *models, [one.name for one in estimation.looked])
    return Evidence(
        window=WINDOW,
        paths=most_telling(paths),
        pieces=len(paths),
        residuals=residuals_of(segments, *models, estimation.found.problem.excitation.given),
    )


def _diagnosis(
    robot_id: int,
    estimation: Estimation,
    evidence: Evidence,
    sources: tuple[str, ...],
    driver: Driver,
) -> Diagnosis:
    whole, measured, ready = estimation.whole, estimation.measured, estimation.ready
    assert whole is not None
    assert measured is not None
    controller = estimation.controller
    found, unexplained = estimation.found, _unexplained(whole.extended, measured.gain)
    named = zip(found.named, shifts(found), strict=True)
    effects = tuple(_named(one, moved_by, estimation, driver) for one, moved_by in named)
    laws = whole.extended.laws
    baseline, extended = _fitted_models(estimation)
    return Diagnosis(
        robot_id=robot_id,
        verdict=verdict_of(effects, laws, unexplained),
        sentence=sentence_of(effects, laws, unexplained, found, extended),
        laws=laws,
        unexplained=unexplained,
        baseline=baseline,
        extended=extended,
        gain=measured.gain,
        nominal=_nominal(estimation),
        gain_over_nominal=estimation.nominal.gain if estimation.nominal else None,
        evidence=evidence,
        effects=effects,
        candidates=_candidates(found),
        checks=ready.checks,
        notes=ready.notes if found.problem.one_step else (*ready.notes, BY_FREE_RUNS),
        next_experiment=_next(driver, effects, found, unexplained, laws),
        not_visible=found.unseen,
        parameters=values_in_words_of(estimation.parameters, controller),
        sources=sources,
        samples=len(found.final.rest),
        lateness=_lateness(estimation),
        decisions=_decisions(found, effects),
    )


def _decisions(found: Search, effects: Sequence[NamedEffect]) -> tuple[Decision, ...]:
    """Return the decisions of the search, with the rivals of named effects."""
    rivals = [(one.name, rival) for one in effects for rival in one.indistinguishable_from]
    return with_rivals(found.decisions, rivals)


def _fitted_models(estimation: Estimation) -> tuple[Fitted, Fitted]:
    """Return the paper's model and the extended one, each with its errors."""
    whole, measured, controller = estimation.whole, estimation.measured, estimation.controller
    assert whole is not None
    assert measured is not None
    before = _in_words(estimation.baseline, estimation.found.base, controller)
    after = _in_words(estimation.estimates, whole.model, controller)
    return (
        _fitted(before, measured.before, measured.held_out_before),
        _fitted(after, measured.after, measured.held_out_after),
    )


def _in_words(
    estimates: Mapping[str, Estimate], model: Fit | Posterior, controller: VelocityController | None
) -> Mapping[str, Estimate]:
    """Return estimates under their names in the robot's parameter file."""
    return in_words_of(estimates, controller, correlation_of_motor(model.names, model.covariance))


def _fitted(estimates: Mapping[str, Estimate], path_rmse: float, held_out: Errors) -> Fitted:
    return Fitted(
        estimates=estimates,
        path_rmse=path_rmse,
        held_out_path_rmse=held_out.rmse("position"),
        held_out_path_median=held_out.median("position"),
        held_out_heading_rmse=held_out.rmse("heading"),
        held_out_heading_median=held_out.median("heading"),
    )


def _nominal(estimation: Estimation) -> Fitted | None:
    """Return the robot as given, without values that are meaningless for these recordings."""
    nominal = estimation.nominal
    if nominal is None:
        return None
    known = {name: Estimate(value, math.nan) for name, value in nominal.values.items()}
    return _fitted(
        {name: one for name, one in known.items() if name not in estimation.ready.unknown},
        nominal.path_rmse,
        nominal.held_out,
    )


def _candidates(found: Search) -> tuple[Candidate, ...]:
    """Return the effects that were tested and not named, with their fitted sizes.

    Of effects that are too small to matter, not in the final model, and explain the same, only the first counts as
    harmless.
    """
    result, alone = [], list[CandidateEffect]()
    for tested, why in found.others:
        harmless = why == TOO_SMALL
        if harmless and found.seen and not _fitted_in(found.seen, tested):
            harmless = not any(alternatives(found.seen, other.fit, tested.fit) for other in alone)
            alone.append(tested)
        result.append(_candidate(tested, why, found, harmless=harmless))
    return tuple(result)


def _candidate(tested: CandidateEffect, why: str, found: Search, *, harmless: bool) -> Candidate:
    drop = max(tested.drop, 0.0)
    return Candidate(
        name=tested.effect.name,
        statistic=drop,
        p_value=p_value(drop, len(tested.effect.parameters), found.inflation),
        held_out=tested.held_out,
        why_not=tested.reason(why),
        estimates=_sizes(tested, found),
        harmless=harmless,
        measure=tested.measure,
    )


def _sizes(tested: CandidateEffect, found: Search) -> dict[str, Estimate]:
    """Return the parameters of an effect that was tested: fitted beside all effects found, otherwise as tested."""
    names = [parameter.name for parameter in tested.effect.parameters if parameter.name in tested.values]
    if found.seen and _fitted_in(found.seen, tested):
        return {name: fit_estimate(found.seen, name, found) for name in names}
    stds = {name: tested.fit.std(name) for name in names if tested.fit and name in tested.fit.names}
    scale = math.sqrt(found.inflation)
    return {name: Estimate(tested.values[name], scale * stds.get(name, math.nan)) for name in names}


def _fitted_in(fit: Fit, tested: CandidateEffect) -> bool:
    return all(parameter.name in fit.names for parameter in tested.effect.parameters)


def _named(one: SelectedEffect, moved_by: Mapping[str, float], estimation: Estimation, driver: Driver) -> NamedEffect:
    effect, found = one.candidate.effect, estimation.found
    names = [parameter.name for parameter in effect.parameters]
    same = found.problem.same_as(effect.name)  # no drive distinguishes them
    estimates = {name: estimation.estimate(name) for name in names}
    return NamedEffect(
        name=effect.name,
        cause=estimation.cause(effect),
        estimates=estimates,
        statistic=one.candidate.drop,
        p_value=p_value(one.candidate.drop, len(names), found.inflation),
        held_out=one.candidate.held_out,
        shift=moved_by,
        indistinguishable_from=(*one.rivals, *same),
        next_experiment=experiment_to_tell_apart(effect.name, one.rivals, driver),
    )


def _next(
    driver: Driver, effects: Sequence[NamedEffect], found: Search, unexplained: Unexplained, laws: Laws
) -> str | None:
    """Return the next drive: to explain what remains unexplained, otherwise to reveal effects not visible in these
    drives.

    None if nothing remains, and all effects would be visible.
    """
    poses = any(len(predictor.segment.observations.pose) for predictor in found.problem.predictors)
    sentences = [] if poses else [WITHOUT_POSES]
    sentences += filter(None, [experiment_to_decide(laws, driver)])
    if unexplained.signal:
        sentences.append(experiment_to_explain(unexplained.signal, unexplained.regressors, driver))
        return " ".join(sentences)
    tested = {effect.name for effect in found.problem.effects}
    recorded = [name for name in found.unseen if name in tested and _recorded(name, found)]
    unseen = showable(recorded, [effect.name for effect in effects])
    if unseen and not any(effect.next_experiment for effect in effects):
        # If these drives hide several effects, they also hide smaller sizes of others.
        sentences.append(experiment_to_show(unseen if effects or len(unseen) == 1 else (), driver))
    need_commands = [name for name in found.unseen if name not in tested]
    if need_commands:
        sentences.append(without_commands(need_commands))
    return " ".join(sentences) or None


def _recorded(name: str, found: Search) -> bool:
    """Return whether the sensor of a sensor effect was recorded; otherwise no drive can reveal it."""
    observations = [predictor.segment.observations for predictor in found.problem.predictors]
    stages = CATALOGUE[name].equations
    if all(stage.startswith("gyro") for stage in stages):
        return any(len(one.gyro) for one in observations)
    return not all(stage.startswith("pose") for stage in stages) or any(len(one.pose) for one in observations)


def _unexplained(whole: Extended, gain: Gain) -> Unexplained:
    """Return the unexplained structure, with the generic term that extends the model.

    If only the term extends the model, its gain is that of the whole model.
    """
    term = whole.generic
    if term is None:
        return whole.unexplained
    estimates = {name: fit_estimate(term.fit, name, whole.found) for name in term.names}
    words = formula({name: estimate.value for name, estimate in estimates.items()})
    gain = term.gain if whole.found.named else gain
    moved_by = moved(whole.found.final, term.fit, whole.found.base.names)
    generic = GenericTerm(estimates=estimates, formula=words, held_out=term.held_out, gain=gain, shift=moved_by)
    return replace(whole.unexplained, generic=generic)


def p_value(drop: float, parameters: int, inflation: float) -> float:
    """Return the probability that chance alone gives such a drop anywhere in the catalogue."""
    from scipy.special import chdtrc  # scipy.stats would do the same, but takes a second to import

    return float(min(1.0, len(definitions_of(CATALOGUE)) * chdtrc(parameters, max(drop, 0.0) / inflation)))
