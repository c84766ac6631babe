"""The state of a real robot, fused from wheel speeds, gyro and external pose.

An extended Kalman filter over (x, y, theta): wheels and gyro carry it on, poses correct it. A pose that arrives late
is compared with where the robot was when it was measured. Source: Thrun, Burgard, Fox, Probabilistic Robotics,
chapters 5.4 and 7.

A pose too far from where the robot can be is not used. Where poses agree with one another for a second instead, the
robot was put elsewhere, and the estimate is reset to them; PX4's EKF2 does likewise. `reset` says so.
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
REST_STD = 1e-4  # m or rad per square root of second: keeps the filter willing to learn at rest
GYRO_LIFETIME = 100_000  # us; after this long without a reading turns are taken from the wheels
LONGEST_STEP = 0.2  # s; over a longer gap in the feedback nothing is assumed about the motion
CLOCK_STEP = 1.0  # s; stamps further back than this are no late message but another clock
PATIENCE = 500_000  # us for which a robot's first pose is waited for; one without any begins at the origin
HISTORY = 1_000_000  # us within which late poses still find where the robot was
ACCELERATION_SMOOTHING = 0.05  # s; time constant of the smoothed wheel acceleration
# Of a robot whose wheels say nothing: how fast it may move [m/s, m/s, rad/s].
UNSEEN = (1.0, 1.0, 2.0)
# Poses are not used that are so many standard deviations away, of the estimate, of trackers worse than POSE_STD, and of
# a model that is wrong by a share of what was driven and turned since a pose was used. The tracked point may be as far
# from the centre of rotation [m].
GATE = 5.0
GATE_STD = (0.03, 0.03, 0.06)  # m, m, rad
MODEL_ERROR = 0.3
OFF_CENTRE = 0.2
RESET_AFTER = 1_000_000  # us for which poses agree with one another, and not with the estimate
FEWEST_FOR_RESET = 3
POSE_VARIANCE, GATE_VARIANCE, UNSEEN_VARIANCE = (np.diag(np.square(stds)) for stds in (POSE_STD, GATE_STD, UNSEEN))
IDENTITY = np.eye(3)
FAR, REPEATED = "far from where the robot can be", "not newer than the last one"


class Reset(NamedTuple):
    """A new beginning of the estimate, at a pose stamped `utime` [us], `distance` [m] from where it was."""

    utime: int
    distance: float


class _Elsewhere(NamedTuple):
    """Poses that agree with one another but not with the estimate, from `since` [us] on.

    `measured` is the last one, `estimated` where the robot was then by the estimate.
    """

    since: int
    poses: int
    measured: Floats
    estimated: Floats


class Estimator:
    """The estimate of one real robot; feed it messages by `handle`, read `utime` and `state`.

    `parameters` may change at any time; the pose does not jump, but at a `reset`. `located` is whether a pose has been
    seen: without one the world's origin is where the robot started.
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
        self.reset: Reset | None = None  # the last one
        self._poses_used: deque[int] = deque()
        self._alone_since: int | None = None  # stamp of the first pose since the wheels were heard
        self._unsure = (0.0, 0.0)  # m, rad by which a wrong model may mislead since a pose was used
        self._elsewhere: _Elsewhere | None = None

    @property
    def state(self) -> RobotState:
        """The newest estimate."""
        x, y, theta = self._pose.tolist()
        return RobotState(x, y, theta, *self._psi, *self._domega)

    @property
    def known(self) -> bool:
        """Whether the estimate may be shown: a pose has been seen, or waited for long enough."""
        return self.located or (self._first_utime is not None and self.utime - self._first_utime >= PATIENCE)

    def handle(self, _utime: int, channel: str, message: Message) -> str:
        """Take MOTOR_FEEDBACK_N, GYRO_N or POSE_N of this robot; return why it was not used, empty if it was."""
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
        """Carry the estimate on by what the wheels have done since the last feedback."""
        self._first_utime = min(message.utime, self._first_utime or message.utime)
        dt = (message.utime - self._feedback_utime) * 1e-6
        if dt < -CLOCK_STEP:
            # The robot's clock was set back, or one stamp was wrong: go on from here.
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
        """Correct the estimate by a measured pose, if the robot can be there."""
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
        """Return whether a pose that is off by `error` [m, m, rad] is within the gate."""
        dx, dy, angle = error.tolist()
        if math.hypot(dx, dy) <= GATE_STD[0] and abs(angle) <= GATE_STD[2]:
            return True  # most are, and this is quicker
        aside, turned = self._unsure
        return _is_near(error, covariance + GATE_VARIANCE + np.diag(np.square([aside, aside, turned])))

    def _begin_at(self, measured: Floats, utime: int) -> None:
        """Let the estimate begin at a measured pose, whatever was before."""
        self._pose = np.array([measured[0], measured[1], wrap(measured[2])])
        self._covariance = POSE_VARIANCE
        self._history.clear()
        self._note_used(utime)

    def _note_used(self, utime: int) -> None:
        """Note that a pose was used: the estimate is sure again, and the same pose is no news."""
        self._unsure = (0.0, 0.0)
        self._elsewhere = None
        self._poses_used.append(utime)
        while abs(utime - self._poses_used[0]) > HISTORY:
            self._poses_used.popleft()

    def _unseen(self, utime: int) -> float:
        """Return for how long [s] until `utime` only poses of the robot were heard, since the last one."""
        alone_since = utime if self._alone_since is None else self._alone_since
        self._alone_since = min(alone_since, utime)
        if utime - alone_since <= LONGEST_STEP * 1e6:
            return 0.0
        seen = max(alone_since, self._poses_used[-1] if self._poses_used else 0)
        return max(utime - seen, 0) * 1e-6

    def _still_far(self, utime: int, measured: Floats, estimated: Floats, unseen: float) -> bool:
        """Note a pose that is far away; where such poses agree for long enough, reset the estimate and return False."""
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
        """Return where the robot was, by today's knowledge, at `utime`."""
        for time, pose in reversed(self._history):
            if time <= utime:
                return pose + self._corrected
        return self._history[0][1] + self._corrected if self._history else self._pose


def _difference(pose: Floats, other: Floats) -> Floats:
    """Return how far a pose is from another [m, m, rad; world frame]."""
    apart = pose - other
    apart[2] = wrap(apart[2])
    return apart


def _is_near(error: Floats, covariance: Floats) -> bool:
    """Return whether an error is within GATE standard deviations."""
    return float(error @ np.linalg.solve(covariance, error)) <= GATE**2


def _seen_from(pose: Floats, later: Floats) -> Floats:
    """Return a later pose as seen from a pose, in its own frame."""
    dx, dy, angle = _difference(later, pose)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx, angle])
