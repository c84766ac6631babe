"""The paper's method (section 2): a grid search over the whole path, simulated freely, and a refinement.

Its error surface explains best what calibration is. A robot that is not quite as the paper's model has it strays from
the whole path, whatever its parameters; `calibrate` is for those.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cmr.calibration.fitting import PAPER_PARAMETERS, Fit, fit_by_path
from cmr.calibration.linear import WHEEL_FACTOR
from cmr.calibration.preparing import Prepared, prepare
from cmr.calibration.result import CalibrationResult
from cmr.calibration.segments import MOVING_DUTY, Segment, heading_range, path_error, travelled
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.estimation.signs import require_consistent_signs
from cmr.model.parameters import DEFINITIONS, RobotParameters
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats

SMALLEST_RADIUS_ERROR = 0.02  # relative; a smaller contradiction of wheels and path may be slip
SMALLEST_TURN = 0.5  # rad; less says nothing about the base width
LARGEST_RELATIVE_STD = 0.3  # an estimate with a larger standard deviation is a guess and is not given
WORST_FACTOR = 3.0  # of wheel angles to the path; beyond it, or under one over it, something is wrong, not inexact
WORST_PATH_ERROR = 0.1  # of the way driven; a larger one means that the model does not explain the drive
CONFUSED = 0.95  # correlation from which on two parameters are called confused


def calibrate_by_paper(
    recordings: Sequence[Recording], nominal: ParameterFile, first: Mapping[str, float] | None = None
) -> CalibrationResult:
    """Find the parameters of one robot by the paper's own method, from commands and poses.

    A grid search over the path that is simulated freely over the whole drive, then a refinement from its best point.
    `nominal` gives at least wheel_radius; effects that it has are left out, and the result says so. `first`, a good
    first guess of the three parameters, saves the grid search.
    Raises EstimationError when nothing at all can be found, or when signals contradict one another.
    """
    prepared = prepare(recordings)
    if nominal.effects:
        prepared = replace(prepared, notes=(*prepared.notes, _WITHOUT_EFFECTS.format(", ".join(nominal.effects))))
        nominal = replace(nominal, effects=(), values={n: v for n, v in nominal.values.items() if n in DEFINITIONS})
    segments = prepared.segments()
    require_consistent_signs(prepared.recordings)
    if not segments or not any(_commanded(recording) for recording in prepared.recordings):
        raise EstimationError(
            "The paper's method compares paths: it takes poses (POSE_N) with commands (MOTOR_COMMAND_N), and the log "
            f"has {_contents(prepared.recordings)}."
        )
    return _by_path(prepared, segments, nominal, first)


_WITHOUT_EFFECTS = (
    "The calibration fits the model without effects: {} of the given parameters is not used, nor kept in a new file."
)


def _by_path(
    prepared: Prepared, segments: list[Segment], nominal: ParameterFile, first: Mapping[str, float] | None
) -> CalibrationResult:
    """Grid search over the three parameters, then refinement: the paper's calibration."""
    unidentified = {}
    names, known = PAPER_PARAMETERS, {"wheel_radius": nominal.value("wheel_radius")}
    if heading_range(segments) < SMALLEST_TURN:
        unidentified["base_width"] = "the robot never turned"
        names = ("k2_over_k3", "k1")
        known["base_width"] = nominal.value("base_width") if nominal.has("base_width") else 1.0
    fit = fit_by_path(prepared, segments, names, known, first)
    factor = fit.refined.nuisance.get(WHEEL_FACTOR)
    if factor is not None and not 1.0 / WORST_FACTOR < factor.value < WORST_FACTOR:
        raise EstimationError(NOT_EXPLAINED.format(factor=factor.value, radius=known["wheel_radius"]))
    note = _radius_note(known["wheel_radius"], factor)
    reason = "the speed hardly changed while the path was recorded"
    result = _result(prepared, fit, nominal, known, unidentified, reason, note)
    return replace(result, notes=(*result.notes, _trust(prepared, names, known, fit, result)))


def _trust(
    prepared: Prepared, names: tuple[str, ...], known: Mapping[str, float], fit: Fit, result: CalibrationResult
) -> str:
    """Say how far the result can be trusted: how far the path strays, and how much both halves of the drive differ."""
    way = sum(travelled(segment.x, segment.y) for segment in fit.segments)
    strays = f"the simulated path strays {result.path_rmse_after:.2g} m on a way of {way:.3g} m"
    first = {name: one.value for name, one in fit.refined.estimates.items()}
    halves = []
    for part in (0, 1):
        half = replace(prepared, recordings=[_half(recording, part) for recording in prepared.recordings])
        segments = half.segments()
        if not segments:
            return TRUST.format(strays)
        halves.append(fit_by_path(half, segments, names, known, first).refined.estimates)
    apart = [f"{name} {halves[0][name].value:.4g} and {halves[1][name].value:.4g}" for name in result.estimates]
    return TRUST.format(f"{strays}, and its halves by themselves give {', '.join(apart)}")


def _half(recording: Recording, part: int) -> Recording:
    """Return the first or second half of a recording."""
    signal = recording.poses
    begin, end = int(signal.utime[0]), int(signal.utime[-1]) + 1
    middle = (begin + end) // 2
    return recording.between(*((begin, middle) if part == 0 else (middle, end)))


TRUST = (
    "How far to trust these numbers: {}. Where that is much, the robot is not quite as the paper's model has it; leave "
    "out --method paper to find out how."
)
NOT_EXPLAINED = (
    "The model does not explain the path of this drive as a whole: its wheels would turn {factor:.3g} times as far. "
    "Unequal motors or wheels do that, and so do a wrong wheel_radius ({radius:g} m), ticks per turn or poses (m, rad, "
    "y to the left). Leave out --method paper to find out which."
)
_UNEXPLAINED = (
    "The model does not explain this drive: its path is {:.3g} m off, on a way of {:.3g} m. Do not use these numbers "
    "before you know why: motors, encoders or axes of the poses swapped or mirrored, or a robot that slips."
)


def _result(
    prepared: Prepared,
    fit: Fit,
    nominal: ParameterFile,
    known: Mapping[str, float],
    unidentified: dict[str, str],
    reason: str,
    notes: tuple[str, ...],
) -> CalibrationResult:
    """Return the result of a fit to the path; `known` are values that the path is simulated with besides."""
    found = fit.refined.estimates
    estimates = _trusted(found, fit.correlation, unidentified, reason)
    _require(estimates, unidentified)
    given = dict(known) | _values(nominal)
    kept = [list(found).index(name) for name in estimates]
    after = _error(fit, given | {name: e.value for name, e in estimates.items()})
    way = sum(travelled(segment.x, segment.y) for segment in fit.segments)
    if after > WORST_PATH_ERROR * way:
        notes = (*notes, _UNEXPLAINED.format(after, way))
    return CalibrationResult(
        robot_id=prepared.recordings[0].robot_id,
        estimates=estimates,
        unidentified=unidentified,
        nominal=nominal,
        method=fit.method,
        samples=sum(len(segment.x) for segment in fit.segments),
        covariance=fit.refined.covariance[np.ix_(kept, kept)],
        path_rmse_before=_error(fit, given),
        path_rmse_after=after,
        notes=(*prepared.notes, *fit.notes, *notes),
        segments=fit.segments,
        grid=fit.grid,
    )


def _trusted(
    found: Mapping[str, Estimate],
    correlation: Floats | None,
    unidentified: dict[str, str],
    reason: str,
) -> dict[str, Estimate]:
    """Return the estimates that the information in the data determines; add the others to `unidentified`."""
    trusted = {}
    for row, (name, estimate) in enumerate(found.items()):
        if 0.0 < estimate.value < math.inf and estimate.std <= LARGEST_RELATIVE_STD * estimate.value:
            trusted[name] = estimate
            continue
        with_others = np.zeros(len(found)) if correlation is None else np.abs(correlation[row])
        confused = [other for other, r in zip(found, with_others, strict=True) if r > CONFUSED and other != name]
        told = f", and it cannot be told from {' and '.join(confused)}" if confused else ""
        unidentified[name] = f"{reason}{told} (standard deviation {estimate.std:.2g} of {estimate.value:.3g})"
    return trusted


def _radius_note(radius: float, factor: Estimate | None) -> tuple[str, ...]:
    """Tell when wheel speeds and path contradict each other: the given wheel radius is wrong, or the encoder scale."""
    if factor is None or abs(factor.value - 1.0) < max(SMALLEST_RADIUS_ERROR, 3.0 * factor.std):
        return ()
    return (
        f"The wheels turn {factor.value:.3f} times as far as the path says. Check wheel_radius "
        f"({radius / factor.value:.4g} m would fit instead of {radius:g} m) and the encoder's ticks per turn.",
    )


def _require(estimates: dict[str, Estimate], unidentified: dict[str, str]) -> None:
    """Raise EstimationError when nothing at all was found."""
    if not estimates:
        raise EstimationError(
            "The paper's method identifies nothing: the robot is not quite as its model has it, or the drive tells too "
            f"little ({'; '.join(f'{name}: {reason}' for name, reason in unidentified.items())}). Leave out --method "
            "paper to find out which."
        )


def _values(parameters: ParameterFile) -> dict[str, float]:
    return {name: value.value for name, value in parameters.values.items()}


def _error(fit: Fit, values: Mapping[str, float]) -> float:
    """Return the path error [m]; NaN where a parameter is not known."""
    if not set(RobotParameters._fields) <= set(values):
        return math.nan
    parameters = RobotParameters.of(values)
    return path_error(fit.segments, [segment.simulate(parameters) for segment in fit.segments])


def _commanded(recording: Recording) -> bool:
    duty = recording.duty
    return len(duty) > 0 and bool(np.any(np.abs(duty["left"]) + np.abs(duty["right"]) > MOVING_DUTY))


def _contents(recordings: Sequence[Recording]) -> str:
    counts = {name: sum(len(getattr(r, name)) for r in recordings) for name in ("commands", "wheels", "gyro", "poses")}
    return ", ".join(f"{count} {name}" for name, count in counts.items())
