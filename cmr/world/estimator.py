"""The state of a real robot, fused from wheel speeds, gyro and external pose.

An extended Kalman filter over (x, y, theta): wheels and gyro predict, poses correct. A delayed pose is compared with
the estimate for the time of its measurement. Source: Thrun, Burgard, Fox, Probabilistic Robotics, chapters 5.4 and 7.

A pose outside the gate is not used. If such poses agree with each other for a second, the robot was moved by hand, and
the estimate is reset to them, as in PX4's EKF2. `reset` records it.
"""

import math
from collections import deque
from typing import NamedTuple, TypeAlias

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
REST_STD = 1e-4  # m or rad per square root of second: keeps the covariance from collapsing at rest
GYRO_LIFETIME = 100_000  # us; without a reading for this long, yaw comes from the wheels
LONGEST_STEP = 0.2  # s; no motion is assumed over a longer gap in the feedback
CLOCK_STEP = 1.0  # s; a stamp further back comes from another clock, not from a late message
PATIENCE = 500_000  # us to wait for a robot's first pose; without one it starts at the origin
HISTORY = 1_000_000  # us of past estimates kept for late poses
ACCELERATION_SMOOTHING = 0.05  # s; time constant of the smoothed wheel acceleration
# Process noise of a robot without wheel feedback: how fast it may move [m/s, m/s, rad/s].
UNSEEN = (1.0, 1.0, 2.0)
# Gate in standard deviations, which include the estimate's, those of trackers worse than POSE_STD, and a model error
# proportional to distance and rotation since the last pose used. The tracked point may be this far from the centre of
# rotation [m].
GATE = 5.0
GATE_STD = (0.03, 0.03, 0.06)  # m, m, rad
MODEL_ERROR = 0.3
OFF_CENTRE = 0.2
RESET_AFTER = 1_000_000  # us for which poses must agree with each other but not with the estimate
FEWEST_FOR_RESET = 3
POSE_VARIANCE, GATE_VARIANCE, UNSEEN_VARIANCE = (np.diag(np.square(stds)) for stds in (POSE_STD, GATE_STD, UNSEEN))
IDENTITY = np.eye(3)
FAR, REPEATED = "far from where the robot can be", "not newer than the last one"


class Reset(NamedTuple):
    """A reset of the estimate to a pose stamped `utime` [us], `distance` [m] from the previous estimate."""

    utime: int
    distance: float


class _Elsewhere(NamedTuple):
    """A series of poses since `since` [us] that agree with each other but not with the estimate.

    `measured` is the last one, `estimated` the estimate for the same time.
    """

    since: int
    poses: int
    measured: Floats
    estimated: Floats


class Estimator:
    """The estimate of one real robot; feed it messages by `handle`, read `utime` and `state`.

    `parameters` may change at any time; the pose jumps only at a `reset`. `located` is whether a pose has been
    received: without one, the robot's start is the world's origin.
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
        # Past poses without the corrections up to then: a recent error is assumed to have been the same before.
        self._history: deque[tuple[int, Floats]] = deque()
        self._corrected: Floats = np.zeros(3)
        self.reset: Reset | None = None  # the last one
        self._poses_used: deque[int] = deque()
        self._alone_since: int | None = None  # stamp of the first pose since the last wheel feedback
        self._unsure = (0.0, 0.0)  # m, rad of possible model error since the last pose used
        self._elsewhere: _Elsewhere | None = None

    @property
    def state(self) -> RobotState:
        """The newest estimate."""
        x, y, theta = self._pose.tolist()
        return RobotState(x, y, theta, *self._psi, *self._domega)

    @property
    def known(self) -> bool:
        """Whether the estimate may be shown: a pose was received, or the wait for one is over."""
        return self.located or (self._first_utime is not None and self.utime - self._first_utime >= PATIENCE)

    def handle(self, _utime: int, channel: str, message: Message) -> str:
        """Handle MOTOR_FEEDBACK_N, GYRO_N or POSE_N of this robot; return why it was not used, empty if it was."""
        _, robot_id = identify(channel) or (None, None)
        if robot_id != self.robot_id:
            return ""
        if isinstance(message, motor_feedback_t):
            return self._roll(message)
        if isinstance(message, gyro_t) and message.valid:
            return self._turn(message)
        return self._correct(message) if isinstance(message, pose_xyt_t) else ""

    def _turn(self, message: gyro_t) -> str:
        if 0 <= self._gyro_utime - message.utime <= CLOCK_STEP * 1e6:
            return REPEATED
        self._yaw_rate, self._gyro_utime = message.yaw_rate, message.utime
        return ""

    def _roll(self, message: motor_feedback_t) -> str:
        """Predict the estimate from the wheel motion since the last feedback."""
        self._first_utime = min(message.utime, self._first_utime or message.utime)
        dt = (message.utime - self._feedback_utime) * 1e-6
        if dt < -CLOCK_STEP:
            # The robot's clock was set back, or one stamp was wrong: continue from here.
            self._feedback_utime = self.utime = message.utime
            self._history.clear()
            return ""
        if dt <= 0.0:
            return REPEATED
        psi = (message.psi_left, message.psi_right)
        self._feedback_utime = message.utime
        self.utime = max(self.utime, message.utime)
        if dt > LONGEST_STEP:
            self._psi, self._domega = psi, (0.0, 0.0)
            return ""
        keep = np.exp(-dt / ACCELERATION_SMOOTHING)
        left, right = (
            float(keep * old + (1.0 - keep) * (new - before) / dt)
            for old, new, before in zip(self._domega, psi, self._psi, strict=True)
        )
        self._psi, self._domega = psi, (left, right)
        if self.parameters is not None:
            self._predict(dt, self.parameters)
        return ""

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
        self._alone_since = None
        aside = MODEL_ERROR * abs(length) + OFF_CENTRE * abs(angle)
        self._unsure = (self._unsure[0] + aside, self._unsure[1] + MODEL_ERROR * abs(angle))
        self._history.append((self._feedback_utime, self._pose - self._corrected))
        while self._history[0][0] < self._feedback_utime - HISTORY:
            self._history.popleft()

    def _correct(self, message: pose_xyt_t) -> str:
        """Correct the estimate with a measured pose, if it is within the gate."""
        if not math.isfinite(message.x + message.y + message.theta):
            return "not finite"
        if message.utime in self._poses_used:
            return REPEATED
        measured = np.array([message.x, message.y, message.theta])
        self.utime = max(self.utime, message.utime)
        if not self.located:
            self.located = True
            self._begin_at(measured, message.utime)
            return ""
        estimated = self._pose_at(message.utime)
        error = _difference(measured, estimated)
        unseen = self._unseen(message.utime)
        covariance = self._covariance if unseen == 0.0 else self._covariance + unseen**2 * UNSEEN_VARIANCE
        if not self._can_be(error, covariance):
            return FAR if self._still_far(message.utime, measured, estimated, unseen) else ""
        gain = covariance @ np.linalg.inv(covariance + POSE_VARIANCE)
        correction = gain @ error
        self._pose = self._pose + correction
        self._pose[2] = wrap(self._pose[2])
        self._covariance = (IDENTITY - gain) @ covariance
        self._corrected = self._corrected + correction
        self._note_used(message.utime)
        return ""

    def _can_be(self, error: Floats, covariance: Floats) -> bool:
        """Return whether a pose with this error [m, m, rad] is within the gate."""
        dx, dy, angle = error.tolist()
        if math.hypot(dx, dy) <= GATE_STD[0] and abs(angle) <= GATE_STD[2]:
            return True  # the usual case, decided quickly
        aside, turned = self._unsure
        return _is_near(error, covariance + GATE_VARIANCE + np.diag(np.square([aside, aside, turned])))

    def _begin_at(self, measured: Floats, utime: int) -> None:
        """Reset the estimate to a measured pose."""
        self._pose = np.array([measured[0], measured[1], wrap(measured[2])])
        self._covariance = POSE_VARIANCE
        self._history.clear()
        self._note_used(utime)

    def _note_used(self, utime: int) -> None:
        """Record that a pose was used: model error starts from zero, and a repeat of the pose is ignored."""
        self._unsure = (0.0, 0.0)
        self._elsewhere = None
        self._poses_used.append(utime)
        while abs(utime - self._poses_used[0]) > HISTORY:
            self._poses_used.popleft()

    def _unseen(self, utime: int) -> float:
        """Return the time [s] from the last used pose to `utime` if only poses, and no wheel feedback, arrived."""
        alone_since = utime if self._alone_since is None else self._alone_since
        self._alone_since = min(alone_since, utime)
        if utime - alone_since <= LONGEST_STEP * 1e6:
            return 0.0
        seen = max(alone_since, self._poses_used[-1] if self._poses_used else 0)
        return max(utime - seen, 0) * 1e-6

    def _still_far(self, utime: int, measured: Floats, estimated: Floats, unseen: float) -> bool:
        """Record a pose outside the gate; if such poses have agreed for long enough, reset the estimate and return
        False.
        """
        now = _Elsewhere(utime, 1, measured, estimated)
        before = self._elsewhere
        if before is not None and utime > before.since:
            moved = _difference(_seen_from(before.measured, measured), _seen_from(before.estimated, estimated))
            if _is_near(moved, 2.0 * GATE_VARIANCE + unseen**2 * UNSEEN_VARIANCE):
                now = now._replace(since=before.since, poses=before.poses + 1)
        self._elsewhere = now
        if now.poses < FEWEST_FOR_RESET or utime - now.since < RESET_AFTER:
            return True
        self.reset = Reset(utime, float(np.hypot(*(measured - estimated)[:2])))
        self._begin_at(measured, utime)
        return False

    def _pose_at(self, utime: int) -> Floats:
        """Return the current best estimate of the robot's pose at `utime`."""
        for time, pose in reversed(self._history):
            if time <= utime:
                return pose + self._corrected
        return self._history[0][1] + self._corrected if self._history else self._pose


def _difference(pose: Floats, other: Floats) -> Floats:
    """Return the difference of two poses [m, m, rad; world frame]."""
    apart = pose - other
    apart[2] = wrap(apart[2])
    return apart


def _is_near(error: Floats, covariance: Floats) -> bool:
    """Return whether an error is within GATE standard deviations."""
    return float(error @ np.linalg.solve(covariance, error)) <= GATE**2


def _seen_from(pose: Floats, later: Floats) -> Floats:
    """Return a later pose in the frame of an earlier one."""
    dx, dy, angle = _difference(later, pose)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx, angle])
