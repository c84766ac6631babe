"""Calibrate a robot: the paper's three parameters, together with any other effects in the recordings."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cmr.calibration.contradictions import SMALLEST_RADIUS_ERROR, radius_sentence
from cmr.calibration.doubts import in_doubt, in_doubt_alone
from cmr.calibration.paper import calibrate_by_paper
from cmr.calibration.path_errors import path_errors
from cmr.calibration.preparing import REPORTED
from cmr.calibration.result import CalibrationResult, tells
from cmr.estimation.commanded_speeds import as_duties, as_motor, controller_of
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.estimation.estimation import Estimation, estimate, nominal_of
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.simulation_error import SimulationErrorProblem
from cmr.model.parameters import DEFINITIONS
from cmr.model.velocity_controller import VelocityController
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats

AVERAGE, PAPER = METHODS = ("average", "paper")
# Limits, as a factor and in m, by which predicted paths may be worse than with the given parameters.
WORSE, SLIGHTLY_WORSE = 1.1, 0.003
WORSE_THAN_GIVEN = (
    "The given parameters stay: whatever is fitted to this recording predicts paths worse over 3 s ({after:.3f} m) "
    "than they do ({before:.3f} m). Something that no effect explains moves this robot or its sensors. Check the time "
    "stamps of commands, wheels and poses, and run cmr-diagnose."
)
UNDETERMINED = "The drive does not determine it: its standard deviation is {:.0f} % of the value."


def calibrate(
    recordings: Recording | Sequence[Recording],
    nominal: ParameterFile | None = None,
    *,
    method: str = AVERAGE,
    paper_only: bool = False,
) -> CalibrationResult:
    """Calibrate one robot from one or more of its recordings, of any manoeuvre.

    `nominal` gives at least wheel_radius; the default is announced in the recording. The parameters are averaged over
    detected and possible effects (`cmr.estimation`), and the effects in use are part of the result. With `paper_only`
    there are no effects: the three parameters are those that predict best alone. `method` "paper" is the paper's grid
    search over the whole path, which never uses effects. It is the only one for recordings without wheels of robots
    that take duties. Raises EstimationError when nothing can be estimated, when signals contradict each other, or when
    the result predicts paths worse than `nominal`.
    """
    recordings = [recordings] if isinstance(recordings, Recording) else list(recordings)
    _require_one_robot(recordings)
    nominal = nominal_of(recordings, nominal)
    controller = controller_of(recordings, nominal)
    recordings = [as_duties(recording, controller) for recording in recordings]
    nominal = as_motor(nominal, controller)
    if method == PAPER or not (controller or any(len(recording.wheels) for recording in recordings)):
        return replace(calibrate_by_paper(recordings, nominal), controller=controller)
    if not any(len(recording.poses) or recording.gyro.varies("yaw_rate") for recording in recordings):
        return _motors_alone(recordings, nominal, controller)
    estimation = replace(estimate(recordings, nominal, against_nominal=False), controller=controller)
    if estimation.whole is None and not any(len(recording.poses) for recording in recordings):
        return _motors_alone(recordings, nominal, controller)  # without a trustworthy gyro there is no rotation
    if estimation.whole is None:
        raise EstimationError(estimation.ready.refused)
    ways = (_alone, _of_free_runs) if paper_only else (_in_presence, _of_free_runs)
    results = (way(estimation, nominal) for way in ways)
    return first_that_helps(results)


def first_that_helps(results: Iterable[CalibrationResult]) -> CalibrationResult:
    """Return the first result that predicts paths no worse than the given parameters. Raises EstimationError."""
    for result in results:
        before, after = result.path_rmse_before, result.path_rmse_after
        if not after > max(WORSE * before, before + SLIGHTLY_WORSE):
            return result
    raise EstimationError(WORSE_THAN_GIVEN.format(before=before, after=after))


def _motors_alone(
    recordings: Sequence[Recording], nominal: ParameterFile, controller: VelocityController | None
) -> CalibrationResult:
    from cmr.calibration.motors_alone import calibrate_motors  # its least squares take half a second to import

    return replace(calibrate_motors(recordings, nominal), controller=controller)


def _in_presence(estimation: Estimation, nominal: ParameterFile) -> CalibrationResult:
    """Return the result with all effects in use."""
    estimates = estimation.estimates
    return _result(estimation, nominal, estimation.parameters, estimates, "average", in_doubt(estimation))


def _alone(estimation: Estimation, nominal: ParameterFile) -> CalibrationResult:
    """Return the three parameters that predict best without any effect.

    If no effect was found, these are the most likely ones; otherwise those with the least errors of short free runs.
    """
    if estimation.found.named:
        return _of_free_runs(estimation, nominal)
    return _of_three(estimation, nominal, estimation.found.base, estimation.baseline)


def _of_free_runs(estimation: Estimation, nominal: ParameterFile) -> CalibrationResult:
    """Return the three parameters with the least errors of free runs over short windows."""
    problem = estimation.ready.problem
    assert problem is not None
    courses = SimulationErrorProblem(problem.predictors, problem.gains, problem.excitation)
    base = courses.base(estimation.ready.start, estimation.found.base.names)
    bursts = courses.extra_stds(base)
    estimates = {n: Estimate(base.values[n], float(np.hypot(base.std(n), bursts[n]))) for n in base.names}
    return _of_three(estimation, nominal, base, estimates)


def _of_three(
    estimation: Estimation, nominal: ParameterFile, base: Fit, estimates: dict[str, Estimate]
) -> CalibrationResult:
    """Return the three parameters of a fit without effects."""
    parameters = {name: value for name, value in base.values.items() if name in DEFINITIONS}
    parameters = {name: value for name, value in parameters.items() if name not in estimation.ready.unknown}
    doubts = in_doubt_alone(estimation, estimates)
    return _result(estimation, nominal, parameters, estimates, "three parameters alone", doubts)


def _result(
    estimation: Estimation,
    nominal: ParameterFile,
    parameters: dict[str, float],
    estimates: dict[str, Estimate],
    method: str,
    doubts: tuple[str, ...],
) -> CalibrationResult:
    """Return the result; a parameter that the data do not determine keeps its given value."""
    unidentified, trusted = dict(estimation.ready.untold), dict(estimates)
    for name in set(estimates) & set(DEFINITIONS):
        if not tells(estimates[name]):
            unidentified[name] = UNDETERMINED.format(100.0 * estimates[name].std / abs(estimates[name].value))
            if nominal.has(name):
                del trusted[name]
                parameters = {**parameters, name: nominal.value(name)}
    if not set(estimates) & set(DEFINITIONS) - set(unidentified):
        reasons = "; ".join(f"{name}: {reason}" for name, reason in unidentified.items())
        raise EstimationError(f"Nothing could be identified. {reasons}")
    given = {name: value.value for name, value in nominal.values.items()}
    before, after = path_errors(estimation.found.problem, given, parameters)
    return CalibrationResult(
        robot_id=nominal.robot_id if not estimation.looked else estimation.looked[0].recording.robot_id,
        estimates={name: one for name, one in trusted.items() if name in DEFINITIONS},
        unidentified=unidentified,
        nominal=nominal,
        method=method,
        samples=len(estimation.found.final.rest),
        covariance=_covariance(estimation, trusted),
        path_rmse_before=before,
        path_rmse_after=after,
        notes=(*_notes(estimation), *_radius_note(nominal.value("wheel_radius"), estimates), *doubts),
        recordings=tuple(one.recording for one in estimation.looked if not one.useless),
        parameters=parameters,
        effects={name: one for name, one in trusted.items() if name not in DEFINITIONS},
        by_wheels=estimation.ready.rolling,
        controller=estimation.controller,
        named=tuple(one.candidate.effect.name for one in estimation.found.named),
    )


def _covariance(estimation: Estimation, estimates: Mapping[str, Estimate]) -> Floats:
    """Return the covariance of the paper's parameters among these; additional uncertainty is uncorrelated."""
    assert estimation.whole is not None
    model = estimation.whole.model
    names = [name for name in estimates if name in DEFINITIONS]
    at = [model.names.index(name) for name in names]
    covariance = np.array(model.covariance[np.ix_(at, at)], np.float64)
    np.fill_diagonal(covariance, [estimates[name].std ** 2 for name in names])
    return covariance


def _notes(estimation: Estimation) -> tuple[str, ...]:
    """Return sentences on the data, and on the effects found together with the parameters."""
    statements = [
        one.sentence for one in estimation.ready.checks if one.found and (one.check in REPORTED or one.set_aside)
    ]
    causes = [estimation.cause(one.candidate.effect) for one in estimation.found.named]
    return tuple(dict.fromkeys([*statements, *estimation.ready.notes, *causes]))


def _radius_note(radius: float, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Report if both wheels turn more or less than the path requires: the given radius or the ticks are wrong."""
    wrong = {"wheel_radius_scale": -1.0, "encoder_scale": 1.0}
    for name, sign in wrong.items():
        one = estimates.get(name)
        if one is not None and abs(one.value) > max(SMALLEST_RADIUS_ERROR, 3.0 * one.std):
            factor = (1.0 + one.value) ** sign
            return (radius_sentence(factor, radius),)
    return ()


def _require_one_robot(recordings: Sequence[Recording]) -> None:
    """Raise EstimationError unless there are recordings, all of one robot."""
    robots = sorted({recording.robot_id for recording in recordings})
    if not recordings:
        raise EstimationError("No recording was given.")
    if len(robots) > 1:
        raise EstimationError(f"The recordings are of robots {robots}; calibrate each robot by itself.")
