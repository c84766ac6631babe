"""Sensor readings of the plant's true motion, with their effects and their noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cmr.plant.beyond_sensors import Number, disturbed_pose, disturbed_rate, lost_counts
from cmr.plant.parameters import Floats, PlantParameters

Pose: TypeAlias = tuple[float, float, float]  # x, y [m], theta [rad]

TURN = 2.0 * math.pi
MISCOUNTING_SPEEDS = (6.0, 12.0)  # rad/s; between them an encoder begins to miss counts
# Indices of the parameters of further errors of gyro and poses.
OF_GYRO = [
    PlantParameters._fields.index(name)
    for name in ("gyro_asymmetry", "gyro_vibration", "gyro_warm_up", "gyro_field", "lidar_imbalance")
]
OF_POSE = [PlantParameters._fields.index(name) for name in ("body_roll", "pixel_aspect", "compass_deviation")]
WARP_LENGTH = 1.5  # m; over which the error of the pose's heading repeats


@dataclass(frozen=True)
class Noise:
    """Process noise of the robot and noise of its sensors; sizes are standard deviations.

    Torque and slip wander as Ornstein-Uhlenbeck processes. `pose_time` 0 makes the noise of the poses white.
    `ticks_per_turn` is infinite for an encoder without steps.
    """

    torque: float = 0.0  # rad/s^2
    torque_time: float = 0.2  # s
    slip: float = 0.0  # 1, of the speed of one side over the ground
    slip_time: float = 0.2  # s
    ticks_per_turn: float = math.inf
    gyro: float = 0.0  # rad/s, white
    gyro_walk: float = 0.0  # rad/s in a square root of a second
    position: float = 0.0  # m
    heading: float = 0.0  # rad
    pose_time: float = 0.0  # s

    @property
    def of_motion(self) -> tuple[float, float, float, float]:
        """Noise of the motion itself."""
        return self.torque, self.torque_time, self.slip, self.slip_time


# s, m/s; correlation time of slip, and speed at which it has the stated effect on the distance
SLIP_TIME, SLIP_SPEED = 0.2, 0.3


def slip_of_way(way: float) -> tuple[float, float]:
    """Return size [1] and time [s] of the slip that causes an error of typically `way` [m] in a side's distance after 1
    m.
    """
    return way / math.sqrt(2.0 * SLIP_TIME * SLIP_SPEED), SLIP_TIME


SILENT = Noise()
REALISTIC = Noise(
    torque=0.3,
    slip=0.003,
    ticks_per_turn=480.0,
    gyro=0.005,
    position=0.005,
    heading=math.radians(0.3),
    pose_time=0.1,
)


def ticks(
    p: PlantParameters, s: float, phi: Number, ticks_per_turn: float, nominal: float, phase: float = 0.0
) -> Number:
    """Return the count of one side's encoder, in ticks of which the driver believes `nominal` make a turn.

    `phase` [ticks of the disc, 0 to 1] is the wheel's initial position between two ticks.

    encoder_scale: ticks (1 + e); encoder_asymmetry: ticks (1 + s e); encoder_quantisation: so few ticks per turn.
    """
    turns = phi / TURN * (1.0 + p.encoder_scale) * (1.0 + s * p.encoder_asymmetry)
    disc = min(ticks_per_turn, p.encoder_quantisation)
    return turns * nominal if math.isinf(disc) else np.floor(turns * disc + phase) * nominal / disc


def missed(p: PlantParameters, speed: Number) -> Number:
    """Return the share of its counts that an encoder misses at this speed [rad/s]. encoder_miscount: m at speed."""
    share: Number = p.encoder_miscount * np.interp(abs(speed), MISCOUNTING_SPEEDS, (0.0, 1.0))
    return share + lost_counts(p, speed) if p.encoder_overspeed else share


def misses(p: PlantParameters) -> bool:
    """Return whether encoders miss counts at some speed."""
    return p.encoder_miscount != 0.0 or p.encoder_overspeed != 0.0


def counted(p: PlantParameters, phi: Floats, time: Floats) -> Floats:
    """Return the angle that the encoder would count without steps."""
    if not misses(p):
        return phi
    turned, duration = np.diff(phi, prepend=0.0), np.diff(time, prepend=-1.0)
    return np.asarray(np.cumsum(turned * (1.0 - missed(p, turned / duration))))


def wheel_speed(count: Floats, time: Floats, nominal: float) -> Floats:
    """Return the wheel speed [rad/s] reported by the driver: the mean over the time since the previous message."""
    return np.concatenate([[0.0], np.diff(count) / np.diff(time)]) * (TURN / nominal)


def wheel_time(p: PlantParameters, time: Floats) -> Floats:
    """Return the time of the wheels' state that is read at `time`. wheel_speed_latency: phi_m(t) = phi(t - d)."""
    return np.maximum(time - p.wheel_speed_latency, 0.0)


def gyro_time(p: PlantParameters, time: Floats) -> Floats:
    """Return the time of the motion that the gyro reads at `time`. gyro_latency: w_m(t) = w(t - d)."""
    return np.maximum(time - p.gyro_latency, 0.0)


def gyro(
    p: PlantParameters, time: Floats, motion: Sequence[Floats], noise: Noise, random: np.random.Generator
) -> Floats:
    """Return the gyro's reading at `time` in a `motion`: w [rad/s], theta [rad], forward speed [m/s]."""
    measured = rate_seen(p, time, *motion)
    steps = np.sqrt(np.diff(time, prepend=0.0)) * random.standard_normal(len(time))
    return measured + noise.gyro_walk * np.cumsum(steps) + noise.gyro * random.standard_normal(len(time))


def rate_seen(p: PlantParameters, time: Number, w: Number, theta: Number, v: Number) -> Number:
    """Return the gyro's reading without noise at forward speed v [m/s].

    gyro_scale: w (1 + e); gyro_bias: + B; gyro_drift: + D t / 100 s; gyro_magnetism: + M sin(2 theta).
    """
    measured = w * (1.0 + p.gyro_scale) + p.gyro_bias + p.gyro_drift * time / 100.0
    if p.gyro_magnetism:
        measured = measured + p.gyro_magnetism * np.sin(2.0 * theta)
    return measured + disturbed_rate(p, time, w, theta, v) if any(p[place] for place in OF_GYRO) else measured


def pose_time(p: PlantParameters, time: Floats) -> Floats:
    """Return the true time of the pose stamped `time`.

    clock_skew: the clock of the pose shows (1 + e) t at time t; pose_latency: a pose is stamped d after its moment.
    """
    return np.maximum(time / (1.0 + p.clock_skew) - p.pose_latency, 0.0)


def pose(
    p: PlantParameters, time: Floats, true: Sequence[Floats], noise: Noise, random: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Return the pose measured by the external localisation for the true x, y, theta, with the robot's v [m/s] and w
    [rad/s].
    """
    x, y, theta = (filtered(time, values, p.pose_smoothing) for values in seen(p, *true))
    x = x + noise.position * correlated(time, noise.pose_time, random)
    y = y + noise.position * correlated(time, noise.pose_time, random)
    theta = theta + noise.heading * correlated(time, noise.pose_time, random)
    return x, y, np.remainder(theta + math.pi, TURN) - math.pi


def seen(
    p: PlantParameters, x: Number, y: Number, theta: Number, v: Number, w: Number
) -> tuple[Number, Number, Number]:
    """Return the pose measured by the external localisation without noise, the heading unwrapped.

    pose_offset: the tracked point sits m ahead of the turning centre, pose_offset_lateral: m to its left;
    pose_distortion: p (1 + k abs(p)^2); pose_heading_warp: theta + A sin(2 pi x / 1.5 m);
    pose_heading_offset: theta + C.
    """
    if p.pose_offset or p.pose_offset_lateral:
        ahead, left, cosine, sine = p.pose_offset, p.pose_offset_lateral, np.cos(theta), np.sin(theta)
        x, y = x + ahead * cosine - left * sine, y + ahead * sine + left * cosine
    if p.pose_heading_warp:
        theta = theta + p.pose_heading_warp * np.sin(TURN * x / WARP_LENGTH)
    theta = theta + p.pose_heading_offset
    if any(p[place] for place in OF_POSE):
        x, y, theta = disturbed_pose(p, x, y, theta, v, w)
    stretch = 1.0 + p.pose_distortion * (x**2 + y**2)
    return x * stretch, y * stretch, theta


def filtered(time: Floats, values: Floats, constant: float) -> Floats:
    """Return the output of a first-order filter for `values`, linear between their times, starting at the first of
    them.

    pose_smoothing: dy/dt = (x - y) / T.
    """
    result = values.copy()
    if constant > 0.0:
        for k, seconds in enumerate(np.diff(time)):
            result[k + 1] = filtered_on(result[k], (values[k], values[k + 1]), seconds, constant)
    return result


def filtered_on(before: float, values: tuple[float, float], seconds: float, constant: float) -> float:
    """Return the output of a filter whose last output was `before`, for an input that moves linearly between
    `values`.
    """
    behind = constant * (values[1] - values[0]) / seconds  # in the end
    return values[1] - behind + (before - values[0] + behind) * math.exp(-seconds / constant)


class PoseFilter:
    """A tracker's filter for poses measured one after the other: `filtered`, over time."""

    def __init__(self) -> None:
        self._last: tuple[float, Pose, Pose] | None = None  # time [s], input, output

    def shown(self, p: PlantParameters, time: float, pose: Pose) -> Pose:
        """Return the filter's output for a pose x, y, theta [m, m, rad] measured at `time` [s]."""
        constant, shown = p.pose_smoothing, pose
        if self._last is not None and constant > 0.0:
            begin, old, before = self._last
            pairs = zip(before, zip(old, pose, strict=True), strict=True)
            x, y, theta = (filtered_on(one, values, time - begin, constant) for one, values in pairs)
            shown = x, y, theta
        self._last = time, pose, shown
        return shown


def correlated(time: Floats, memory: float, random: np.random.Generator) -> Floats:
    """Return noise of standard deviation 1 with the correlation time `memory` [s]; white for 0."""
    fresh = random.standard_normal(len(time))
    if memory == 0.0:
        return fresh
    kept = np.exp(-np.diff(time) / memory)
    for k, share in enumerate(kept):
        fresh[k + 1] = share * fresh[k] + math.sqrt(1.0 - share**2) * fresh[k + 1]
    return fresh
