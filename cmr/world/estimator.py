"""The state of a real robot, fused from wheel speeds, gyro and external pose.

An extended Kalman filter over (x, y, theta): wheels and gyro carry it on, poses correct it. A pose that arrives late
is compared with where the robot was when it was measured. Source: Thrun, Burgard, Fox, Probabilistic Robotics,
chapters 5.4 and 7.
"""

from collections import deque
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.bus.message import Message
from cmr.bus.streams import identify
from cmr.model.body import arc, forward, turn, wrap
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t

Floats: TypeAlias = NDArray[np.float64]
POSE_STD = (0.01, 0.01, 0.02)  # m, m, rad: motion capture or lidar SLAM
SLIP_STD = 0.03  # m per square root of metre travelled
TURN_STD = {"gyro": 0.01, "wheels": 0.1}  # rad per square root of second with a gyro; of radian turned without one
REST_STD = 1e-4  # m or rad per square root of second: keeps the filter willing to learn at rest
GYRO_LIFETIME = 100_000  # us; after this long without a reading turns are taken from the wheels
LONGEST_STEP = 0.2  # s; over a longer gap in the feedback nothing is assumed about the motion
CLOCK_STEP = 1.0  # s; stamps further back than this are no late message but another clock
PATIENCE = 500_000  # us for which a robot's first pose is waited for; one without any begins at the origin
HISTORY = 1_000_000  # us within which late poses still find where the robot was
ACCELERATION_SMOOTHING = 0.05  # s; time constant of the smoothed wheel acceleration


class Estimator:
    """The estimate of one real robot; feed it messages by `handle`, read `utime` and `state`.

    `parameters` may change at any time; the pose does not jump. `located` is whether a pose has been seen: without
    one the world's origin is where the robot started.
    """

    def __init__(self, robot_id: int) -> None:
        self.robot_id = robot_id
        self.parameters: RobotParameters | None = None
        self.utime = 0
        self.located = False
        self._first_utime: int | None = None
        self._pose: Floats = np.zeros(3)
        self._covariance: Floats = np.zeros((3, 3))
        self._psi = (0.0, 0.0)
        self._domega = (0.0, 0.0)
        self._yaw_rate = 0.0
        self._gyro_utime = 0
        self._feedback_utime = 0
        # Where the robot was, less all corrections until then: what was wrong lately was wrong before by as much.
        self._history: deque[tuple[int, Floats]] = deque()
        self._corrected: Floats = np.zeros(3)

    @property
    def state(self) -> RobotState:
        """The newest estimate."""
        x, y, theta = self._pose.tolist()
        return RobotState(x, y, theta, *self._psi, *self._domega)

    @property
    def known(self) -> bool:
        """Whether the estimate may be shown: a pose has been seen, or waited for long enough."""
        return self.located or (self._first_utime is not None and self.utime - self._first_utime >= PATIENCE)

    def handle(self, _utime: int, channel: str, message: Message) -> None:
        """Take MOTOR_FEEDBACK_N, GYRO_N or POSE_N of this robot."""
        _, robot_id = identify(channel) or (None, None)
        if robot_id != self.robot_id:
            return
        if isinstance(message, motor_feedback_t):
            self._roll(message)
        elif isinstance(message, gyro_t) and message.valid:
            self._yaw_rate, self._gyro_utime = message.yaw_rate, message.utime
        elif isinstance(message, pose_xyt_t):
            self._correct(message)

    def _roll(self, message: motor_feedback_t) -> None:
        """Carry the estimate on by what the wheels have done since the last feedback."""
        self._first_utime = min(message.utime, self._first_utime or message.utime)
        dt = (message.utime - self._feedback_utime) * 1e-6
        if dt < -CLOCK_STEP:
            # The robot's clock was set back, or one stamp was wrong: go on from here.
            self._feedback_utime = self.utime = message.utime
            self._history.clear()
            return
        if dt <= 0.0:
            return
        psi = (message.psi_left, message.psi_right)
        self._feedback_utime = message.utime
        self.utime = max(self.utime, message.utime)
        if dt > LONGEST_STEP:
            self._psi, self._domega = psi, (0.0, 0.0)
            return
        keep = np.exp(-dt / ACCELERATION_SMOOTHING)
        left, right = (
            float(keep * old + (1.0 - keep) * (new - before) / dt)
            for old, new, before in zip(self._domega, psi, self._psi, strict=True)
        )
        self._psi, self._domega = psi, (left, right)
        if self.parameters is not None:
            self._predict(dt, self.parameters)

    def _predict(self, dt: float, parameters: RobotParameters) -> None:
        length = forward(*self._psi, parameters) * dt
        by_gyro = self._feedback_utime - self._gyro_utime < GYRO_LIFETIME
        angle = self._yaw_rate * dt if by_gyro else turn(*self._psi, parameters) * dt
        dx, dy = arc(self._pose[2], length, angle)
        transition = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        heading_variance = TURN_STD["gyro"] ** 2 * dt if by_gyro else TURN_STD["wheels"] ** 2 * abs(angle)
        slip_variance = SLIP_STD**2 * abs(length)
        noise = np.array([slip_variance, slip_variance, heading_variance]) + REST_STD**2 * dt
        self._covariance = transition @ self._covariance @ transition.T + np.diag(noise)
        self._pose = np.array([self._pose[0] + dx, self._pose[1] + dy, wrap(self._pose[2] + angle)])
        self._history.append((self._feedback_utime, self._pose - self._corrected))
        while self._history[0][0] < self._feedback_utime - HISTORY:
            self._history.popleft()

    def _correct(self, message: pose_xyt_t) -> None:
        """Correct the estimate by a measured pose."""
        measured = np.array([message.x, message.y, message.theta])
        if not np.all(np.isfinite(measured)):
            return
        self.utime = max(self.utime, message.utime)
        if not self.located:
            self.located = True
            self._pose = np.array([measured[0], measured[1], wrap(measured[2])])
            self._covariance = np.diag(np.square(POSE_STD))
            self._history.clear()
            return
        error = measured - self._pose_at(message.utime)
        error[2] = wrap(error[2])
        gain = self._covariance @ np.linalg.inv(self._covariance + np.diag(np.square(POSE_STD)))
        correction = gain @ error
        self._pose = self._pose + correction
        self._pose[2] = wrap(self._pose[2])
        self._covariance = (np.eye(3) - gain) @ self._covariance
        self._corrected = self._corrected + correction

    def _pose_at(self, utime: int) -> Floats:
        """Return where the robot was, by today's knowledge, at `utime`."""
        for time, pose in reversed(self._history):
            if time <= utime:
                return pose + self._corrected
        return self._history[0][1] + self._corrected if self._history else self._pose
