"""The whole world: real robots as estimated, virtual robots as simulated, and a twin of each real robot.

It is independent of the bus: `handle` receives messages, `advance` simulates, `robots` returns the robots.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from types import MappingProxyType

import numpy as np

from cmr.bus.estop import EmergencyStop
from cmr.bus.gate import Gate
from cmr.bus.message import Message
from cmr.bus.possible import OUT_OF_REACH, is_out_of_reach
from cmr.bus.streams import identify
from cmr.geometry.obstacles import Floats, Obstacles
from cmr.model.body import wrap
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController
from cmr.msg import gyro_t, motor_feedback_t, parameters_t, pose_xyt_t, waypoints_t, world_state_t
from cmr.parameters.file import ParameterFileError
from cmr.parameters.following import ParameterFollower
from cmr.recordings.commanding import COMMANDS, duties_of
from cmr.world.behaviours import AnyBehaviour, Behaviour, TeamBehaviour
from cmr.world.deciding import Deciding
from cmr.world.estimator import Reset
from cmr.world.fleet import STEP, Fleet, Key
from cmr.world.interaction.body import Bodies, body_radius
from cmr.world.process_noise import ProcessNoise
from cmr.world.reaction import Reaction
from cmr.world.real_robot import RealRobot
from cmr.world.remote_robots import RemoteRobots
from cmr.world.view import REAL, TWIN, VIRTUAL, Robot, Robots, WorldView

MEASURED = (motor_feedback_t, pose_xyt_t, gyro_t)  # sent only by real robots
REST_BEFORE_DRIVE = 1_000_000  # us without a command after which the next one begins a new drive
MOST_STEPS_AT_ONCE = 10  # limit per turn, so that a delayed world is still published while it catches up
NO_BODIES = np.zeros((3, 0))
MOST_STRANGERS = 1_000  # robots followed only because messages named them; senders can use any id
LOST = 1_000_000  # us; a real robot without newer messages leaves the world
NOBODY = Robots.of([])
USUAL_BASE_WIDTH = 0.16  # m; of real robots whose parameters are not known yet


@dataclass(frozen=True)
class VirtualRobot:
    """A virtual robot: where it starts [m, m, rad; world frame], its behaviour, and the robot whose parameters it uses.

    `radius` [m] is that of its collision disc; the default follows from the base width.
    """

    robot_id: int
    behaviour: AnyBehaviour
    parameters_of: int
    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0
    radius: float | None = None

    def at_rest(self) -> Robot:
        """Return the robot at rest at its start."""
        return Robot(0, self.robot_id, VIRTUAL, RobotState.at_rest(self.x, self.y, wrap(self.theta)))


class World:
    """All robots. `follow` makes the parameter follower of a robot id; virtual robots follow their models.

    Real robots are discovered by their MOTOR_FEEDBACK_N or POSE_N; `estimates` says which ones belong to this world.
    Robots of other simulators, `others`, come on WORLD_STATE and are shown to behaviours.

    `ready` returns whether robots with certain parameters can be simulated without delay; until then, robots keep their
    old parameters, and new robots stand at their start. A virtual robot steers with the parameters of the robot it
    refers to, and moves with them as well, unless `own_parameters` has an entry for its id: then it moves differently
    from what its controller assumes.

    With `noise` virtual robots deviate from their models. Their decisions take effect `reaction` [s] later. Virtual
    robots that meet one another are pushed apart; real robots and `obstacles` cannot be pushed.
    """

    def __init__(
        self,
        virtual: list[VirtualRobot],
        follow: Callable[[int], ParameterFollower],
        ready: Callable[[RobotParameters], bool] = lambda _parameters: True,
        estimates: Callable[[int], bool] = lambda _robot_id: True,
        own_parameters: Mapping[int, RobotParameters] = MappingProxyType({}),
        obstacles: Obstacles | None = None,
        noise: ProcessNoise | None = None,
        reaction: float = 0.0,
    ) -> None:
        self.view = WorldView()
        self.estop = EmergencyStop()
        self.gate = Gate(world_state_t)  # whose stamps `others` checks
        self.parameters: dict[int, ParameterFollower] = {}
        self.remote_robots = RemoteRobots(robot.robot_id for robot in virtual)
        self.begun = True  # while false, simulated robots stand
        self.crowded = False  # whether messages named more robots than are followed
        self._time = 0  # time of the last turn [us]
        self.late_steps = 0  # steps made more than a step late, or skipped
        self._follow, self._ready, self._estimates = follow, ready, estimates
        self._own_parameters = own_parameters
        self._noise = noise
        self._reaction = Reaction(reaction)
        self._kinds = list({frozenset(own.effects): own for own in own_parameters.values()}.values())
        self._models: dict[int, RobotParameters] = {}  # in use, by robot id
        self._not_ready: set[int] = set()
        self._virtual = {robot.robot_id: robot for robot in virtual}
        self._absent = {
            robot_id: Robots.of(robot.at_rest() for robot in virtual if robot.parameters_of == robot_id)
            for robot_id in {robot.parameters_of for robot in virtual}
        }
        self._real: dict[int, RealRobot] = {}
        self.view.obstacles = obstacles or Obstacles.none()
        self._fleet = Fleet(self.view.obstacles, {v.robot_id: v.radius for v in virtual if v.radius is not None})
        self._deciding: Deciding | None = None
        self._models_changed = False
        for robot in virtual:
            self._parameters_of(robot.parameters_of)
        self._needed = frozenset(self.parameters)

    @property
    def utime(self) -> int:
        """The time [us] of the simulated robots' states; 0 before the first step."""
        return self._fleet.utime

    @property
    def noise_problem(self) -> str:
        """Why some virtual robots have no noise; empty if all have it, or none should."""
        return self._noise.problem if self._noise else ""

    @property
    def virtual_ids(self) -> list[int]:
        """The ids of the virtual robots."""
        return sorted(self._virtual)

    @property
    def real_robots(self) -> list[int]:
        """The ids of the real robots known so far."""
        return sorted(self._real)

    def turn(self, utime: int) -> None:
        """Set the time to `utime` [us]; call this before handling messages that may have been queued."""
        self.gate.turn(utime)

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle one message from the bus or a log; `gate` refuses impossible ones."""
        self.estop.handle(utime, channel, message)
        usable = self.gate.let_in(channel, message)
        if isinstance(usable, world_state_t):
            self._take_others(usable)
        _, robot_id = identify(channel) or (None, None)
        if usable is not None and robot_id is not None:
            self._take(utime, channel, robot_id, usable)

    def _take(self, utime: int, channel: str, robot_id: int, message: Message) -> None:
        """Handle a message of one robot."""
        if isinstance(message, (parameters_t, *MEASURED)) and not self._takes_in(robot_id):
            return
        if isinstance(message, parameters_t):
            if self._parameters_of(robot_id).handle(utime, channel, message):
                self._take_over(robot_id)
        elif robot_id in self._virtual:
            self._handle_virtual(robot_id, channel, message)
        elif isinstance(message, MEASURED) and self._estimates(robot_id):
            self.gate.refuse(channel, self._real_robot(robot_id).handle(utime, channel, message))
        elif isinstance(message, COMMANDS) and robot_id in self._real:
            duties = duties_of(message, self._controller_of(robot_id))
            if duties is not None:
                self._real[robot_id].commands.take(utime, *duties)

    def poll_parameters(self) -> None:
        """Check for replaced parameter files. No robot's state changes."""
        for robot_id in [robot_id for robot_id, follower in self.parameters.items() if follower.poll()]:
            self._take_over(robot_id)

    def advance(self, utime: int) -> None:
        """Advance simulated robots to `utime` [us] in steps of 10 ms; behaviours decide at each step.

        At most ten steps are made in one call: a world delayed by more catches up in the next calls. Of many robots
        with behaviours of their own, each decides at every second, third, ... step (`deciding`).
        """
        self._time = utime
        self.gate.turn(utime)
        for robot_id in sorted(self._not_ready):
            self._take_over(robot_id)
        if self.crowded:
            self._forget_the_silent()
        self._place_virtual()
        for _ in range(MOST_STEPS_AT_ONCE):
            before = self._fleet.utime
            self._fleet.standing = self._bodies_of_real()
            if not self._fleet.advance(utime):
                return
            now = self._fleet.utime
            left_out = (now - before) // STEP - 1 if before else 0
            self.late_steps += max(left_out, 0) + (utime - now > STEP)
            self.view.take(now, self._fleet.robots())
            for robots in self._standing():
                self.view.take(now, robots)
            for robot in self.real():
                self.view.put(robot)
            for robot_id, real in self._real.items():
                self._begin_drive(robot_id, real, now)
            self._decide(now)

    def everybody(self) -> Robots:
        """Return all robots of the world as they are now; real robots without recent messages are omitted."""
        everybody = Robots.of(self.real()) if self._real else NOBODY
        for robots in (*self._standing(), self._fleet.robots()):
            everybody = everybody.with_others(robots)
        return everybody

    def bodies(self) -> Bodies:
        """Return all robots but twins as discs, those of other simulators included."""
        own, others, simulated = self.everybody(), self.remote_robots.robots(self._time), self._fleet.radius
        everybody, count, real = own.with_others(others), len(own.robot_id), self._bodies_of_real()[2]
        radius = np.full(len(everybody.robot_id), body_radius(USUAL_BASE_WIDTH))
        radius[: len(real)] = real
        radius[count - len(simulated) : count] = simulated
        robot_id, origin = np.array(everybody.robot_id, np.int64), np.array(everybody.origin, np.int64)
        there = origin != TWIN
        pose = np.array(everybody.state[:3])[:, there]
        return Bodies(robot_id[there], origin[there], (np.arange(len(radius)) < count)[there], pose, radius[there])

    def robots(self) -> list[Robot]:
        """Return the same as `everybody`, one by one."""
        simulated = (*self._standing(), self._fleet.robots())
        return [*self.real(), *chain.from_iterable(robots.each(self._fleet.utime) for robots in simulated)]

    def waiting(self) -> list[str]:
        """Return sentences about parameters that wait until a real robot rests."""
        return [sentence for _, real in sorted(self._real.items()) if (sentence := real.waiting())]

    def resets(self) -> dict[int, Reset]:
        """Return the last reset of each real robot's estimate, by robot."""
        return {k: real.estimator.reset for k, real in self._real.items() if real.estimator.reset is not None}

    def real(self) -> list[Robot]:
        """Return the known real robots with recent messages, without those whose clocks are off by more than LOST."""
        return [
            Robot(robot.estimator.utime, robot_id, REAL, robot.estimator.state)
            for robot_id, robot in self._real.items()
            if robot.estimator.known and abs(self._fleet.utime - robot.estimator.utime) <= LOST
        ]

    def _bodies_of_real(self) -> Floats:
        """Return x, y and radius [m] of the real robots with recent messages, (3, m)."""
        bodies = []
        for robot in self.real():
            parameters = self._real[robot.robot_id].estimator.parameters
            base_width = parameters.base_width if parameters else USUAL_BASE_WIDTH
            bodies.append((robot.state.x, robot.state.y, body_radius(base_width)))
        return np.array(bodies, dtype=float).reshape(-1, 3).T if bodies else NO_BODIES

    def _take_others(self, message: world_state_t) -> None:
        """Show another simulator's robots; before the first turn the time is unknown."""
        news = self.remote_robots.handle(self._time, message) if self._time else None
        if news is not None:
            self.view.take(message.utime, news)

    def _standing(self) -> list[Robots]:
        """Return the virtual robots whose parameters are known but not ready yet: they stand where they start."""
        return [robots for robot_id, robots in self._absent.items() if robot_id in self._not_ready]

    def _takes_in(self, robot_id: int) -> bool:
        """Return whether a robot is followed, or starts to be."""
        if robot_id in self.parameters or robot_id in self._virtual or robot_id in self._real:
            return True
        if not self._estimates(robot_id):
            return False
        self.crowded = len(self.parameters) >= len(self._needed) + MOST_STRANGERS
        return not self.crowded

    def _forget_the_silent(self) -> None:
        """Make room by forgetting robots that have no parameters and send no messages any more."""
        unknown = {robot_id for robot_id, follower in self.parameters.items() if follower.parameters is None}
        for robot_id in unknown.difference(self._needed, (robot.robot_id for robot in self.real())):
            del self.parameters[robot_id]
            self._real.pop(robot_id, None)
            self.remote_robots.leave(robot_id)
            self.crowded = False

    def _real_robot(self, robot_id: int) -> RealRobot:
        if robot_id not in self._real:
            self._real[robot_id] = RealRobot(robot_id)
            self.remote_robots.claim(robot_id)
            self._parameters_of(robot_id)
            self._take_over(robot_id)
        return self._real[robot_id]

    def _parameters_of(self, robot_id: int) -> ParameterFollower:
        if robot_id not in self.parameters:
            self.parameters[robot_id] = self._follow(robot_id)
            self._take_over(robot_id)
        return self.parameters[robot_id]

    def _take_over(self, robot_id: int) -> None:
        """Switch all robots that use this robot's parameters to the current ones, as soon as they are ready."""
        parameters = self.parameters[robot_id].parameters
        try:
            model = parameters.robot_parameters if parameters else None
        except ParameterFileError:
            model = None  # incomplete
        if model is None:
            return
        if robot_id in self._real:
            self._real[robot_id].use(model)
        ready = [self._ready(one) for one in (model, *self._kinds)]  # all of them start loading
        if not all(ready):
            self._not_ready.add(robot_id)
            return
        self._not_ready.discard(robot_id)
        self._models[robot_id], self._models_changed = model, True
        if self._noise and parameters and any(v.parameters_of == robot_id for v in self._virtual.values()):
            self._noise.use(robot_id, parameters)
        virtual = ((v.robot_id, VIRTUAL) for v in self._virtual.values() if v.parameters_of == robot_id)
        followers = [key for key in ((robot_id, TWIN), *virtual) if key in self._fleet]
        if followers:
            self._fleet.set_parameters(followers, self._moving_by(followers, model))

    def _place_virtual(self) -> None:
        """Place the virtual robots whose parameters are known by now."""
        for robot_id in self._absent.keys() & self._models.keys():
            robots = self._absent.pop(robot_id)
            keys = list(zip(robots.robot_id, robots.origin, strict=True))
            self._fleet.place(keys, robots.state, self._moving_by(keys, self._models[robot_id]))

    def _moving_by(self, keys: Sequence[Key], model: RobotParameters) -> RobotParameters:
        """Return the parameters of these robots: their own, otherwise `model`."""
        if self._own_parameters.keys().isdisjoint(robot_id for robot_id, origin in keys if origin == VIRTUAL):
            return model
        from cmr.model.catalogue import together  # robots of the paper's model do not need the catalogue

        own = self._own_parameters
        return together([model if origin == TWIN else own.get(robot_id, model) for robot_id, origin in keys])

    def _handle_virtual(self, robot_id: int, channel: str, message: Message) -> None:
        behaviour, me = self._virtual[robot_id].behaviour, self.view.robot(robot_id)
        if isinstance(message, waypoints_t) and me is not None and is_out_of_reach(message, me.state.x, me.state.y):
            self.gate.refuse(channel, OUT_OF_REACH)
        elif isinstance(message, waypoints_t):
            if isinstance(behaviour, TeamBehaviour):
                behaviour.take_waypoints(robot_id, list(message.x), list(message.y))
            else:
                behaviour.take_waypoints(list(message.x), list(message.y))
        elif isinstance(message, COMMANDS) and isinstance(behaviour, Behaviour):
            duties = duties_of(message, self._controller_of(self._virtual[robot_id].parameters_of))
            if duties is not None:
                behaviour.take_command(message.utime, *duties)

    def _controller_of(self, robot_id: int) -> VelocityController | None:
        """Return the controller that turns a robot's commands into wheel speeds; None for duties, or if unknown."""
        parameters = self.parameters[robot_id].parameters if robot_id in self.parameters else None
        try:
            return parameters.velocity_controller if parameters else None
        except ParameterFileError:
            return None  # incomplete

    def _begin_drive(self, robot_id: int, real: RealRobot, utime: int) -> None:
        """At the beginning of each drive, place a real robot's twin at the robot."""
        if not any(self._command_of(robot_id, real, utime)):
            return
        begins = utime - real.last_driven > REST_BEFORE_DRIVE
        model = self._models.get(robot_id)
        if model is not None and real.estimator.utime and (begins or (robot_id, TWIN) not in self._fleet):
            start = RobotState(*(np.array([value]) for value in real.estimator.state))
            self._fleet.place([(robot_id, TWIN)], start, model)
        real.last_driven = utime

    def _command_of(self, robot_id: int, real: RealRobot, utime: int) -> tuple[float, float]:
        return (0.0, 0.0) if self.estop.holds(robot_id) else real.commands.at(utime)

    def _decide(self, utime: int) -> None:
        """Set the duties of simulated robots from their behaviours, and of twins from their robots' commands."""
        robots = self._fleet.robots()
        if not (robots.robot_id and self.begun):
            return
        if self._deciding is None or self._deciding.robot_id is not robots.robot_id or self._models_changed:
            behaviours = {robot_id: robot.behaviour for robot_id, robot in self._virtual.items()}
            self._deciding = Deciding(robots, behaviours, self._model_of, self._command_of_twin, self._deciding)
            self._models_changed = False
        duties = self._reaction.late(self._deciding.duties(utime, utime // STEP, robots, self.view), robots)
        if self._noise:
            duties = self._noise.disturbed(duties, robots, lambda robot_id: self._virtual[robot_id].parameters_of)
        self._fleet.command(0, duties)

    def _model_of(self, robot_id: int) -> RobotParameters:
        return self._models[self._virtual[robot_id].parameters_of]

    def _command_of_twin(self, robot_id: int, utime: int) -> tuple[float, float]:
        return self._command_of(robot_id, self._real[robot_id], utime)
