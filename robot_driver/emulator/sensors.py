"""Measurements of the emulated robot's yaw gyro and of external motion capture, with their errors, before any wire."""

import math
from dataclasses import dataclass
from random import Random

from cmr.plant.sensors import PoseFilter, rate_seen, seen
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Cameras, Settings

Values = tuple[float, float, float]  # x, y (m), theta (rad)


class YawGyro:
    """A rate gyro that integrates between samples, as fibre-optic gyros do; gyro_latency, gyro_scale and the others."""

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self._plant = plant
        self._noise = settings.imperfections.gyro_noise.effective
        self._random = Random(f"{settings.seed} gyro")
        self._last_theta = plant.theta
        self._factor = settings.mounting.gyro_factor

    def rate(self, duration: float) -> float:
        """Return the mean rate of turn (rad/s, counter-clockwise) over the `duration` (s) since the last call."""
        p, plant = self._plant.parameters, self._plant
        time = plant.time
        theta = plant.theta_at(time - p.gyro_latency) if p.gyro_latency else plant.theta
        turned, self._last_theta = theta - self._last_theta, theta
        rate = rate_seen(p, time, turned / duration, theta, plant.v) + self._noise * self._random.gauss(0.0, 1.0)
        return self._factor * rate


@dataclass(frozen=True)
class Pose:
    """A measured pose: `x`, `y` in m, `theta` in rad within [-pi, pi], stamped `time`, ready at `ready` (s)."""

    time: float
    ready: float
    x: float
    y: float
    theta: float


class MotionCapture:
    """Cameras that see the robot `rate` times a second. `wake_time` (s) is the time of the next sample."""

    def __init__(self, settings: Settings, plant: Plant, rate: float) -> None:
        noise = settings.imperfections.pose_noise
        self.wake_time = 0.0
        self._plant = plant
        self._period = 1.0 / rate
        self._position_noise = noise.position if noise.enabled else 0.0
        self._heading_noise = noise.heading if noise.enabled else 0.0
        self._random = Random(f"{settings.seed} pose")
        self._cameras = settings.cameras
        self._start = plant.x, plant.y, plant.theta
        self._filter = PoseFilter()

    def wake(self, time: float) -> Pose:
        """Measure now, at `time`; with a latency, the pose is ready, and stamped, later."""
        self.wake_time += self._period
        p, gauss = self._plant.parameters, self._random.gauss
        plant = self._plant
        robot = self._start if self._cameras.other_body else (plant.x, plant.y, plant.theta)
        x, y, theta = self._filter.shown(p, time, seen(p, *robot, plant.v, plant.w))
        x += self._position_noise * gauss(0.0, 1.0)
        y += self._position_noise * gauss(0.0, 1.0)
        theta += self._heading_noise * gauss(0.0, 1.0)
        ready = time + p.pose_latency
        # clock_skew: the cameras' clock shows (1 + e) t at time t.
        return Pose(ready * (1.0 + p.clock_skew), ready, *_shown(self._cameras, x, y, theta))


def _shown(cameras: Cameras, x: float, y: float, theta: float) -> Values:
    """Return a pose as reported, with the errors of the cameras' set-up."""
    if cameras.mirrored:
        y, theta = -y, -theta
    theta = math.remainder(theta + cameras.heading_offset, 2.0 * math.pi)
    height = 0.1  # m, of the body; arbitrary
    return cameras.metre * x, cameras.metre * (height if cameras.vertical_y else y), cameras.radian * theta
