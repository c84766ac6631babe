"""Drive the plant: commands in, the true motion and the recording of it out."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal, Times
from tests.reference_plant import sensors
from tests.reference_plant.manoeuvres import Manoeuvre
from tests.reference_plant.parameters import PlantParameters, as_record, plant_parameters
from tests.reference_plant.physics import COLUMNS, simulate
from tests.reference_plant.sensors import SILENT, Noise

REFERENCE_STEP = 1e-5  # s
STUDY_STEP = 1e-3  # s; for many drives
COMMAND_RATE, WHEEL_RATE, GYRO_RATE, POSE_RATE = 50.0, 100.0, 100.0, 25.0  # Hz
NOMINAL_TICKS = 480.0  # per turn of a wheel; what the driver believes its encoders have
START_UTIME = 1_800_000_000_000_000  # us; when a recording begins
NANOSECONDS = 1e9  # times are told apart to the nanosecond


Pose = tuple[float, float, float]
ORIGIN: Pose = (0.0, 0.0, 0.0)


class Commands(NamedTuple):
    """Duties of both sides; each is sent at its `time` [s, increasing, from 0] and holds until the next. Shape (n,)."""

    time: Floats
    left: Floats
    right: Floats


class Drive(NamedTuple):
    """One drive: the true motion (fields of physics.COLUMNS, at 100 Hz), and what was recorded of it."""

    truth: Signal
    recording: Recording


def packets(manoeuvre: Manoeuvre, seconds: float, rate: float = COMMAND_RATE) -> Commands:
    """Return the packets of a manoeuvre that gives both duties for times [s]."""
    time = np.arange(round(seconds * rate)) / rate
    return Commands(time, *manoeuvre(time))


def true_motion(
    commands: Commands,
    parameters: Mapping[str, float],
    times: Floats,
    *,
    step: float = REFERENCE_STEP,
    start: Pose = ORIGIN,
    noise: Noise = SILENT,
    seed: int = 0,
) -> dict[str, Floats]:
    """Return the true state (physics.COLUMNS) at `times` [s, 0 or later], each of their shape."""
    p, random = plant_parameters(parameters), np.random.default_rng(seed)
    arrived = arrivals(p, commands, random)
    events = [p.surface_change_time, p.payload_change_time]
    end = float(np.max(times))
    borders = np.concatenate([[0.0, end], times, arrived.time, events])
    borders = np.unique(_nanoseconds(borders[(borders >= 0.0) & (borders <= end)]))
    # The newest packet that has come by the beginning of each span; nothing drives before the first.
    newest = np.searchsorted(_nanoseconds(arrived.time), borders[:-1], side="right")
    left, right = (np.concatenate([[0.0], duty])[newest] for duty in arrived[1:])
    states = simulate(as_record(p), start, borders / NANOSECONDS, left, right, step, noise.of_motion, random)
    asked = states[np.searchsorted(borders, _nanoseconds(times))]
    return dict(zip(COLUMNS, asked.T, strict=True))


def arrivals(p: PlantParameters, commands: Commands, random: np.random.Generator) -> Commands:
    """Return when which packet reaches the controller.

    command_delay: u(t - d); command_jitter: a delay uniform in [0, J] per packet, where one that comes after a newer
    one is ignored; command_loss: a packet is lost with probability p, the old command stays.
    """
    count = len(commands.time)
    delay = p.command_delay + p.command_jitter * random.random(count)
    lost = random.random(count) < p.command_loss
    arrival = np.where(lost, math.inf, commands.time + delay)
    first_newer = np.minimum.accumulate(arrival[::-1])[::-1]  # earliest arrival of this packet or a newer one
    kept = np.isfinite(arrival) & (arrival <= first_newer)
    return Commands(arrival[kept], commands.left[kept], commands.right[kept])


def drive(
    commands: Commands,
    parameters: Mapping[str, float],
    seconds: float,
    noise: Noise = SILENT,
    seed: int = 0,
    *,
    step: float = STUDY_STEP,
    start: Pose = ORIGIN,
    nominal: ParameterFile | None = None,
) -> Drive:
    """Drive the plant and record it; the same seed gives the same drive.

    `nominal` is what the recording announces, by default the true wheel radius alone.
    """
    p = plant_parameters(parameters)
    motion, seeing = np.random.SeedSequence(seed).spawn(2)
    random = np.random.default_rng(seeing)
    time, pose_time = _raster(seconds, WHEEL_RATE), _raster(seconds, POSE_RATE)
    gyro_time = _raster(seconds, GYRO_RATE)
    asked = np.concatenate([time, sensors.gyro_time(p, gyro_time), sensors.pose_time(p, pose_time)])
    motion_seed = int(motion.generate_state(1)[0])
    states = true_motion(commands, parameters, asked, step=step, start=start, noise=noise, seed=motion_seed)
    at_wheels, at_gyro, at_poses = np.split(np.arange(len(asked)), [len(time), len(time) + len(gyro_time)])
    rate = sensors.gyro(p, gyro_time, states["w"][at_gyro], noise, random)
    true_pose = states["x"][at_poses], states["y"][at_poses], states["theta"][at_poses]
    poses = sensors.pose(p, pose_time, true_pose, noise, random)
    sent = commands.time <= seconds
    return Drive(
        Signal(utime(time), {name: values[at_wheels] for name, values in states.items()}),
        Recording(
            0,
            commands=Signal(utime(commands.time[sent]), {"left": commands.left[sent], "right": commands.right[sent]}),
            wheels=_wheels(p, time, states["phi_left"][at_wheels], states["phi_right"][at_wheels], noise, random),
            gyro=Signal(utime(gyro_time), {"yaw_rate": rate}),
            poses=Signal(utime(pose_time), dict(zip(("x", "y", "theta"), poses, strict=True))),
            parameters=nominal or ParameterFile(0, {"wheel_radius": Value(p.wheel_radius)}),
        ),
    )


def recording(
    commands: Commands, parameters: Mapping[str, float], seconds: float, noise: Noise = SILENT, seed: int = 0
) -> Recording:
    """Return the recording of a drive, ready to be calibrated or diagnosed."""
    return drive(commands, parameters, seconds, noise, seed).recording


def utime(time: Floats) -> Times:
    """Return the times of a recording [us] for times [s] since its beginning."""
    return START_UTIME + np.rint(time * 1e6).astype(np.int64)


def _wheels(
    p: PlantParameters,
    time: Floats,
    phi_left: Floats,
    phi_right: Floats,
    noise: Noise,
    random: np.random.Generator,
) -> Signal:
    # No wheel begins on an edge of its encoder, nor both at the same distance from one.
    left_phase, right_phase = random.random(2) if math.isfinite(noise.ticks_per_turn) else (0.0, 0.0)
    left = sensors.ticks(p, 1.0, phi_left, noise.ticks_per_turn, NOMINAL_TICKS, left_phase)
    right = sensors.ticks(p, -1.0, phi_right, noise.ticks_per_turn, NOMINAL_TICKS, right_phase)
    unknown = np.full(len(time), math.nan)  # the controller does not tell what it drives
    fields = {
        "ticks_left": left,
        "ticks_right": right,
        "psi_left": sensors.wheel_speed(left, time, NOMINAL_TICKS),
        "psi_right": sensors.wheel_speed(right, time, NOMINAL_TICKS),
        "applied_left": unknown,
        "applied_right": unknown,
    }
    return Signal(utime(time), fields)


def _raster(seconds: float, rate: float) -> Floats:
    return np.arange(math.floor(seconds * rate + 1e-9) + 1) / rate


def _nanoseconds(times: Floats) -> Floats:
    return np.rint(times * NANOSECONDS)
