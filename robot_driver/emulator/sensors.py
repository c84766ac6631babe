"""What the emulated robot's yaw gyro and an external motion capture measure, with their errors, before any wire."""

import math
from collections import deque
from dataclasses import dataclass
from random import Random

from cmr.plant.sensors import rate_seen, seen
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings


class YawGyro:
    """A rate gyro that integrates between samples, as fibre-optic gyros do; gyro_latency, gyro_scale and the others."""

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self._plant = plant
        self._noise = settings.imperfections.gyro_noise.effective
        self._random = Random(f"{settings.seed} gyro")
        self._last_theta = plant.theta

    def rate(self, duration: float) -> float:
        """Return the mean rate of turn (rad/s, counter-clockwise) over the `duration` (s) since the last call."""
        p, plant = self._plant.parameters, self._plant
        time = plant.time
        theta = plant.theta_at(time - p.gyro_latency) if p.gyro_latency else plant.theta
        turned, self._last_theta = theta - self._last_theta, theta
        return rate_seen(p, time, turned / duration, theta) + self._noise * self._random.gauss(0.0, 1.0)


@dataclass(frozen=True)
class Pose:
    """A measured pose: `x`, `y` in m, `theta` in rad within [-pi, pi], stamped `time`, ready at `ready` (s)."""

    time: float
    ready: float
    x: float
    y: float
    theta: float


class MotionCapture:
    """Cameras that see the robot `rate` times a second. `wake_time` (s) is the moment of the next look."""

    def __init__(self, settings: Settings, plant: Plant, rate: float) -> None:
        noise = settings.imperfections.pose_noise
        self.wake_time = 0.0
        self._plant = plant
        self._period = 1.0 / rate
        self._position_noise = noise.position if noise.enabled else 0.0
        self._heading_noise = noise.heading if noise.enabled else 0.0
        self._random = Random(f"{settings.seed} pose")
        self._seen: deque[tuple[float, float, float, float]] = deque()  # time, x, y, theta: over which poses are means

    def wake(self, time: float) -> Pose:
        """Measure now, at `time`; with a latency the pose is ready, and stamped, later than that."""
        self.wake_time += self._period
        p, gauss = self._plant.parameters, self._random.gauss
        self._seen.append((time, *seen(p, self._plant.x, self._plant.y, self._plant.theta)))
        while self._seen[0][0] < time - 2.0 * math.sqrt(3.0) * p.pose_smoothing:
            self._seen.popleft()
        # pose_smoothing: the mean over h before and h after a moment, where h is sqrt(3) times its standard deviation.
        shown, x, y, theta = (math.fsum(values) / len(self._seen) for values in zip(*self._seen, strict=True))
        x += self._position_noise * gauss(0.0, 1.0)
        y += self._position_noise * gauss(0.0, 1.0)
        theta += self._heading_noise * gauss(0.0, 1.0)
        stamp = shown + p.pose_latency
        # clock_skew: the cameras' clock shows (1 + e) t at time t.
        return Pose(stamp * (1.0 + p.clock_skew), max(stamp, time), x, y, math.remainder(theta, 2.0 * math.pi))
