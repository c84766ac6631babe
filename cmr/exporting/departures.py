"""Diagnose an exported robot as if it were a real one, against the parameter file that it was exported from."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import Against, Diagnosis
from cmr.exporting.proof import STEP, Floats, Proof, duties
from cmr.exporting.robot import ExportedRobot
from cmr.parameters.file import ParameterFile, sha256_of
from cmr.plant import sensors
from cmr.plant.parameters import plant_parameters
from cmr.plant.sensors import REALISTIC, TURN
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Signal

TICKS = 480.0  # per turn of a wheel
POSE_EVERY = 4  # steps: a tracker of 25 Hz
BEGIN = 1_800_000_000_000_000  # us; the start of a recording
SEED = 1


def departures(proof: Proof, robot: ExportedRobot, file: ParameterFile, source: Path) -> Diagnosis:
    """Diagnose the drive of a proof against the parameter `file`, which is in `source`; return the result.

    Raises EstimationError where nothing can be fitted to the drive.
    """
    recording = recording_of(proof.readings, robot, *duties())
    against = Against(source=str(source), sha256=sha256_of(source.read_text(encoding="utf-8")))
    return diagnose(recording, file, against=against)


def recording_of(readings: Floats, robot: ExportedRobot, left: Floats, right: Floats, seed: int = SEED) -> Recording:
    """Return the recording of a drive with the duties `left` and `right` (n,), one for each step, of a robot initially
    at rest.

    `readings` (n, 6) are those of `Driven`. Resolution and noise of the sensors are those of a usual robot
    (cmr.plant.sensors): encoders have TICKS; gyro and tracker are noisy.
    """
    random = np.random.default_rng(seed)
    neutral = plant_parameters({name: robot.value(name) for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")})
    sent = np.arange(len(left)) * np.float64(STEP)
    time = np.asarray(sent + STEP, np.float64)
    ticks = [
        np.floor(angle / TURN * TICKS + phase)  # no wheel begins on an edge of its encoder
        for angle, phase in zip(readings[:, :2].T, random.random(2), strict=True)
    ]
    psi = [sensors.wheel_speed(count, time, TICKS) for count in ticks]
    unknown = np.full(len(time), math.nan)  # the controller does not report what it applies
    # These sensors do not depend on the robot's speed.
    motion = readings[:, 2], readings[:, 5], np.zeros(len(time))
    rate = sensors.gyro(neutral, time, motion, REALISTIC, random)
    seen, (x, y, theta) = time[::POSE_EVERY], readings[::POSE_EVERY, 3:].T
    still = np.zeros(len(seen))
    poses = sensors.pose(neutral, seen, (x, y, theta, still, still), REALISTIC, random)
    wheels = ("ticks_left", "ticks_right", "psi_left", "psi_right", "applied_left", "applied_right")
    nothing = np.empty(0)
    asked = (nothing, nothing) if robot.controller is None else robot.controller.body_velocity(left, right)
    duties_sent = (left, right) if robot.controller is None else (nothing, nothing)
    return Recording(
        robot.robot_id,
        commands=_signal(sent, ("left", "right"), duties_sent),
        wheels=_signal(time, wheels, (*ticks, *psi, unknown, unknown)),
        gyro=_signal(time, ("yaw_rate",), (rate,)),
        poses=_signal(seen, ("x", "y", "theta"), poses),
        velocity_commands=_signal(sent, ("v", "omega"), asked),
    )


def _signal(time: Floats, names: Sequence[str], columns: Sequence[Floats]) -> Signal:
    """Return a signal with the first n of these columns at times [s] (n,)."""
    utime = BEGIN + np.rint(time[: len(columns[0])] * 1e6).astype(np.int64)
    return Signal(utime, dict(zip(names, columns, strict=True)))
