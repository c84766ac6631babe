"""Safety guards independent of the behaviour: geofence, missing poses, and robots in the way."""

import math
from typing import NamedTuple

import numpy as np

from cmr.geometry.obstacles import Geofence
from cmr.model.body import forward
from cmr.model.parameters import RobotParameters
from cmr.msg import pose_xyt_t
from cmr.world.view import Robot, WorldView

MARGIN = 0.3  # m from the geofence's border at which a robot is stopped
STOPPING = 0.3  # s until a robot stops: the pilot's data is delayed, and so are the motors
OLDEST_POSE = 500_000  # us
DOUBTFUL = 0.5  # m from the estimate; the estimator uses poses nearer than about this
# us for which a robot stops after a doubtful pose; if such poses go on for longer, it has left the geofence
DOUBTED = 500_000
STANDING = 0.01  # m/s; slower counts as standing


class FenceGuard:
    """Stops a robot that gets nearer than `margin` [m] to the border of its geofence, or would soon be outside.

    `left` is then a sentence. The stop is permanent, because a robot that somebody carries back must not start driving
    in their hands. A pose outside the fence that is far from the estimate is doubtful, possibly a tracker glitch. The
    robot stops at once, until half a second after the last such pose. If they go on for longer, without a pose inside
    and near the estimate between them, then the estimate is wrong, not the tracker, and the stop is permanent.
    """

    def __init__(self, robot_id: int, geofence: Geofence, margin: float = MARGIN, program: str = "cmr-pilot") -> None:
        self.left = ""
        # Distance of the last position from the border, and the margin [m]
        self.kept: tuple[float, float] | None = None
        self._robot_id, self._geofence, self._margin, self._program = robot_id, geofence, margin, program
        self._doubts: _Doubts | None = None

    def look(self, x: float, y: float, going: tuple[float, float] = (0.0, 0.0)) -> None:
        """Check the robot's position [m; world frame] and velocity [m/s]."""
        away = float(self._geofence.distance(x, y))
        self.kept = away, self._margin
        if self.left or self._holds(x, y, going):
            return
            return
        inside = bool(self._geofence.contains(x, y))
        where = f"{away:.2f} m {'inside' if inside else 'outside'} of the border" if math.isfinite(away) else "nowhere"
        self.left = (
            f"Robot {self._robot_id} left its geofence: at ({x:.2f}, {y:.2f}) m it was {where}, with a margin of "
            f"{self._margin:g} m. It stands. Put it back inside by hand and start {self._program} again."
        )

    def look_at_pose(self, x: float, y: float, estimated: tuple[float, float] | None, now: int) -> None:
        """Check a pose [m] received at `now` [us] against the estimated position, None if there is no estimate.

        Call it once per pose.
        """
        doubtful = estimated is None or math.dist((x, y), estimated) > DOUBTFUL
        if not doubtful:
            self.look(x, y)
            self._doubts = self._doubts and self._doubts._replace(since=None)
        elif not self._holds(x, y):
            since = self._doubts.since if self._doubts and self._doubts.since is not None else now
            self._doubts = _Doubts(since, now, (x, y))
            if now - since >= DOUBTED:
                self.look(x, y)

    def doubt(self, now: int) -> str:
        """Return what the robot waits for at `now` [us] after a doubtful pose; empty without a recent one."""
        if self._doubts is None or abs(now - self._doubts.last) > DOUBTED:
            return ""
        x, y = self._doubts.place
        return (
            f"poses inside its geofence: one at ({x:.2f}, {y:.2f}) m is far from where cmr-sim has robot "
            f"{self._robot_id}"
        )

    def _holds(self, x: float, y: float, going: tuple[float, float] = (0.0, 0.0)) -> bool:
        """Return whether a position is far enough inside and will stay so."""
        soon = (x + STOPPING * going[0], y + STOPPING * going[1])
        far_enough = bool(self._geofence.contains(x, y)) and float(self._geofence.distance(x, y)) >= self._margin
        return far_enough and bool(self._geofence.contains(*soon))


class _Doubts(NamedTuple):
    """Doubtful poses outside: times of the first and the last [us], and the last position [m].

    `since` is None after a good pose, so the next doubtful one starts a new series.
    """

    since: int | None
    last: int
    place: tuple[float, float]


class PoseGuard:
    """Monitors the robot's poses (POSE_N): `missing` reports problems with them.

    A robot that never had poses may drive without them, unless they are `needed`. A robot that had them once needs
    them.
    """

    def __init__(self, robot_id: int, *, needed: bool) -> None:
        self._robot_id, self._needed = robot_id, needed
        self._stamp: int | None = None
        self._news = False
        self._heard = 0

    @property
    def heard(self) -> bool:
        """Whether a pose was received."""
        return self._stamp is not None

    def take(self, message: pose_xyt_t, now: int) -> bool:
        """Handle a pose_xyt_t at `now` [us]; return whether it is used. Repeated poses are ignored.

        A pose stamped by a wrong clock does not replace a valid one.
        """
        if self._stamp is not None and abs(now - self._stamp) <= OLDEST_POSE < abs(now - message.utime):
            return False
        if message.utime != self._stamp:
            self._stamp, self._news = message.utime, True
        return True

    def missing(self, utime: int) -> str:
        """Return what the robot waits for at `utime` [us]; empty if its poses are there, or are not needed."""
        if self._news:
            self._heard, self._news = utime, False
        if self._stamp is None:
            return f"poses (POSE_{self._robot_id}), without which it cannot stay inside its geofence" * self._needed
        silence, age = utime - self._heard, utime - self._stamp
        if silence > OLDEST_POSE:
            return f"poses: POSE_{self._robot_id} fell silent {silence * 1e-6:.1f} s ago"
        if abs(age) > OLDEST_POSE:
            words = f"{abs(age) * 1e-6:.1f} s {'old' if age > 0 else 'ahead of the clock of this host'}"
            return f"newer poses: the last on POSE_{self._robot_id} is {words}; is one of the clocks wrong?"
        return ""


def load() -> None:
    """Load the compiled functions of `kept_clear`."""
    from cmr.world.behaviours.clearance import speed_before

    speed_before(1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, STOPPING, 1.0)
    WorldView().surroundings().velocities(1.0)


def kept_clear(
    me: Robot, world: WorldView, model: RobotParameters, duties: tuple[float, float]
) -> tuple[tuple[float, float], str]:
    """Return duties with which the robot can stop before real and virtual robots in its way, and which robot it stops
    for.

    Both duties are scaled equally, so it follows the same arc; turning on the spot is always possible.
    """
    from cmr.world.behaviours.clearance import speed_before, view_needed  # compiled: half a second
    from cmr.world.behaviours.seeking import CLEARANCE
    from cmr.world.interaction.body import body_radius

    speed = float(forward(duties[0] / model.k1, duties[1] / model.k1, model))
    if speed == 0.0:
        return duties, ""
    sign = math.copysign(1.0, speed)
    along = (sign * math.cos(me.state.theta), sign * math.sin(me.state.theta))
    around = world.surroundings()
    apart = 2.0 * float(body_radius(model.base_width)) + CLEARANCE
    dx, dy = around.x - me.state.x, around.y - me.state.y
    seen = np.hypot(dx, dy) <= view_needed(apart, abs(speed), STOPPING)
    speed_x, speed_y = around.velocities(float(model.wheel_radius))
    slowest, whom = abs(speed), ""
    for k in np.flatnonzero(seen & (around.members.robot_id != me.robot_id)).tolist():
        allowed = speed_before(dx[k], dy[k], *along, speed_x[k], speed_y[k], apart, STOPPING, abs(speed))
        if allowed < slowest:
            away = math.hypot(dx[k], dy[k])
            slowest = allowed
            whom = f"robot {around.members.robot_id[k]}, {away:.2f} m away, to get out of its way"
    share = slowest / abs(speed)
    return (duties[0] * share, duties[1] * share), whom if slowest < STANDING else ""
