"""A robot's view of the world: the latest state of every robot."""

from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from cmr.bus.world_state import BYTES_PER_ROBOT, HEAD, WorldState
from cmr.geometry.obstacles import Geofence, Obstacles
from cmr.model.motion import RobotState
from cmr.msg import robot_state_t, world_state_t
from cmr.world.lazy_module import LazyModule
from cmr.world.surroundings import Floats, Indices, Members, Surroundings

if TYPE_CHECKING:
    from cmr.world.interaction.neighbours import NearList

robot_loops = LazyModule("cmr.world.robot_loops")
REAL: int = robot_state_t.REAL
VIRTUAL: int = robot_state_t.VIRTUAL
TWIN: int = robot_state_t.TWIN

SEEN = 5  # fields of a state, x to psi_right, that `surroundings` contains
OLDEST = 1_000_000  # us; a robot with no newer state is no longer in the world
FURTHEST = 1e9  # m; robots further away are ignored
MOST_REMEMBERED = 500  # sets of robots whose Numbers are cached


class Numbers(tuple[int, ...]):
    """Ids or origins of robots. The same ones recur at each step, so hash and array are computed only once.

    Get them by `numbers_of`, which returns the same object for equal values, so identity replaces comparison.
    """

    def __hash__(self) -> int:
        return self._hash

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[np.generic]:
        """Convert the numbers to a NumPy array."""
        return np.array(self._array, dtype, copy=copy)

    @cached_property
    def _hash(self) -> int:
        return tuple.__hash__(self)

    @cached_property
    def _array(self) -> Indices:
        numbers = np.array(tuple(self), np.int64)
        numbers.flags.writeable = False
        return numbers


def numbers_of(values: ArrayLike) -> Numbers:
    """Return numbers from an array or a list; for the same ones, the same object."""
    return _numbers(np.asarray(values, np.int64).tobytes())


@lru_cache(MOST_REMEMBERED)
def _numbers(data: bytes) -> Numbers:
    return Numbers(np.frombuffer(data, np.int64).tolist())


@lru_cache(MOST_REMEMBERED)
def _joined(first: tuple[int, ...], second: tuple[int, ...]) -> Numbers:
    return Numbers(first + second)


class Robot(NamedTuple):
    """One robot at the time `utime` [us]; `origin` is REAL, VIRTUAL or TWIN."""

    utime: int
    robot_id: int
    origin: int
    state: RobotState


class Robots(NamedTuple):
    """Many robots: tuples of ids and origins, and a state whose fields are sequences, in the same order."""

    robot_id: tuple[int, ...]
    origin: tuple[int, ...]
    state: RobotState

    @classmethod
    def of(cls, robots: Iterable[Robot]) -> "Robots":
        """Return these robots, their states as arrays."""
        robots = list(robots)
        columns = np.array([robot.state for robot in robots], dtype=float).reshape(-1, len(RobotState._fields)).T
        robot_ids, origins = numbers_of([r.robot_id for r in robots]), numbers_of([r.origin for r in robots])
        return cls(robot_ids, origins, RobotState(*columns))

    def with_others(self, others: "Robots") -> "Robots":
        """Return these and others together."""
        if not others.robot_id:
            return self
        if not self.robot_id:
            return others
        states = (np.concatenate(pair) for pair in zip(self.state, others.state, strict=True))
        ids, origins = _joined(self.robot_id, others.robot_id), _joined(self.origin, others.origin)
        return Robots(ids, origins, RobotState(*states))

    def each(self, utime: int) -> Iterator[Robot]:
        """Yield them one by one, as they are at `utime` [us]."""
        states = map(RobotState._make, zip(*np.array(self.state, dtype=float).tolist(), strict=True))
        for robot_id, origin, state in zip(self.robot_id, self.origin, states, strict=True):
            yield Robot(utime, robot_id, origin, state)

    def state_of(self, index: int) -> RobotState:
        """Return the state of one of them."""
        return RobotState(*(float(column[index]) for column in self.state))


class WorldView:
    """The robots of the world, updated by `put` and `take`, or from WORLD_STATE messages by `handle`.

    `obstacles` and `geofence` are those that behaviours respect. A single robot's state is created only on demand: of
    thousands, few are needed.
    """

    def __init__(self) -> None:
        self.utime = 0
        self._groups: dict[tuple[tuple[int, ...], tuple[int, ...]], _Group] = {}
        self._places: dict[tuple[int, int], tuple[_Group, int]] = {}
        self._all: list[_Group] = []  # all groups that contain a robot
        self._chosen: list[tuple[_Group, Indices | slice]] = []  # the robots in `surroundings`
        self._chosen_from: list[_Group] | None = None
        self._members = Members(np.zeros(0, np.int64))
        self._surroundings: Surroundings | None = None
        self._near: dict[float, NearList] = {}
        self.obstacles = Obstacles.none()
        self.geofence: Geofence | None = None

    def put(self, robot: Robot) -> None:
        """Store the newest state of a robot."""
        self.take(robot.utime, Robots((robot.robot_id,), (robot.origin,), RobotState(*((v,) for v in robot.state))))

    def take(self, utime: int, robots: Robots) -> None:
        """Store the newest states of robots; those of others stay."""
        members = (robots.robot_id, robots.origin)
        group = self._groups.get(members) or self._regroup(members)
        group.utime, group.robots = utime, robots
        self.utime = max(self.utime, utime) if self.utime - utime <= OLDEST else utime  # otherwise a clock was set back
        self._surroundings = None

    def handle(self, utime: int, _channel: str, message: world_state_t) -> None:
        """Handle a world_state_t, the whole world or a part of it."""
        state = RobotState(*(getattr(message, name) for name in RobotState._fields))
        self.take(utime, Robots(numbers_of(message.robot_id), numbers_of(message.origin), state))

    def robot(self, robot_id: int) -> Robot | None:
        """Return the real or virtual robot of this id, None if it is not in the world (any more)."""
        for origin in (REAL, VIRTUAL):
            robot = self._robot(robot_id, origin)
            if robot is not None and self.utime - robot.utime <= OLDEST:
                return robot
        return None

    def twin(self, robot_id: int) -> Robot | None:
        """Return the twin of a real robot, None if it has none."""
        return self._robot(robot_id, TWIN)

    def surroundings(self) -> Surroundings:
        """Return all real and virtual robots that are in the world now, as arrays."""
        if self._surroundings is None:
            fresh = self._fresh()
            if fresh != self._chosen_from:
                self._choose(fresh)
            parts = [_columns(group.robots.state, index) for group, index in self._chosen]
            columns = parts[0] if len(parts) == 1 else [*np.hstack([np.zeros((SEEN, 0)), *map(np.array, parts)])]
            members = self._members
            if not robot_loops.all_sound(FURTHEST, *columns):
                state = np.array(columns)
                there = np.isfinite(state).all(axis=0) & (np.abs(state[:2]) <= FURTHEST).all(axis=0)
                members, columns = Members(members.robot_id[there]), [*np.ascontiguousarray(state[:, there])]
            self._surroundings = Surroundings(members, self._near, *columns)
        return self._surroundings

    def _fresh(self) -> "list[_Group]":
        """Return the groups with recent states."""
        return [group for group in self._all if self.utime - group.utime <= OLDEST]

    def _choose(self, fresh: "list[_Group]") -> None:
        """Select the robots for `surroundings`: those of fresh groups that are not twins and not in a newer group."""
        chosen: dict[int, list[tuple[int, int]]] = {id(group): [] for group in fresh}
        for (robot_id, origin), (group, index) in self._places.items():
            if origin != TWIN and id(group) in chosen:
                chosen[id(group)].append((index, robot_id))
        pairs = [np.array(chosen[id(group)], np.int64).reshape(-1, 2) for group in fresh]
        self._chosen = [(group, _all_or(pair[:, 0], group)) for group, pair in zip(fresh, pairs, strict=True)]
        self._chosen_from = fresh
        self._members = Members(np.concatenate([pair[:, 1] for pair in pairs] or [np.zeros(0, np.int64)]))

    def _robot(self, robot_id: int, origin: int) -> Robot | None:
        place = self._places.get((robot_id, origin))
        if place is None:
            return None
        group, index = place
        return Robot(group.utime, robot_id, origin, group.robots.state_of(index))

    def _regroup(self, members: tuple[tuple[int, ...], tuple[int, ...]]) -> "_Group":
        """Make a group of these robots; groups that lose a robot to it are dissolved."""
        group = _Group()
        left = set()
        for index, key in enumerate(zip(*members, strict=True)):
            if key in self._places:
                left.add(id(self._places[key][0]))
            self._places[key] = (group, index)
        self._groups = {known: other for known, other in self._groups.items() if id(other) not in left}
        self._groups[members] = group
        self._all = list({id(other): other for other, _ in self._places.values()}.values())
        self._chosen_from = None
        return group


def _columns(state: RobotState, index: Indices | slice) -> list[Floats]:
    """Return pose and wheel speeds of some robots as arrays for compiled functions, without copies where possible."""
    columns = [np.ascontiguousarray(column, dtype=float) for column in state[:SEEN]]
    return columns if isinstance(index, slice) else [column[index] for column in columns]


def _all_or(index: Indices, group: "_Group") -> Indices | slice:
    """Return the index of robots in a group; for all of them in order, a slice, which needs no copy."""
    return slice(None) if np.array_equal(index, np.arange(len(group.robots.robot_id))) else index


class _Group:
    """Robots whose states arrive together."""

    utime: int
    robots: Robots


def world_messages(utime: int, robots: Robots | list[Robot], largest: int | None = None) -> list[WorldState]:
    """Return world_state_t messages of all robots at `utime`: one, or several of at most `largest` bytes each."""
    everybody = robots if isinstance(robots, Robots) else Robots.of(robots)
    count = len(everybody.robot_id)
    part = count if largest is None else max((largest - HEAD.size) // BYTES_PER_ROBOT, 1)
    columns = (everybody.robot_id, everybody.origin, *everybody.state)
    if part >= count:
        return [WorldState(utime, *columns)] if count else []
    arrays = [np.asarray(column) for column in columns]
    return [WorldState(utime, *(a[first : first + part] for a in arrays)) for first in range(0, count, part)]
