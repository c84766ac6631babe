"""Assign simulated robots to their deciders: shared behaviours, own behaviours, or twins' commands."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.behaviours import AnyBehaviour, Behaviour, TeamBehaviour
from cmr.world.behaviours.team import Duties, Indices, duties_of, stacked
from cmr.world.view import TWIN, Robot, Robots, WorldView, numbers_of

LARGEST_TURN = 2_000  # robots with behaviours of their own that decide in one step

Commanded = Callable[[int, int], tuple[float, float]]  # the duties of a real robot by its id and the time [us]


@dataclass(frozen=True)
class _Group:
    """Robots that share a behaviour: their indices among all, their ids, and their parameters as arrays."""

    behaviour: TeamBehaviour
    index: Indices | slice
    robot_id: tuple[int, ...]
    origin: tuple[int, ...]
    parameters: RobotParameters

    @property
    def everybody(self) -> bool:
        """Whether these are all robots, in their order."""
        return isinstance(self.index, slice)


class Deciding:
    """Decides for these robots, in this order, as long as they and their parameters are the same.

    `behaviours` and `parameters` are those of virtual robots by id; twins use the duties that `commanded` returns for
    their robots. Robots that do not decide in this step keep their duties, initially those of `before`.
    """

    def __init__(
        self,
        robots: Robots,
        behaviours: Mapping[int, AnyBehaviour],
        parameters: Callable[[int], RobotParameters],
        commanded: Commanded,
        before: "Deciding | None" = None,
    ) -> None:
        self.robot_id = robots.robot_id
        self._commanded = commanded
        self._duties: Duties = np.zeros((2, len(robots.robot_id))).T  # stored by side, as `bounded` expects
        if before is not None:
            kept = min(len(before._duties), len(self._duties))
            self._duties[:kept] = before._duties[:kept]
        self._twins: list[int] = []
        self._own: list[tuple[int, Behaviour, RobotParameters]] = []
        members: dict[int, tuple[TeamBehaviour, list[int]]] = {}
        for index, (robot_id, origin) in enumerate(zip(robots.robot_id, robots.origin, strict=True)):
            behaviour = None if origin == TWIN else behaviours[robot_id]
            if behaviour is None:
                self._twins.append(index)
            elif isinstance(behaviour, TeamBehaviour):
                members.setdefault(id(behaviour), (behaviour, []))[1].append(index)
            else:
                self._own.append((index, behaviour, parameters(robot_id)))
        self._groups = [_group(behaviour, index, robots, parameters) for behaviour, index in members.values()]

    def duties(self, utime: int, step: int, robots: Robots, world: WorldView) -> Duties:
        """Return the duties of all robots at `utime` [us], in the step with number `step`."""
        for group in self._groups:
            me = robots if group.everybody else _some(group, robots)
            self._duties[group.index] = duties_of(group.behaviour, utime, me, world, group.parameters)
        for index, behaviour, parameters in self._turn(step):
            me_alone = Robot(utime, robots.robot_id[index], robots.origin[index], robots.state_of(index))
            self._duties[index] = behaviour.command(utime, me_alone, world, parameters)
        for index in self._twins:
            self._duties[index] = self._commanded(robots.robot_id[index], utime)
        return self._duties

    def _turn(self, step: int) -> Iterator[tuple[int, Behaviour, RobotParameters]]:
        """Yield the robots with a behaviour of their own whose turn it is: all of them, unless there are very many."""
        turns = math.ceil(len(self._own) / LARGEST_TURN) or 1
        first = step % turns * LARGEST_TURN
        yield from self._own[first : first + LARGEST_TURN]


def _some(group: _Group, robots: Robots) -> Robots:
    """Return the robots of a group."""
    return Robots(group.robot_id, group.origin, RobotState(*np.array(robots.state, dtype=float)[:, group.index]))


def _group(
    behaviour: TeamBehaviour, index: list[int], robots: Robots, parameters: Callable[[int], RobotParameters]
) -> _Group:
    robot_id = numbers_of([robots.robot_id[i] for i in index])
    origin = numbers_of([robots.origin[i] for i in index])
    which: Indices | slice = slice(None) if robot_id == robots.robot_id else np.array(index)  # all, or some
    return _Group(behaviour, which, robot_id, origin, stacked([parameters(each) for each in robot_id]))
