"""Simulated robots, virtual ones and twins: arrays that one step of the model advances together."""

import numpy as np

from cmr.model.motion import RobotState, step
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Floats
from cmr.world.view import Robot

STEP = 10_000  # us; one step of the simulation
FURTHEST_BEHIND = 1_000_000  # us; a simulator held up for longer, or whose clock was set, skips the rest


class Fleet:
    """The simulated robots of a world; `utime` is the moment for which their states hold."""

    def __init__(self) -> None:
        self.utime = 0
        self._index: dict[tuple[int, int], int] = {}
        self._state: Floats = np.empty((len(RobotState._fields), 0))
        self._parameters: Floats = np.empty((len(RobotParameters._fields), 0))
        self._duty: Floats = np.empty((2, 0))

    def __contains__(self, key: tuple[int, int]) -> bool:
        return key in self._index

    def place(self, robot_id: int, origin: int, state: RobotState, parameters: RobotParameters) -> None:
        """Add a robot, or put one that is there into another state."""
        key = (robot_id, origin)
        if key not in self._index:
            self._index[key] = len(self._index)
            self._state = np.column_stack([self._state, state])
            self._parameters = np.column_stack([self._parameters, parameters])
            self._duty = np.column_stack([self._duty, (0.0, 0.0)])
        self._state[:, self._index[key]] = state
        self._parameters[:, self._index[key]] = parameters

    def set_parameters(self, robot_id: int, origin: int, parameters: RobotParameters) -> None:
        """Let a robot move by other parameters from now on; its state stays."""
        self._parameters[:, self._index[robot_id, origin]] = parameters

    def command(self, robot_id: int, origin: int, left: float, right: float) -> None:
        """Drive a robot with these duties from now on; they are clipped to [-1, 1]."""
        self._duty[:, self._index[robot_id, origin]] = np.clip((left, right), -1.0, 1.0)

    def advance(self, utime: int) -> bool:
        """Let one step pass if it is due by `utime`; tell whether it did."""
        if abs(utime - self.utime) > FURTHEST_BEHIND:
            self.utime = utime - STEP
        if self.utime + STEP > utime:
            return False
        self.utime += STEP
        if self._index:
            left, right = self._duty
            state, parameters = RobotState(*self._state), RobotParameters(*self._parameters)
            self._state = np.stack(step(state, left, right, parameters, STEP * 1e-6))
        return True

    def robots(self) -> list[Robot]:
        """Return all robots as they are now."""
        columns = self._state.T.tolist()
        return [
            Robot(self.utime, robot_id, origin, RobotState(*columns[index]))
            for (robot_id, origin), index in self._index.items()
        ]
