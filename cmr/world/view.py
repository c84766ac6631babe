"""What a robot knows of the world: the latest state of every robot in it."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from cmr.bus.messages import make
from cmr.model.motion import RobotState
from cmr.msg import robot_state_t, world_state_t

REAL: int = robot_state_t.REAL
VIRTUAL: int = robot_state_t.VIRTUAL
TWIN: int = robot_state_t.TWIN

OLDEST = 1_000_000  # us; a robot of which nothing newer was heard is no longer in the world
BYTES_PER_ROBOT = 4 + 1 + 7 * 4
BYTES_OF_HEAD = 8 + 8 + 4  # fingerprint, utime, n


class Robot(NamedTuple):
    """One robot at the time `utime` [us]; `origin` is REAL, VIRTUAL or TWIN."""

    utime: int
    robot_id: int
    origin: int
    state: RobotState


class WorldView:
    """The robots of the world, kept up to date by `put` or from WORLD_STATE messages by `handle`."""

    def __init__(self) -> None:
        self.utime = 0
        self._robots: dict[tuple[int, int], Robot] = {}

    def put(self, robot: Robot) -> None:
        """Take the newest state of a robot."""
        self._robots[robot.robot_id, robot.origin] = robot
        self.utime = max(self.utime, robot.utime)

    def handle(self, utime: int, _channel: str, message: Any) -> None:
        """Take a world_state_t, the whole world or a part of it."""
        arrays = (getattr(message, name) for name in RobotState._fields)
        for robot_id, origin, *state in zip(message.robot_id, message.origin, *arrays, strict=True):
            self.put(Robot(utime, robot_id, origin, RobotState(*state)))

    def robot(self, robot_id: int) -> Robot | None:
        """Return the real or virtual robot of this id, None if it is not in the world (any more)."""
        for origin in (REAL, VIRTUAL):
            robot = self._robots.get((robot_id, origin))
            if robot is not None and self.utime - robot.utime <= OLDEST:
                return robot
        return None

    def twin(self, robot_id: int) -> Robot | None:
        """Return the twin of a real robot, None if it has none."""
        return self._robots.get((robot_id, TWIN))


def world_messages(utime: int, robots: Iterable[Robot], largest: int | None = None) -> list[Any]:
    """Return world_state_t messages of all robots at `utime`: one, or so many that none exceeds `largest` bytes."""
    robots = list(robots)
    part = len(robots) if largest is None else max((largest - BYTES_OF_HEAD) // BYTES_PER_ROBOT, 1)
    return [_message(utime, robots[first : first + part]) for first in range(0, len(robots), max(part, 1))]


def _message(utime: int, robots: list[Robot]) -> Any:
    states = np.array([robot.state for robot in robots], dtype=float).T.tolist()
    return make(
        world_state_t,
        utime=utime,
        robot_id=[robot.robot_id for robot in robots],
        origin=[robot.origin for robot in robots],
        **dict(zip(RobotState._fields, states, strict=True)),
    )
