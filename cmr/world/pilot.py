"""Drive a real robot by a behaviour, from what WORLD_STATE says of the world."""

import math

from cmr.bus.estop import EmergencyStop
from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.streams import identify
from cmr.geometry.obstacles import Geofence
from cmr.model.body import forward
from cmr.model.command_kinds import DUTY, VELOCITY
from cmr.model.parameters import RobotParameters
from cmr.msg import motor_feedback_t, parameters_t, pose_xyt_t, waypoints_t, world_state_t
from cmr.parameters.file import ParameterFileError
from cmr.parameters.following import ParameterFollower
from cmr.recordings.arrivals import Command
from cmr.recordings.commanding import command_of
from cmr.world.behaviours import AnyBehaviour, TeamBehaviour
from cmr.world.behaviours.team import Alone
from cmr.world.guarding import MARGIN, FenceGuard, PoseGuard, kept_clear, load
from cmr.world.view import Robot, WorldView

OLDEST_WORLD = 500_000  # us; with older knowledge of the world the robot stops
OTHER_KIND = (
    "another --command than {kind}, or other parameters of robot {robot}: with top_wheel_speed they are of a robot "
    "that takes velocities or wheel speeds, with k1 of one that takes duties"
)
AN_ACCEPTED_ZERO = "cmr-driver to accept a zero command (needed after start-up and after an emergency stop)"
FIRST_ZEROS = 10  # commands; a driver takes nothing else before one, and any message may be lost


class Pilot:
    """The pilot of one real robot; `waiting_for` says what keeps it from driving, empty when nothing does.

    Inside of a `geofence`, `margin` [m] from its border, it drives; once it was elsewhere, it stands for good, as
    `left_fence` says. With a geofence, or once poses were heard, it stands while they are missing. With `keep_clear` it
    stops before robots in its way, real and virtual ones. `kind` of cmr.model.command_kinds is what it commands; by
    default (v, omega) to a robot whose parameters have a velocity controller, duties to others.
    """

    def __init__(
        self,
        robot_id: int,
        behaviour: AnyBehaviour,
        parameters: ParameterFollower,
        *,
        geofence: Geofence | None = None,
        margin: float = MARGIN,
        keep_clear: bool = True,
        kind: str | None = None,
    ) -> None:
        self.robot_id = robot_id
        self.behaviour = Alone(behaviour, robot_id) if isinstance(behaviour, TeamBehaviour) else behaviour
        self.parameters = parameters
        self.waiting_for = "the world"
        self._keep_clear = keep_clear
        self._fence = FenceGuard(robot_id, geofence, margin) if geofence else None
        self._poses = PoseGuard(robot_id, needed=geofence is not None)
        self._world = WorldView()
        self._world.geofence = geofence
        self._estop = EmergencyStop()
        self._zeros_to_send = 0
        self._kind = kind

    @property
    def left_fence(self) -> str:
        """The sentence that says where the robot left its geofence; empty while it did not."""
        return self._fence.left if self._fence else ""

    def prepare(self) -> None:
        """Load what deciding takes, which may take seconds: called where no robot waits for a command."""
        if isinstance(self.behaviour, Alone):
            self.behaviour.prepare()
        if self._keep_clear:
            load()

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Take WORLD_STATE, POSE_N, MOTOR_FEEDBACK_N, PARAMETERS_N, WAYPOINTS_N, ESTOP or ESTOP_LATCH_N."""
        _, robot_id = identify(channel) or (None, None)
        self._estop.handle(utime, channel, message)
        if isinstance(message, world_state_t):
            self._world.handle(utime, channel, message)
        elif robot_id != self.robot_id:
            return
        elif isinstance(message, pose_xyt_t):
            self._poses.take(message)
        elif isinstance(message, motor_feedback_t):
            if message.status & motor_feedback_t.STATUS_COMMAND_STALE:  # it may have been started just now
                self._zeros_to_send = FIRST_ZEROS
        elif isinstance(message, parameters_t):
            self.parameters.handle(utime, channel, message)
        elif isinstance(message, waypoints_t):
            self.behaviour.take_waypoints(list(message.x), list(message.y))

    @property
    def kind(self) -> str:
        """What the robot is commanded, of cmr.model.command_kinds."""
        known = self.parameters.parameters
        return self._kind or (VELOCITY if known is not None and known.has_velocity_controller else DUTY)

    def command(self, utime: int) -> Command:
        """Return the command of this moment, of this `kind`; zero whenever the robot must not, or need not, move."""
        duties = self._decide(utime)
        known = self.parameters.parameters
        controller = known.velocity_controller if known is not None and any(duties) else None
        return command_of(self.kind, utime, self.robot_id, duties, controller)

    def stop(self) -> Command:
        """Return the command that ends a drive."""
        return command_of(self.kind, now_utime(), self.robot_id, (0.0, 0.0), None)

    def _decide(self, utime: int) -> tuple[float, float]:
        me = self._world.robot(self.robot_id)
        model, without_model = self._model()
        without_poses = self._poses.missing(utime)
        self._look_at_fence(me, model)
        if self.left_fence:
            self.waiting_for = "a new start of cmr-pilot"
        elif self._estop.holds(self.robot_id):
            self.waiting_for = f"release of the emergency stop ({self._estop.reason})"
            self._zeros_to_send = FIRST_ZEROS
        elif self._zeros_to_send:
            self.waiting_for = AN_ACCEPTED_ZERO
            self._zeros_to_send -= 1
        elif me is None or utime - me.utime > OLDEST_WORLD:
            self.waiting_for = f"robot {self.robot_id} in WORLD_STATE (from cmr-sim and its driver)"
        elif without_poses or model is None:
            self.waiting_for = without_poses or without_model
        else:
            return self._drive(utime, me, model)
        return 0.0, 0.0

    def _drive(self, utime: int, me: Robot, model: RobotParameters) -> tuple[float, float]:
        """Return what the behaviour decides, as far as nothing is in the way."""
        self.waiting_for = ""
        duties = self.behaviour.command(utime, me, self._world, model)
        if not all(map(math.isfinite, duties)):
            self.waiting_for = f"its behaviour to decide on numbers, not on {duties}"
            return 0.0, 0.0
        if self._keep_clear:
            duties, self.waiting_for = kept_clear(me, self._world, model, duties)
        return duties

    def _model(self) -> tuple[RobotParameters | None, str]:
        """Return the robot's parameters, or what is missing of them."""
        if self.parameters.parameters is None:
            return None, f"parameters of robot {self.robot_id}. {self.parameters.message.removesuffix('.')}"
        try:
            if self.parameters.parameters.has_velocity_controller != (self.kind != DUTY):
                return None, OTHER_KIND.format(kind=self.kind, robot=self.robot_id)
            return self.parameters.parameters.robot_parameters, ""
        except ParameterFileError as error:
            return None, f"complete parameters of robot {self.robot_id}: {error}"

    def _look_at_fence(self, me: Robot | None, model: RobotParameters | None) -> None:
        """Look where the robot is by its newest pose, and where it is and goes by the world's estimate."""
        if self._fence is None:
            return
        if self._poses.place is not None:
            self._fence.look(*self._poses.place)
        if me is not None and self._poses.place is not None:
            speed = float(forward(me.state.psi_left, me.state.psi_right, model)) if model else 0.0
            going = (speed * math.cos(me.state.theta), speed * math.sin(me.state.theta))
            self._fence.look(me.state.x, me.state.y, going)
