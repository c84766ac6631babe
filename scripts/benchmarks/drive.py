"""A figure-eight drive for measurements: its exact path, a recording of it with noise, and a log.

The path is computed by separate equations and quadrature, not by the step that is measured.
"""

import math
from pathlib import Path

import lcm
import numpy as np

from cmr.bus.messages import make
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE
from cmr.model.parameters import RobotParameters
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t, pose_xyt_t
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Floats, Recording
from cmr.recordings.signal import Signal

STEP = 10_000  # us
TRUTH = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.16)
NOMINAL = ParameterFile(
    0, {"wheel_radius": Value(0.04), "k2_over_k3": Value(80.0), "k1": Value(0.065), "base_width": Value(0.2)}
)
EPOCH = 1_700_000_000_000_000  # us
REST = 1.5  # s at both ends
LAP = 29.25  # s; four of them and two rests are 120 s
CRUISING = 0.42  # duty
QUADRATURE = 12  # Gauss-Legendre points in each step: exact to rounding
TICKS_PER_TURN = 480
POSITION_NOISE, HEADING_NOISE, GYRO_NOISE = 0.005, math.radians(0.3), 0.005  # m, rad, rad/s


def duties(seconds: float, cruising: float = CRUISING) -> tuple[Floats, Floats]:
    """Return the duties of both sides in steps of 10 ms: figure-eights between two rests."""
    time = np.arange(round(seconds * 1e6 / STEP)) * STEP * 1e-6
    turning = 0.2 * cruising * np.sin(2.0 * np.pi * (time - REST) / LAP)
    driving = (time >= REST) & (time < seconds - REST)
    return np.where(driving, cruising - turning, 0.0), np.where(driving, cruising + turning, 0.0)


def exact_path(left: Floats, right: Floats, parameters: RobotParameters) -> Floats:
    """Return x, y, theta, psi_left and psi_right at the boundaries of all steps, shape (5, steps + 1), from rest.

    Speeds and headings are closed forms of the linear motor; positions are integrated by quadrature of high order.
    """
    h, rate = STEP * 1e-6, parameters.k1 * parameters.k2_over_k3
    final = np.stack([left, right]) / parameters.k1
    off = np.zeros(
        (2, len(left) + 1)
    )  # difference of the wheel speeds from their final values, at the start of each step
    psi = np.zeros((2, len(left) + 1))
    for k in range(len(left)):
        off[:, k] = psi[:, k] - final[:, k]
        psi[:, k + 1] = final[:, k] + off[:, k] * math.exp(-rate * h)
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE)
    time, weights = (nodes + 1.0) * h / 2.0, weights * h / 2.0

    def turned(after: Floats) -> Floats:
        angles = final[:, :, np.newaxis] * after - off[:, :-1, np.newaxis] * np.expm1(-rate * after) / rate
        return np.asarray((angles[1] - angles[0]) * parameters.wheel_radius / parameters.base_width)

    theta = np.concatenate([[0.0], np.cumsum(turned(np.array([h]))[:, 0])])
    heading = theta[:-1, np.newaxis] + turned(time)
    speeds = final[:, :, np.newaxis] + off[:, :-1, np.newaxis] * np.exp(-rate * time)
    speed = parameters.wheel_radius * speeds.mean(axis=0)
    x, y = (np.concatenate([[0.0], np.cumsum((speed * part(heading)) @ weights)]) for part in (np.cos, np.sin))
    return np.stack([x, y, theta, *psi])


def recording(seconds: float, seed: int = 0) -> Recording:
    """Return the recording of a drive, all four signals at 100 Hz, with noise and coarse encoders."""
    noise = np.random.default_rng(seed)
    left, right = duties(seconds)
    path = exact_path(left, right, TRUTH)
    x, y, theta = path[:3, :-1]
    samples, h = len(left), STEP * 1e-6
    utime = EPOCH + np.arange(samples) * STEP
    radians_per_tick = 2.0 * math.pi / TICKS_PER_TURN
    turned = np.cumsum((path[3:, :-1] + path[3:, 1:]) * h / 2.0, axis=1)
    angles = np.column_stack([np.zeros(2), turned[:, :-1]])  # at the beginning of each step, like all other signals
    ticks = np.floor(angles / radians_per_tick)
    psi = np.diff(ticks, prepend=0.0) * radians_per_tick / h
    yaw_rate = np.gradient(theta, h)
    wheels = {"ticks_left": ticks[0], "ticks_right": ticks[1], "psi_left": psi[0], "psi_right": psi[1]}
    return Recording(
        0,
        commands=Signal(utime, {"left": left, "right": right}),
        wheels=Signal(utime, wheels | {"applied_left": left, "applied_right": right}),
        gyro=Signal(utime, {"yaw_rate": yaw_rate + noise.normal(0.0, GYRO_NOISE, samples)}),
        poses=Signal(
            utime,
            {
                "x": x + noise.normal(0.0, POSITION_NOISE, samples),
                "y": y + noise.normal(0.0, POSITION_NOISE, samples),
                "theta": theta + noise.normal(0.0, HEADING_NOISE, samples),
            },
        ),
        parameters=NOMINAL,
    )


def write_log(path: Path, drive: Recording, copies: int = 1) -> None:
    """Write the drive as an LCM event log, repeated `copies` times."""
    log = lcm.EventLog(str(path), "w", overwrite=True)
    announcement = NOMINAL.announcement(sequence=EPOCH)
    announcement.utime = EPOCH
    log.write_event(EPOCH, PARAMETERS.channel(0), announcement.encode())
    unknown = dict.fromkeys(("current_left", "current_right", "battery_voltage", "temperature"), math.nan)
    samples = len(drive.commands)
    rows = {name: _rows(signal) for name, signal in drive.signals.items()}
    for k in range(samples * copies):
        utime, i = EPOCH + k * STEP, k % samples
        wheels = rows["wheels"][i]
        ticks = {name: int(wheels[name]) for name in ("ticks_left", "ticks_right")}
        wheels = wheels | unknown | ticks | {"status": 0, "received_utime": utime, "applied_utime": utime}
        for stream, message in (
            (MOTOR_COMMAND, make(motor_command_t, utime=utime, robot_id=0, **rows["commands"][i])),
            (MOTOR_FEEDBACK, make(motor_feedback_t, utime=utime, robot_id=0, **wheels)),
            (GYRO, make(gyro_t, utime=utime, robot_id=0, valid=1, received_utime=utime, **rows["gyro"][i])),
            (POSE, make(pose_xyt_t, utime=utime, robot_id=0, **rows["poses"][i])),
        ):
            log.write_event(utime, stream.channel(0), message.encode())
    log.close()


def _rows(signal: Signal) -> list[dict[str, float]]:
    """Return the samples of a signal, each as a mapping by field."""
    columns = [values.tolist() for values in signal.fields.values()]
    return [dict(zip(signal.fields, values, strict=True)) for values in zip(*columns, strict=True)]
