"""Decide what a recording can tell, and find it."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cmr.calibration.grid import axes_for, search
from cmr.calibration.refine import Refinement
from cmr.calibration.result import CalibrationError, CalibrationResult, Estimate
from cmr.calibration.segments import MOVING_DUTY, Segment, heading_range, path_error, segments_of, travelled
from cmr.calibration.wheel_fit import fit_base_width, fit_motor
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording

SHORTEST_TRAVEL = 0.3  # m; less says nothing about speed
SMALLEST_RADIUS_ERROR = 0.02  # relative; a smaller contradiction of wheels and path may be slip
SMALLEST_TURN = 0.5  # rad; less says nothing about the base width
LARGEST_RELATIVE_STD = 0.3  # an estimate with a larger standard deviation is a guess and is not given
PAPER_PARAMETERS: tuple[str, ...] = ("k2_over_k3", "k1", "base_width")


def calibrate(recordings: Recording | Sequence[Recording], nominal: ParameterFile | None = None) -> CalibrationResult:
    """Find the parameters of one robot from one or more of its recordings.

    `nominal` gives at least wheel_radius; by default it is what the recording announces. With commands and poses the
    three parameters of the paper are found from the path, without commands wheel radius and base width from wheels
    and poses, without poses the motor from the wheel speeds and the base width from the gyro.

    Raises CalibrationError when nothing at all can be found.
    """
    recordings = [recordings] if isinstance(recordings, Recording) else list(recordings)
    nominal = nominal or next((r.parameters for r in recordings if r.parameters is not None), None)
    if nominal is None or not nominal.has("wheel_radius"):
        raise CalibrationError(
            "The wheel radius is not known: the log announces no parameters. Give a file with at least wheel_radius "
            "by --parameters."
        )
    segments = [segment for recording in recordings for segment in segments_of(recording)]
    commanded = any(_commanded(recording) for recording in recordings)
    has_wheels = all(len(recording.wheels) > 1 for recording in recordings)
    on_the_spot = segments and _travel(segments) == 0.0 and heading_range(segments) >= SMALLEST_TURN and has_wheels
    if segments and commanded and not on_the_spot:
        return _by_path(recordings, segments, nominal)
    if segments and has_wheels and not on_the_spot:
        return _by_wheels_and_path(recordings, segments, nominal)
    if has_wheels and any(np.any(r.wheels["psi_left"]) or np.any(r.wheels["psi_right"]) for r in recordings):
        return _by_wheels(recordings, nominal, commanded)
    raise CalibrationError(
        "Nothing to compare: it takes poses (POSE_N) or moving wheels (MOTOR_FEEDBACK_N), and the log has "
        f"{_contents(recordings)}."
    )


def _by_path(recordings: list[Recording], segments: list[Segment], nominal: ParameterFile) -> CalibrationResult:
    """Grid search over the three parameters, then refinement: the paper's calibration."""
    radius = nominal.value("wheel_radius")
    unidentified = {}
    fixed_base, names = None, PAPER_PARAMETERS
    if heading_range(segments) < SMALLEST_TURN:
        unidentified["base_width"] = "the robot never turned"
        fixed_base = nominal.value("base_width") if nominal.has("base_width") else 1.0
        names = ("k2_over_k3", "k1")
    grid = search(segments, radius, axes_for(segments, radius, fixed_base))
    first = {"wheel_radius": radius, **grid.best}
    refined = Refinement(segments, names, first).solve()
    found = refined.estimates
    estimates = _trusted(found, unidentified, "the speed hardly changed while the path was recorded")
    _require(estimates, unidentified)
    known = {"base_width": first["base_width"]} if "base_width" not in names else {}
    before = _error(segments, known | _values(nominal))
    after = _error(segments, known | _values(nominal) | {name: e.value for name, e in estimates.items()})
    return CalibrationResult(
        recordings[0].robot_id,
        estimates,
        unidentified,
        nominal,
        "grid+refine",
        _count(segments),
        before,
        after,
        _radius_note(radius, refined.nuisance.get("wheel factor")),
    )


def _by_wheels_and_path(
    recordings: list[Recording], segments: list[Segment], nominal: ParameterFile
) -> CalibrationResult:
    """Wheel radius and base width from wheel angles and poses; the motor stays unknown."""
    unidentified = dict.fromkeys(("k2_over_k3", "k1"), "no motor commands were recorded")
    if _travel(segments) < SHORTEST_TRAVEL:
        raise CalibrationError("The robot did not travel: wheels and poses cannot be compared.")
    first = {name: value.value for name, value in nominal.values.items()} | {"k2_over_k3": 1.0, "k1": 1.0}
    first.setdefault("base_width", 4.0 * first["wheel_radius"])
    before = _error(segments, first, by_wheels=True) if nominal.has("base_width") else math.nan
    names: tuple[str, ...] = ("wheel_radius", "base_width")
    if heading_range(segments) < SMALLEST_TURN:
        unidentified["base_width"] = "the robot never turned"
        names = ("wheel_radius",)
    found = Refinement(segments, names, first, by_wheels=True).solve().estimates
    estimates = _trusted(found, unidentified, "the path hardly depends on it")
    _require(estimates, unidentified)
    after = _error(segments, first | {name: e.value for name, e in estimates.items()}, by_wheels=True)
    return CalibrationResult(
        recordings[0].robot_id, estimates, unidentified, nominal, "wheels+refine", _count(segments), before, after
    )


def _by_wheels(recordings: list[Recording], nominal: ParameterFile, commanded: bool) -> CalibrationResult:
    """The motor from commands and wheel speeds, the base width from wheels and gyro."""
    unidentified: dict[str, str] = {}
    estimates: dict[str, Estimate] = {}
    if commanded:
        estimates |= _trusted(fit_motor(recordings), unidentified, "the speed hardly changed")
    else:
        unidentified |= dict.fromkeys(("k2_over_k3", "k1"), "no motor commands were recorded")
    if not all(len(recording.gyro) > 1 for recording in recordings):
        unidentified["base_width"] = "neither poses nor a gyro were recorded"
    elif sum(float(np.sum(np.abs(np.diff(r.wheels["psi_right"] - r.wheels["psi_left"])))) for r in recordings) == 0.0:
        unidentified["base_width"] = "the robot never turned"
    else:
        width = {"base_width": fit_base_width(recordings, nominal.value("wheel_radius"))}
        estimates |= _trusted(width, unidentified, "the robot hardly turned")
    _require(estimates, unidentified)
    samples = sum(len(recording.wheels) for recording in recordings)
    return CalibrationResult(recordings[0].robot_id, estimates, unidentified, nominal, "wheel speeds", samples)


def _trusted(found: dict[str, Estimate], unidentified: dict[str, str], reason: str) -> dict[str, Estimate]:
    """Return the estimates that the data determine; add the others to `unidentified`."""
    trusted = {}
    for name, estimate in found.items():
        if 0.0 < estimate.value < math.inf and estimate.std <= LARGEST_RELATIVE_STD * estimate.value:
            trusted[name] = estimate
        else:
            unidentified[name] = f"{reason} (standard deviation {estimate.std:.2g} of {estimate.value:.3g})"
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
    """Raise CalibrationError when nothing at all was found."""
    if not estimates:
        raise CalibrationError(
            "Nothing could be identified. " + "; ".join(f"{name}: {reason}" for name, reason in unidentified.items())
        )


def _values(parameters: ParameterFile) -> dict[str, float]:
    return {name: value.value for name, value in parameters.values.items()}


def _travel(segments: list[Segment]) -> float:
    """Return the length of the longest segment's path [m]."""
    return max(travelled(segment.x, segment.y) for segment in segments)


def _error(segments: list[Segment], values: Mapping[str, float], by_wheels: bool = False) -> float:
    """Return the path error [m]; NaN where a parameter is not known."""
    if not set(RobotParameters._fields) <= set(values):
        return math.nan
    parameters = RobotParameters.of(values)
    return path_error(
        segments, [s.follow_wheels(parameters) if by_wheels else s.simulate(parameters) for s in segments]
    )


def _commanded(recording: Recording) -> bool:
    duty = recording.duty
    return len(duty) > 0 and bool(np.any(np.abs(duty["left"]) + np.abs(duty["right"]) > MOVING_DUTY))


def _count(segments: list[Segment]) -> int:
    return sum(len(segment.x) for segment in segments)


def _contents(recordings: list[Recording]) -> str:
    counts = {name: sum(len(getattr(r, name)) for r in recordings) for name in ("commands", "wheels", "gyro", "poses")}
    return ", ".join(f"{count} {name}" for name, count in counts.items())
