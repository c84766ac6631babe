"""Estimate the motors from commands and wheel speeds alone, without poses and gyro."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from cmr.calibration.grid import TIME_CONSTANTS
from cmr.calibration.result import CalibrationResult, tells
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.estimation.signs import require_consistent_signs
from cmr.model.motion import wheel_speeds
from cmr.model.motor import wheel_angle_after
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile
from cmr.recordings.faults.checks import check
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal, hold

NOTHING = (
    "Nothing to compare: it takes wheels that move (MOTOR_FEEDBACK_N) with commands (MOTOR_COMMAND_N), or with poses "
    "(POSE_N) or a gyro (GYRO_N)."
)
WITHOUT_TURNS = "Neither poses nor a gyro that moves were recorded."


def calibrate_motors(recordings: Sequence[Recording], nominal: ParameterFile) -> CalibrationResult:
    """Estimate k2_over_k3 and k1 from wheel speeds, equal for both motors; the base width stays unknown.

    Raises EstimationError where nothing moved or nothing was commanded.
    """
    findings = [check(recording) for recording in recordings]
    recordings = [
        found.cleaned(found.stamped(recording)) for found, recording in zip(findings, recordings, strict=True)
    ]
    require_consistent_signs(recordings)
    driven = [r for r in recordings if r.wheels.varies("psi_left", "psi_right") and r.duty.varies("left", "right")]
    if not driven:
        raise EstimationError(NOTHING)
    found = fit_motor(driven)
    estimates = {n: one for n, one in found.items() if tells(one)}
    hardly = {
        n: f"The speed hardly changed (standard deviation {one.std:.2g} of {one.value:.3g})."
        for n, one in found.items()
        if n not in estimates
    }
    if not estimates:
        raise EstimationError(f"Nothing could be identified. {' '.join(hardly.values())}")
    return CalibrationResult(
        robot_id=recordings[0].robot_id,
        estimates=estimates,
        unidentified={**hardly, "base_width": WITHOUT_TURNS},
        nominal=nominal,
        method="wheel speeds",
        samples=sum(len(recording.wheels) for recording in driven),
        covariance=np.diag([estimate.std**2 for estimate in estimates.values()]),
        notes=tuple(dict.fromkeys(one.sentence for f in findings for one in f.all if one.found and one.set_aside)),
    )


def fit_motor(recordings: list[Recording], sides: tuple[str, ...] = ("left", "right")) -> dict[str, Estimate]:
    """Fit k2_over_k3 and k1 to measured wheel speeds of the given sides, driving the recorded commands.

    Several time constants are tried as initial guesses. Plain least squares are used, because a robust loss would bias
    speeds of a coarse encoder to the nearest whole tick. Standard deviations allow for correlated residuals.
    """
    drives = [(r.duty, r.wheels, side) for r in recordings for side in sides]
    commanded = sum(float(np.sum(np.abs(hold(duty, side, w.utime)) * _spans(w))) for duty, w, side in drives)
    turned = sum(float(np.sum(np.abs(w[f"psi_{side}"]) * _spans(w))) for _duty, w, side in drives)
    rough_k1 = commanded / turned

    def residuals(unknowns: Floats) -> Floats:
        parameters = RobotParameters(1.0, np.exp(unknowns[0]), np.exp(unknowns[1]), 1.0)
        return np.concatenate(
            [simulated_speeds(duty, w, side, parameters) - w[f"psi_{side}"][1:] for duty, w, side in drives]
        )

    guesses = [np.log([1.0 / (rough_k1 * tau), rough_k1]) for tau in np.geomspace(*TIME_CONSTANTS, 4)]
    best = min((least_squares(residuals, guess) for guess in guesses), key=lambda fit: float(fit.cost))
    errors = best.fun
    rho = float(np.clip(errors[1:] @ errors[:-1] / max(float(errors @ errors), 1e-300), 0.0, 0.999))
    variance = float(errors @ errors) / max(len(errors) - 2, 1) * (1.0 + rho) / (1.0 - rho)
    spread = np.sqrt(np.diag(variance * np.linalg.pinv(best.jac.T @ best.jac)))
    found = np.exp(best.x)
    return {
        name: Estimate(float(value), float(value * std))
        for name, value, std in zip(("k2_over_k3", "k1"), found, spread, strict=True)
    }


def simulated_speeds(duty: Signal, wheels: Signal, side: str, parameters: RobotParameters) -> Floats:
    """Return the model's wheel speed averaged over the time since the previous message, shape (len(wheels) - 1,).

    The model starts at the first measured speed and then runs freely.
    """
    inside = duty.between(int(wheels.utime[0]), int(wheels.utime[-1]))
    times = np.union1d(inside.utime, wheels.utime)
    dt = np.diff(times) * SECONDS
    held = hold(duty, side, times[:-1])
    speeds = wheel_speeds(held, dt, parameters, wheels[f"psi_{side}"][0])
    angle = np.concatenate([[0.0], np.cumsum(wheel_angle_after(speeds[:-1], held, parameters, dt))])
    at = np.searchsorted(times, wheels.utime)
    return np.asarray(np.diff(angle[at]) / _spans(wheels)[1:])


def _spans(wheels: Signal) -> Floats:
    """Return the time [s] since the previous message, 0 for the first."""
    return np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
