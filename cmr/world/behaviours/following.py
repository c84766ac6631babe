"""A follower: drives where its leader drove, at a distance."""

from cmr.model.parameters import RobotParameters
from cmr.world.behaviours.behaviour import Behaviour
from cmr.world.behaviours.pursuit import Path, steer
from cmr.world.view import Robot, WorldView

SPACING = 0.02  # m between points of the trail
LOOK_AHEAD = 0.15  # m
SPEED_PER_DISTANCE = 1.5  # 1/s: speed for each metre too far behind
DEAD_ZONE = 0.02  # m; nearer than this to its place, the robot rests
ACCELERATION = 0.5  # m/s^2


class Follow(Behaviour):
    """Follow the robot `leader` on its trail, `gap` [m] behind it along the trail, at most at `speed` [m/s].

    The robot drives the leader's path, not the shortest way to the leader, so that a leader can make it drive a
    figure-eight. It rests while the leader is not in the world.
    """

    def __init__(self, leader: int = 10, gap: float = 0.5, speed: float = 0.6) -> None:
        if gap <= 0.0 or speed <= 0.0:
            raise ValueError("gap and speed must be above 0")
        self.leader, self.gap, self.speed = leader, gap, speed
        self._trail: Path | None = None
        self._last_utime = 0
        self._current_speed = 0.0

    def command(self, utime: int, me: Robot, world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties that keep the robot on the leader's trail."""
        leader = world.robot(self.leader)
        dt, self._last_utime = min((utime - self._last_utime) * 1e-6, 0.1), utime
        if leader is None:
            self._trail, self._current_speed = None, 0.0
            return 0.0, 0.0
        if self._trail is None:
            self._trail = Path()
            self._trail.append(me.state.x, me.state.y)
        self._trail.append(leader.state.x, leader.state.y, SPACING)
        self._trail.advance(me.state.x, me.state.y)
        behind = self._trail.length - self._trail.progress - self.gap
        if behind < DEAD_ZONE:
            self._current_speed = 0.0
            return 0.0, 0.0
        wanted = min(self.speed, SPEED_PER_DISTANCE * behind)
        self._current_speed = min(self._current_speed + ACCELERATION * dt, wanted)
        return steer(me, self._trail.at(self._trail.progress + LOOK_AHEAD), self._current_speed, parameters)
