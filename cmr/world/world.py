"""The whole world: real robots as estimated, virtual robots as simulated, and a twin of each real robot.

It knows no bus: messages go in by `handle`, time passes by `advance`, robots come out of `robots`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cmr.bus.estop import EmergencyStop
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE, WAYPOINTS, Stream, identify
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFileError
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour
from cmr.world.commands import CommandMemory
from cmr.world.estimator import Estimator
from cmr.world.fleet import Fleet
from cmr.world.view import REAL, TWIN, VIRTUAL, Robot, WorldView

REST_BEFORE_DRIVE = 1_000_000  # us without a command after which the next one begins a new drive
LOST = 1_000_000  # us; a real robot of which nothing newer was heard leaves the world


@dataclass(frozen=True)
class VirtualRobot:
    """A virtual robot: where it starts [m, m, rad; world frame], what it does, and whose parameters it moves by."""

    robot_id: int
    behaviour: Behaviour
    parameters_of: int
    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0


class _RealRobot:
    """What the world keeps of a real robot."""

    def __init__(self, robot_id: int) -> None:
        self.estimator = Estimator(robot_id)
        self.commands = CommandMemory()
        self.last_driven = 0


class World:
    """All robots. `follow` makes the parameter follower of a robot id; virtual robots move as their models do.

    Real robots are discovered by their MOTOR_FEEDBACK_N or POSE_N.
    """

    def __init__(self, virtual: list[VirtualRobot], follow: Callable[[int], ParameterFollower]) -> None:
        self.view = WorldView()
        self.estop = EmergencyStop()
        self.parameters: dict[int, ParameterFollower] = {}
        self._follow = follow
        self._virtual = {robot.robot_id: robot for robot in virtual}
        self._real: dict[int, _RealRobot] = {}
        self._fleet = Fleet()
        for robot in virtual:
            self._parameters_of(robot.parameters_of)

    @property
    def real_robots(self) -> list[int]:
        """The ids of the real robots heard of so far."""
        return sorted(self._real)

    def handle(self, utime: int, channel: str, message: Any) -> None:
        """Take one message from the bus or from a log."""
        self.estop.handle(utime, channel, message)
        stream, robot_id = identify(channel) or (None, None)
        if stream is None or robot_id is None:
            return
        if stream is PARAMETERS:
            if self._parameters_of(robot_id).handle(utime, channel, message):
                self._take_over(robot_id)
        elif robot_id in self._virtual:
            self._handle_virtual(stream, robot_id, message)
        elif stream in (MOTOR_FEEDBACK, POSE, GYRO):
            self._real_robot(robot_id).estimator.handle(utime, channel, message)
        elif stream is MOTOR_COMMAND and robot_id in self._real:
            self._real[robot_id].commands.take(utime, message.left, message.right)

    def poll_parameters(self) -> bool:
        """Look for replaced parameter files; tell whether any parameters changed. No robot's state does."""
        changed = [robot_id for robot_id, follower in self.parameters.items() if follower.poll()]
        for robot_id in changed:
            self._take_over(robot_id)
        return bool(changed)

    def advance(self, utime: int) -> None:
        """Let simulated robots move on to `utime` [us] in steps of 10 ms; behaviours decide at each step."""
        self._place_virtual()
        while self._fleet.advance(utime):
            now = self._fleet.utime
            for robot in self._fleet.robots():
                self.view.put(robot)
            for robot in self._present():
                self.view.put(robot)
            for robot_id, real in self._real.items():
                self._drive_twin(robot_id, real, now)
            for virtual in self._virtual.values():
                self._decide(virtual, now)

    def robots(self) -> list[Robot]:
        """Return all robots of the world as they are now; real robots not heard of lately are left out."""
        return self._present() + self._fleet.robots()

    def _present(self) -> list[Robot]:
        """Return the real robots heard of lately; one whose clock is off by more is as good as not heard."""
        return [
            Robot(robot.estimator.utime, robot_id, REAL, robot.estimator.state)
            for robot_id, robot in self._real.items()
            if abs(self._fleet.utime - robot.estimator.utime) <= LOST
        ]

    def _real_robot(self, robot_id: int) -> _RealRobot:
        if robot_id not in self._real:
            self._real[robot_id] = _RealRobot(robot_id)
            self._parameters_of(robot_id)
            self._take_over(robot_id)
        return self._real[robot_id]

    def _parameters_of(self, robot_id: int) -> ParameterFollower:
        if robot_id not in self.parameters:
            self.parameters[robot_id] = self._follow(robot_id)
        return self.parameters[robot_id]

    def _model_of(self, robot_id: int) -> RobotParameters | None:
        """Return the model parameters of a robot; None as long as they are not all known."""
        parameters = self.parameters[robot_id].parameters
        try:
            return parameters.robot_parameters if parameters else None
        except ParameterFileError:
            return None

    def _take_over(self, robot_id: int) -> None:
        """Let everything that moves by the parameters of this robot use the present ones."""
        model = self._model_of(robot_id)
        if model is None:
            return
        if robot_id in self._real:
            self._real[robot_id].estimator.parameters = model
        followers = [(robot_id, TWIN)]
        followers += [(v.robot_id, VIRTUAL) for v in self._virtual.values() if v.parameters_of == robot_id]
        for key in followers:
            if key in self._fleet:
                self._fleet.set_parameters(*key, model)

    def _place_virtual(self) -> None:
        for robot in self._virtual.values():
            if (robot.robot_id, VIRTUAL) not in self._fleet:
                model = self._model_of(robot.parameters_of)
                if model is not None:
                    start = RobotState.at_rest(robot.x, robot.y, robot.theta)
                    self._fleet.place(robot.robot_id, VIRTUAL, start, model)

    def _handle_virtual(self, stream: Stream, robot_id: int, message: Any) -> None:
        behaviour = self._virtual[robot_id].behaviour
        if stream is WAYPOINTS:
            behaviour.take_waypoints(list(message.x), list(message.y))
        elif stream is MOTOR_COMMAND:
            behaviour.take_command(message.utime, message.left, message.right)

    def _decide(self, virtual: VirtualRobot, utime: int) -> None:
        me = self.view.robot(virtual.robot_id)
        model = self._model_of(virtual.parameters_of)
        if me is not None and model is not None:
            duties = virtual.behaviour.command(utime, me, self.view, model)
            self._fleet.command(virtual.robot_id, VIRTUAL, *duties)

    def _drive_twin(self, robot_id: int, real: _RealRobot, utime: int) -> None:
        """Give the twin its robot's command; at the beginning of each drive, put it where its robot is."""
        left, right = (0.0, 0.0) if self.estop.engaged else real.commands.at(utime)
        if left or right:
            model = self._model_of(robot_id)
            begins = utime - real.last_driven > REST_BEFORE_DRIVE
            if model is not None and real.estimator.utime and (begins or (robot_id, TWIN) not in self._fleet):
                self._fleet.place(robot_id, TWIN, real.estimator.state, model)
            real.last_driven = utime
        if (robot_id, TWIN) in self._fleet:
            self._fleet.command(robot_id, TWIN, left, right)
