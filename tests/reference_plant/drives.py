"""Drive the plant: commands in, the true motion and the recording of it out."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.parameters.file import ParameterFile, Value
from cmr.plant import sensors
from cmr.plant.beyond_sensors import forward_speed
from cmr.plant.parameters import PlantParameters, as_record, plant_parameters
from cmr.plant.physics import simulate
from cmr.plant.sensors import SILENT, Noise
from cmr.plant.state import COLUMNS, at_rest
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal, Times
from tests.reference_plant.manoeuvres import Manoeuvre

REFERENCE_STEP = 1e-5  # s
STUDY_STEP = 1e-3  # s; for many drives
COMMAND_RATE, WHEEL_RATE, GYRO_RATE, POSE_RATE = 50.0, 100.0, 100.0, 25.0  # Hz
NOMINAL_TICKS = 480.0  # per turn of a wheel; what the driver believes its encoders have
START_UTIME = 1_800_000_000_000_000  # us; when a recording begins
TURNING, SEEN = ("w", "theta", "v"), ("x", "y", "theta", "v", "w")  # what gyro and poses depend on
NANOSECONDS = 1e9  # times are told apart to the nanosecond


Pose = tuple[float, float, float]
ORIGIN: Pose = (0.0, 0.0, 0.0)


class Commands(NamedTuple):
    """Duties of both sides; each is sent at its `time` [s, increasing, from 0] and holds until the next. Shape (n,)."""

    time: Floats
    left: Floats
    right: Floats


class Drive(NamedTuple):
    """One drive: the true motion (fields of state.COLUMNS, at 100 Hz), and what was recorded of it."""

    truth: Signal
    recording: Recording


def packets(manoeuvre: Manoeuvre, seconds: float, rate: float = COMMAND_RATE) -> Commands:
    """Return the packets of a manoeuvre that gives both duties for times [s]."""
    time = np.arange(round(seconds * rate)) / rate
    return Commands(time, *manoeuvre(time))


class Course(NamedTuple):
    """When what happens to the plant: it is simulated from border to border.

    `borders` [s, shape (n + 1,)] are all moments that matter; `packet`, shape (n,), is the number of the packet that
    is in force after each border but the last, -1 before the first has come. `random` draws the noise of the motion.
    """

    borders: Floats
    packet: NDArray[np.int64]
    random: np.random.Generator

    def at(self, times: Floats) -> NDArray[np.int64]:
        """Return the numbers of the borders at these times [s]."""
        return np.searchsorted(_nanoseconds(self.borders), _nanoseconds(times))


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
    """Return the true state (state.COLUMNS, and v by the wheels) at `times` [s, 0 or later], each of their shape."""
    p = plant_parameters(parameters)
    course = course_of(p, commands.time, times, seed)
    left, right = (np.append(duty, 0.0)[course.packet] for duty in commands[1:])
    robot = at_rest(start)
    states, _ = simulate(as_record(p), robot, course.borders, left, right, step, noise.of_motion, course.random)
    found = dict(zip(COLUMNS, states[course.at(times)].T, strict=True))
    return {**found, "v": forward_speed(p, found["psi_left"], found["psi_right"])}


def course_of(p: PlantParameters, sent: Floats, times: Floats, seed: int) -> Course:
    """Return the course of a drive whose packets are sent at `sent` [s], with borders at `times` [s] too."""
    random = np.random.default_rng(seed)
    arrival, number = arrivals(p, sent, random)
    end = float(np.max(times))
    borders = np.concatenate([[0.0, end], times, arrival, [p.surface_change_time, p.payload_change_time]])
    borders = np.unique(_nanoseconds(borders[(borders >= 0.0) & (borders <= end)]))
    # The newest packet that has come by the beginning of each span; nothing drives before the first.
    newest = np.searchsorted(_nanoseconds(arrival), borders[:-1], side="right")
    return Course(borders / NANOSECONDS, np.append(-1, number)[newest], random)


def arrivals(p: PlantParameters, sent: Floats, random: np.random.Generator) -> tuple[Floats, NDArray[np.int64]]:
    """Return when [s, increasing] which of the packets sent at `sent` [s] reach the controller.

    command_delay: u(t - d); command_jitter: a delay uniform in [0, J] per packet, where one that comes after a newer
    one is ignored; command_loss: a packet is lost with probability p, the old command stays.
    """
    delay = p.command_delay + p.command_jitter * random.random(len(sent))
    lost = random.random(len(sent)) < p.command_loss
    arrival = np.where(lost, math.inf, sent + delay)
    first_newer = np.minimum.accumulate(arrival[::-1])[::-1]  # earliest arrival of this packet or a newer one
    kept = np.flatnonzero(np.isfinite(arrival) & (arrival <= first_newer))
    return arrival[kept], kept


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
    motion_seed, random = seeds(seed)
    time, gyro_time, pose_time = (raster(seconds, rate) for rate in (WHEEL_RATE, GYRO_RATE, POSE_RATE))
    asked = moments(p, seconds)
    states = true_motion(commands, parameters, asked, step=step, start=start, noise=noise, seed=motion_seed)
    ends = np.cumsum([len(time), len(gyro_time), len(pose_time)])
    at_wheels, at_gyro, at_poses, at_times = np.split(np.arange(len(asked)), ends)
    turning, seen = ([states[name][at] for name in names] for at, names in ((at_gyro, TURNING), (at_poses, SEEN)))
    rate = sensors.gyro(p, gyro_time, turning, noise, random)
    poses = sensors.pose(p, pose_time, seen, noise, random)
    sent = commands.time <= seconds
    return Drive(
        Signal(utime(time), {name: states[name][at_times] for name in COLUMNS}),
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
    phi_left, phi_right = (sensors.counted(p, phi, time) for phi in (phi_left, phi_right))
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


def seeds(seed: int) -> tuple[int, np.random.Generator]:
    """Return what the noise of the motion is drawn from, and that of the sensors."""
    motion, seeing = np.random.SeedSequence(seed).spawn(2)
    return int(motion.generate_state(1)[0]), np.random.default_rng(seeing)


def moments(p: PlantParameters, seconds: float) -> Floats:
    """Return the moments [s] of which wheels, gyro and poses tell in a drive, and those of its truth, in this order."""
    wheels, gyro, poses = (raster(seconds, rate) for rate in (WHEEL_RATE, GYRO_RATE, POSE_RATE))
    seen = sensors.wheel_time(p, wheels), sensors.gyro_time(p, gyro), sensors.pose_time(p, poses)
    return np.concatenate([*seen, wheels])


def raster(seconds: float, rate: float) -> Floats:
    """Return the times [s] from 0 to `seconds` at this rate [Hz]."""
    return np.arange(math.floor(seconds * rate + 1e-9) + 1) / rate


def _nanoseconds(times: Floats) -> Floats:
    return np.rint(times * NANOSECONDS)
