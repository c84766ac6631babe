"""A short synthetic drive: fitting it loads the estimator, and compiles it at the first use on a computer."""

import numpy as np

from cmr.geometry.manoeuvres import TYPICAL
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import DEFINITIONS
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Signal

LENGTH, PERIOD = 12.0, 0.02  # s; the length is that of a drive that tells something, the period that of all sensors
DUTY, TURNING, CYCLES = 0.3, 0.1, 2.0  # duties of both wheels and of their difference, and how often that comes round
NOISE = 1e-3  # m, rad, rad/s; of poses and gyro
TICKS = 2048.0 / (2.0 * np.pi)  # per rad of a wheel
NOMINAL = ParameterFile(0, {name: Value(getattr(TYPICAL, name)) for name in DEFINITIONS})


def made_up_recording() -> Recording:
    """Return the recording of a typical robot that drives curves to the left and to the right; always the same."""
    times = np.arange(round(LENGTH / PERIOD)) * PERIOD
    utime = np.round(times / SECONDS).astype(np.int64)
    turning = TURNING * np.sin(2.0 * np.pi * CYCLES * times / LENGTH)
    moves = times > 1.0
    left, right = moves * (DUTY - turning), moves * (DUTY + turning)
    path = drive(left[:-1], right[:-1], np.diff(times), TYPICAL, RobotState.at_rest())
    noise = np.random.default_rng(0)

    def measured(values: Floats) -> Floats:
        return np.asarray(values, np.float64) + NOISE * noise.standard_normal(len(values))

    rate = TYPICAL.wheel_radius / TYPICAL.base_width * (path.psi_right - path.psi_left)
    unknown = np.full(len(times), np.nan)
    wheels = {"ticks_left": np.floor(TICKS * path.angle_left), "ticks_right": np.floor(TICKS * path.angle_right)}
    wheels |= {
        "psi_left": path.psi_left,
        "psi_right": path.psi_right,
        "applied_left": unknown,
        "applied_right": unknown,
    }
    return Recording(
        0,
        commands=Signal(utime, {"left": left, "right": right}),
        wheels=Signal(utime, wheels),
        gyro=Signal(utime, {"yaw_rate": measured(rate)}),
        poses=Signal(utime, {"x": measured(path.x), "y": measured(path.y), "theta": measured(path.theta)}),
        parameters=NOMINAL,
    )
