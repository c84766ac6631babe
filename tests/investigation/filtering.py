"""How clearly sensors' readings differ: a Kalman filter of the typical robot along its own drive, beside the model.

The state's deviations from the drive are linear: pose, wheel angles and speeds, what disturbs torque and grip, and the
slow noise of poses. Readings that deviate, filtered, give white errors of size one, whose squared length is twice the
logarithm of the odds that optimal detection would give (F. C. Schweppe, IEEE Trans. Inf. Theory 11, 1965).
"""

import math
from dataclasses import dataclass

import numpy as np

from cmr.plant.parameters import Floats
from cmr.plant.sensors import REALISTIC, TURN
from tests.hidden_effects.robots import TYPICAL_ROBOT

DT = 0.01  # s between readings of wheels and gyro
EVERY_POSE = 4  # of them is one with a pose
STATE = (
    *("x", "y", "theta", "phi_left", "phi_right", "psi_left", "psi_right"),
    *("torque_left", "torque_right", "slip_left", "slip_right", "noise_x", "noise_y", "noise_theta"),
)
AT = {name: place for place, name in enumerate(STATE)}
UNKNOWN = {"x": 0.1, "y": 0.1, "theta": 0.1, "phi_left": 1.0, "phi_right": 1.0, "psi_left": 1.0, "psi_right": 1.0}
TICK = TURN / REALISTIC.ticks_per_turn
EXACT = 1e-5  # m, rad; noise of poses that is not slow
WANDERING = {  # size and time [s] of what wanders
    **{f"torque_{side}": (REALISTIC.torque, REALISTIC.torque_time) for side in ("left", "right")},
    **{f"slip_{side}": (REALISTIC.slip, REALISTIC.slip_time) for side in ("left", "right")},
    **{f"noise_{name}": (REALISTIC.position, REALISTIC.pose_time) for name in ("x", "y")},
    "noise_theta": (REALISTIC.heading, REALISTIC.pose_time),
}
OF_WHEELS = (TICK**2 / 12.0,) * 2
OF_GYRO = (REALISTIC.gyro**2,)
OF_POSES = (EXACT**2,) * 3


@dataclass(frozen=True)
class Along:
    """The drive along which readings deviate: heading [rad] and wheel speeds [rad/s] at each reading, (n,), (n, 2)."""

    theta: Floats
    psi: Floats


def whitened(along: Along, wheels: Floats, gyro: Floats, poses: Floats) -> Floats:
    """Return the white errors (rows, c) that c deviations of readings make.

    `wheels` (n, 2, c) [rad] and `gyro` (n, c) [rad/s] are read every DT, `poses` (m, 3, c) [m, m, rad] at every
    EVERY_POSE-th of these moments, from the first on. Of the state nothing is known then but what usually disturbs it.
    """
    covariance = np.diag([_first(name) ** 2 for name in STATE])
    mean = np.zeros((len(STATE), gyro.shape[1]))
    rows = []
    for k in range(len(gyro)):
        step, turning = _step(along.theta[k], along.psi[k])
        observed = [np.eye(len(STATE))[[AT["phi_left"], AT["phi_right"]]], turning[None]]
        reading, noise = [wheels[k], gyro[k : k + 1]], [*OF_WHEELS, *OF_GYRO]
        if k % EVERY_POSE == 0:
            observed.append(_of_poses())
            reading.append(poses[k // EVERY_POSE])
            noise += OF_POSES
        matrix = np.concatenate(observed)
        root = np.linalg.cholesky(matrix @ covariance @ matrix.T + np.diag(noise))
        errors = np.linalg.solve(root, np.concatenate(reading) - matrix @ mean)
        spread = np.linalg.solve(root, matrix @ covariance)
        rows.append(errors)
        mean = step @ (mean + spread.T @ errors)
        covariance = step @ (covariance - spread.T @ spread) @ step.T + DRIVEN
    return np.concatenate(rows)


def _first(name: str) -> float:
    return UNKNOWN[name] if name in UNKNOWN else WANDERING[name][0]


def _of_poses() -> Floats:
    matrix = np.zeros((3, len(STATE)))
    for row, name in enumerate(("x", "y", "theta")):
        matrix[row, [AT[name], AT[f"noise_{name}"]]] = 1.0
    return matrix


def _step(theta: float, psi: Floats) -> tuple[Floats, Floats]:
    """Return what a step of DT makes of deviations, (14, 14), and the yaw rate by them, (14,)."""
    radius, width = TYPICAL_ROBOT["wheel_radius"], TYPICAL_ROBOT["base_width"]
    forward, turning = np.zeros(len(STATE)), np.zeros(len(STATE))
    for sign, side, speed in ((-1.0, "left", psi[0]), (1.0, "right", psi[1])):
        forward[[AT[f"psi_{side}"], AT[f"slip_{side}"]]] = 0.5 * radius, -0.5 * radius * speed
        turning[[AT[f"psi_{side}"], AT[f"slip_{side}"]]] = sign * radius / width, -sign * radius / width * speed
    speed = 0.5 * radius * float(np.sum(psi))
    step = np.eye(len(STATE))
    step[AT["x"]] += DT * math.cos(theta) * forward
    step[AT["y"]] += DT * math.sin(theta) * forward
    step[AT["x"], AT["theta"]] -= DT * speed * math.sin(theta)
    step[AT["y"], AT["theta"]] += DT * speed * math.cos(theta)
    step[AT["theta"]] += DT * turning
    kept = math.exp(-DT * TYPICAL_ROBOT["k1"] * TYPICAL_ROBOT["k2_over_k3"])
    for side in ("left", "right"):
        step[AT[f"phi_{side}"], AT[f"psi_{side}"]] = DT
        step[AT[f"psi_{side}"], AT[f"psi_{side}"]] = kept
        step[AT[f"psi_{side}"], AT[f"torque_{side}"]] = DT
    for name, (_, seconds) in WANDERING.items():
        step[AT[name], AT[name]] = math.exp(-DT / seconds)
    return step, turning


def _driven() -> Floats:
    """Return the covariance that a step adds."""
    added = np.zeros(len(STATE))
    for name, (size, seconds) in WANDERING.items():
        added[AT[name]] = size**2 * (1.0 - math.exp(-2.0 * DT / seconds))
    return np.diag(added)


DRIVEN = _driven()
