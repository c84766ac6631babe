"""The paper's method (section 2): a grid search over the whole path, simulated freely, and a refinement.

Its error surface illustrates calibration best. A robot that differs from the paper's model deviates over the whole path
whatever its parameters; use `calibrate` for those.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from cmr.calibration.contradictions import SMALLEST_RADIUS_ERROR, radius_sentence, wheels_against_poses
from cmr.calibration.fitting import PAPER_PARAMETERS, Fit, fit_by_path
from cmr.calibration.grid import Axes, Grid, axes_for, minimum, search, told_by_surface
from cmr.calibration.linear import WHEEL_FACTOR
from cmr.calibration.preparing import Prepared, prepare
from cmr.calibration.result import GRID, CalibrationResult, tells
from cmr.calibration.segments import MOVING_DUTY, Segment, heading_range, path_error, travelled
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.estimation.signs import require_consistent_signs
from cmr.model.parameters import DEFINITIONS, RobotParameters
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats

SMALLEST_TURN = 0.5  # rad; less does not determine the base width
# Ratio of wheel angles to the path; beyond it, or below its inverse, something is wrong rather than inexact.
WORST_FACTOR = 3.0
WORST_PATH_ERROR = 0.1  # of the distance driven; a larger error means that the model does not explain the drive
CONFUSED = 0.95  # correlation above which two parameters cannot be distinguished


def calibrate_by_paper(
    recordings: Sequence[Recording], nominal: ParameterFile, first: Mapping[str, float] | None = None
) -> CalibrationResult:
    """Find the parameters of one robot by the paper's own method, from commands and poses.

    A grid search over the path that is simulated freely over the whole drive, then a refinement from its best point.
    `nominal` gives at least wheel_radius; its effects are ignored, and the result says so. With `first`, a good initial
    guess of the three parameters, the grid search is skipped. Raises EstimationError when nothing can be estimated, or
    when signals contradict each other.
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
    names, known, unidentified = _looked_for(segments, nominal)
    fit = fit_by_path(prepared, segments, names, known, first)
    if not _explains(fit):
        grid = fit.grid or search(segments, known["wheel_radius"], _axes(segments, known))
        return _distrusted(prepared, _of_surface(prepared, segments, nominal, grid), names, known)
    note = _radius_note(segments, known["wheel_radius"], fit.refined.nuisance.get(WHEEL_FACTOR))
    reason = "the speed hardly changed while the path was recorded"
    result = _result(prepared, fit, nominal, known, unidentified, reason, note)
    return replace(result, notes=(*result.notes, _trust(prepared, names, known, fit, result)))


def _explains(fit: Fit) -> bool:
    """Return whether a fit is plausible: the wheels turn about as far as the path requires, and something was found."""
    factor = fit.refined.nuisance.get(WHEEL_FACTOR)
    plausible = factor is None or 1.0 / WORST_FACTOR < factor.value < WORST_FACTOR
    return plausible and any(map(tells, fit.refined.estimates.values()))


def _looked_for(
    segments: list[Segment], nominal: ParameterFile
) -> tuple[tuple[str, ...], dict[str, float], dict[str, str]]:
    """Return the unknowns, the known values, and why other parameters cannot be found."""
    names, known = PAPER_PARAMETERS, {"wheel_radius": nominal.value("wheel_radius")}
    if heading_range(segments) >= SMALLEST_TURN:
        return names, known, {}
    known["base_width"] = nominal.value("base_width") if nominal.has("base_width") else 1.0
    return names[:2], known, {"base_width": "the robot never turned"}


def _distrusted(
    prepared: Prepared, result: CalibrationResult, names: tuple[str, ...], known: Mapping[str, float]
) -> CalibrationResult:
    """Return the minimum of a grid with the reasons why it cannot be trusted."""
    segments, radius = result.segments, known["wheel_radius"]
    minima = []
    for half in (_halved(prepared, part).segments() for part in (0, 1)):
        with suppress(EstimationError):  # the robot may have stood still in one of them
            minima += [minimum(half, radius, _axes(half, known))]
    apart = ""
    if len(minima) == 2:
        pairs = [f"{name} {minima[0][name]:.4g} and {minima[1][name]:.4g}" for name in names]
        apart = f" Its halves by themselves give {', '.join(pairs)}."
    way = sum(travelled(segment.x, segment.y) for segment in segments)
    notes = [NOT_EXPLAINED.format(after=result.path_rmse_after, way=way, apart=apart)]
    factor = wheels_against_poses(segments, radius)
    if abs(factor - 1.0) > SMALLEST_RADIUS_ERROR:
        notes.append(radius_sentence(factor, radius))
    return replace(result, notes=(*result.notes, *notes))


def minimum_so_far(recording: Recording, nominal: ParameterFile) -> CalibrationResult:
    """Return the minimum of the grid for an ongoing drive.

    Raises EstimationError when there is nothing to compare yet.
    """
    prepared = prepare([recording])
    segments = prepared.segments()
    if not segments:
        raise EstimationError("No path was recorded, yet.")
    _names, known, _unidentified = _looked_for(segments, nominal)
    return _of_surface(prepared, segments, nominal, search(segments, known["wheel_radius"], _axes(segments, known)))


def _axes(segments: list[Segment], known: Mapping[str, float]) -> Axes:
    return axes_for(segments, known["wheel_radius"], known.get("base_width"))


def _of_surface(prepared: Prepared, segments: list[Segment], nominal: ParameterFile, grid: Grid) -> CalibrationResult:
    """Return the result of the grid search alone: its minimum, and what the surface says on each parameter."""
    names, known, unidentified = _looked_for(segments, nominal)
    estimates, untold = told_by_surface(grid, names)
    values = {**known, **grid.best}
    return CalibrationResult(
        robot_id=prepared.recordings[0].robot_id,
        estimates=estimates,
        unidentified={**unidentified, **untold},
        nominal=nominal,
        method=GRID,
        samples=sum(len(segment.x) for segment in segments),
        covariance=np.diag([one.std**2 for one in estimates.values()]),
        path_rmse_before=_error(segments, dict(known) | _values(nominal)),
        path_rmse_after=_error(segments, values),
        notes=prepared.notes,
        segments=segments,
        grid=grid,
        parameters={name: value for name, value in values.items() if name in names or nominal.has(name)},
    )


def _trust(
    prepared: Prepared, names: tuple[str, ...], known: Mapping[str, float], fit: Fit, result: CalibrationResult
) -> str:
    """Return a sentence on how far to trust the result: the path error, and the difference between halves of the
    drive.
    """
    way = sum(travelled(segment.x, segment.y) for segment in fit.segments)
    strays = f"the simulated path strays {result.path_rmse_after:.2g} m on a way of {way:.3g} m"
    first = {name: one.value for name, one in fit.refined.estimates.items()}
    halves = []
    for part in (0, 1):
        half = _halved(prepared, part)
        segments = half.segments()
        if not segments:
            return TRUST.format(strays)
        halves.append(fit_by_path(half, segments, names, known, first).refined.estimates)
    apart = [f"{name} {halves[0][name].value:.4g} and {halves[1][name].value:.4g}" for name in result.estimates]
    return TRUST.format(f"{strays}, and its halves by themselves give {', '.join(apart)}")


def _halved(prepared: Prepared, part: int) -> Prepared:
    return replace(prepared, recordings=[_half(recording, part) for recording in prepared.recordings])


def _half(recording: Recording, part: int) -> Recording:
    """Return the first or second half of a recording."""
    signal = recording.poses
    begin, end = int(signal.utime[0]), int(signal.utime[-1]) + 1
    middle = (begin + end) // 2
    return recording.between(*((begin, middle) if part == 0 else (middle, end)))


TRUST = (
    "How far to trust these numbers: {}. If that is a lot, the robot differs from the paper's model; leave out "
    "--method paper to find out how."
)
NOT_EXPLAINED = (
    "Do not trust these numbers: the model does not explain the path of this drive as a whole. At best it is off by "
    "{after:.2g} m (root mean square) on a way of {way:.3g} m.{apart} This method simulates the whole drive freely, "
    "so heading drift bends the rest of the path. Unequal motors or wheels make it drift, and so do a wrong "
    "wheel_radius, ticks per turn or poses (m, rad, y to the left). Leave out --method paper to find out which."
)
BENT = (
    "The wheels would turn {factor:.3f} times as far as the fitted path says, but in each half second they go as far "
    "as the poses: something bends the path, such as unequal motors or wheels, or slip. Leave out --method paper to "
    "find out what."
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
    """Return the result of a fit to the path; `known` are the other values of the simulation."""
    found = fit.refined.estimates
    estimates = _trusted(found, fit.correlation, unidentified, reason)
    given = dict(known) | _values(nominal)
    kept = [list(found).index(name) for name in estimates]
    after = _error(fit.segments, given | {name: e.value for name, e in estimates.items()})
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
        path_rmse_before=_error(fit.segments, given),
        path_rmse_after=after,
        notes=(*prepared.notes, *fit.notes, *notes),
        segments=fit.segments,
        grid=fit.grid,
    )


def _trusted(
    found: Mapping[str, Estimate],
    correlation: Floats,
    unidentified: dict[str, str],
    reason: str,
) -> dict[str, Estimate]:
    """Return the estimates that the data determine; add the others to `unidentified`."""
    trusted = {}
    for row, (name, estimate) in enumerate(found.items()):
        if tells(estimate):
            trusted[name] = estimate
            continue
        pairs = zip(found, np.abs(correlation[row]), strict=True)
        confused = [other for other, r in pairs if r > CONFUSED and other != name]
        beside = f", and it cannot be distinguished from {' and '.join(confused)}" if confused else ""
        unidentified[name] = f"{reason}{beside} (standard deviation {estimate.std:.2g} of {estimate.value:.3g})"
    return trusted


def _radius_note(segments: list[Segment], radius: float, factor: Estimate | None) -> tuple[str, ...]:
    """Report the contradiction if the wheels turn less or more than the fitted path requires, by `factor`."""
    if factor is None or abs(factor.value - 1.0) < max(SMALLEST_RADIUS_ERROR, 3.0 * factor.std):
        return ()
    by_seconds = wheels_against_poses(segments, radius)
    if abs(by_seconds - 1.0) > SMALLEST_RADIUS_ERROR:
        return (radius_sentence(by_seconds, radius),)
    return (BENT.format(factor=factor.value),)


def _values(parameters: ParameterFile) -> dict[str, float]:
    return {name: value.value for name, value in parameters.values.items()}


def _error(segments: list[Segment], values: Mapping[str, float]) -> float:
    """Return the path error [m]; NaN if a parameter is unknown."""
    if not set(RobotParameters._fields) <= set(values):
        return math.nan
    parameters = RobotParameters.of(values)
    return path_error(segments, [segment.simulate(parameters) for segment in segments])


def _commanded(recording: Recording) -> bool:
    duty = recording.duty
    return len(duty) > 0 and bool(np.any(np.abs(duty["left"]) + np.abs(duty["right"]) > MOVING_DUTY))


def _contents(recordings: Sequence[Recording]) -> str:
    counts = {name: sum(len(getattr(r, name)) for r in recordings) for name in ("commands", "wheels", "gyro", "poses")}
    return ", ".join(f"{count} {name}" for name, count in counts.items())
