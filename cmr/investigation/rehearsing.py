"""Decide once on synthetic data before a robot drives, so that code is loaded then and not during the drive."""

import math

import numpy as np

from cmr.geometry.obstacles import Geofence
from cmr.investigation.engine import Investigation, Planned
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, opening, waiting
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}  # any would do
SMALLEST = 1e-3  # rad, rad/s and m, of the noise


def rehearse() -> None:
    """Let a separate investigation decide, on a floor of 2 m x 2 m, after an opening that was never driven."""
    floor = Floor(Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
    investigation = Investigation(ParameterFile(0, {name: Value(value) for name, value in ROBOT.items()}), floor)
    investigation.opening(0.0, 0.0, 0.0)
    recording = _recording()
    investigation.decide(recording, Planned.of(waiting(), int(recording.wheels.utime[-1])))


def _recording() -> Recording:
    """Return the recording of an opening from (0, 0) by a robot that follows the paper's model."""
    duty = np.concatenate([one.duty for one in opening()])
    random = np.random.default_rng(0)
    utime = np.rint(1e6 * PERIOD * np.arange(1, len(duty) + 1)).astype(np.int64)
    psi = _wheel_speeds(duty) + SMALLEST * random.standard_normal(duty.shape)
    forward = ROBOT["wheel_radius"] * psi.mean(axis=1)
    turning = ROBOT["wheel_radius"] * (psi[:, 1] - psi[:, 0]) / ROBOT["base_width"]
    theta = PERIOD * np.cumsum(turning)
    places = PERIOD * np.cumsum([forward * np.cos(theta), forward * np.sin(theta)], axis=1)
    x, y, heading = np.stack([*places, theta]) + SMALLEST * random.standard_normal((3, len(duty)))
    turned = np.rint(PERIOD * np.cumsum(psi, axis=0) / SMALLEST)
    sides = {
        f"{name}_{side}": values[:, column]
        for name, values in (("ticks", turned), ("psi", psi), ("applied", np.full(duty.shape, math.nan)))
        for column, side in enumerate(("left", "right"))
    }
    return Recording(
        0,
        commands=Signal(utime - round(1e6 * PERIOD), {"left": duty[:, 0], "right": duty[:, 1]}),
        wheels=Signal(utime, sides),
        gyro=Signal(utime, {"yaw_rate": turning}),
        poses=Signal(utime, {"x": x, "y": y, "theta": heading}),
        parameters=ParameterFile(0, {"wheel_radius": Value(ROBOT["wheel_radius"])}),
    )


def _wheel_speeds(duty: Floats) -> Floats:
    """Return the speeds [rad/s] of wheels that begin at rest, by the paper's model, at the end of each period."""
    kept = math.exp(-PERIOD * ROBOT["k1"] * ROBOT["k2_over_k3"])
    psi, result = np.zeros(2), []
    for sides in duty:
        psi = kept * psi + (1.0 - kept) * sides / ROBOT["k1"]
        result.append(psi)
    return np.array(result)
