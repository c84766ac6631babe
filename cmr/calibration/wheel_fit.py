"""What wheels and gyro tell without any pose: the motor from commands and wheel speeds, the base from turns."""

import numpy as np
from scipy.optimize import least_squares

from cmr.calibration.grid import TIME_CONSTANTS
from cmr.estimation.encoders import wheel_angles
from cmr.estimation.estimates import Estimate
from cmr.model.motion import wheel_speeds
from cmr.model.motor import wheel_angle_after
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal, hold

GYRO_WINDOW = 0.5  # s; turns are compared over windows of this length


def fit_motor(recordings: list[Recording], sides: tuple[str, ...] = ("left", "right")) -> dict[str, Estimate]:
    """Fit k2_over_k3 and k1 to measured wheel speeds of the given sides, driving the recorded commands.

    Several time constants are tried as a first guess. Plain least squares: a robust loss would draw the speeds of a
    coarse encoder to the nearest whole tick. Standard deviations allow for correlated residuals.
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


def fit_base_width(recordings: list[Recording], wheel_radius: float) -> Estimate:
    """Fit base_width to the turns that the gyro saw, given the turns of the wheels; a constant gyro bias is allowed.

    Its value and standard deviation are infinite where the gyro saw no turn, or nothing while the wheels were heard.
    """
    wheel_turns, gyro_turns, durations = [], [], []
    for recording in recordings:
        wheels, gyro = recording.wheels, recording.gyro
        left, right = wheel_angles(wheels)
        first, last = max(wheels.utime[0], gyro.utime[0]), min(wheels.utime[-1], gyro.utime[-1])
        times = np.arange(first, last, int(GYRO_WINDOW / SECONDS))
        spans = np.diff(gyro.utime) * SECONDS
        heading = np.concatenate([[0.0], np.cumsum((gyro["yaw_rate"][1:] + gyro["yaw_rate"][:-1]) / 2.0 * spans)])
        wheel_turns.append(np.diff(np.interp(times, wheels.utime, right - left)))
        gyro_turns.append(np.diff(np.interp(times, gyro.utime, heading)))
        durations.append(np.diff(times) * SECONDS)
    design = np.column_stack([wheel_radius * np.concatenate(wheel_turns), np.concatenate(durations)])
    turns = np.concatenate(gyro_turns)
    if not np.any(turns) or not np.any(design[:, 0]):
        return Estimate(np.inf, np.inf)
    solution, *_ = np.linalg.lstsq(design, turns, rcond=None)
    errors = turns - design @ solution
    covariance = errors @ errors / max(len(errors) - 2, 1) * np.linalg.pinv(design.T @ design)
    width = 1.0 / float(solution[0])
    return Estimate(width, abs(float(np.sqrt(covariance[0, 0]))) * width**2)


def _spans(wheels: Signal) -> Floats:
    """Return the time [s] since the previous message, 0 for the first."""
    return np.diff(wheels.utime, prepend=wheels.utime[:1]) * SECONDS
