"""Drive a real robot by a behaviour, using WORLD_STATE."""

import math
from collections.abc import Iterable

from cmr.bus.estop import EmergencyStop
from cmr.bus.gate import Gate
from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.possible import OUT_OF_REACH, is_out_of_reach
from cmr.bus.streams import Stream, identify
from cmr.geometry.obstacles import Geofence
from cmr.model.body import forward
from cmr.model.command_kinds import DUTY, VELOCITY
from cmr.model.parameters import RobotParameters
from cmr.msg import gyro_t, motor_feedback_t, parameters_t, pose_xyt_t, waypoints_t, world_state_t
from cmr.parameters.caution import SPEED, TURN_RATE, Caution, duties_for
from cmr.parameters.file import ParameterFile, ParameterFileError
from cmr.parameters.following import ParameterFollower
from cmr.recordings.arrivals import Command
from cmr.recordings.commanding import command_of
from cmr.world.behaviours import AnyBehaviour, Behaviour, TeamBehaviour
from cmr.world.behaviours.team import Alone
from cmr.world.guarding import MARGIN, FenceGuard, PoseGuard, kept_clear, load
from cmr.world.view import VIRTUAL, Robot, WorldView

OLDEST_WORLD = 500_000  # us; with an older WORLD_STATE the robot stops
OTHER_KIND = (
    "another --command than {kind}, or other parameters of robot {robot}: with top_wheel_speed they are of a robot "
    "that takes velocities or wheel speeds, with k1 of one that takes duties"
)
WAITING = (
    "New parameters of robot {robot} wait until it rests: they change the duty for {speed:g} m/s from {now[0]:.3f} to "
    "{new[0]:.3f}, and that for turning at {turn:g} rad/s from {now[1]:.3f} to {new[1]:.3f}."
)
UNUSABLE = "New parameters of robot {robot} wait until it rests, as it cannot be driven by them in the same way."
AN_ACCEPTED_ZERO = "cmr-driver to accept a zero command (needed after start-up and after an emergency stop)"
FIRST_ZEROS = 10  # commands; a driver first needs a zero, and any message may be lost


class Pilot:
    """The pilot of one robot; `waiting_for` says what keeps it from driving, empty if nothing does.

    With a `geofence` it drives only inside, at least `margin` [m] from the border. If it leaves, it stops for good, and
    `left_fence` says so; after a single outside pose far from the estimate, it stops for half a second. With a
    geofence, or once poses were received, it stops while poses are missing; a virtual robot has no poses, and
    WORLD_STATE is used instead. With `keep_clear` it stops before real and virtual robots in its way. `kind` of
    cmr.model.command_kinds is the kind of command; by default (v, omega) for a robot whose parameters have a velocity
    controller, duties for others. `program` is the name of the command to restart, for messages.
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
        program: str = "cmr-pilot",
    ) -> None:
        self.robot_id = robot_id
        self._program = program
        self.behaviour = Alone(behaviour, robot_id) if isinstance(behaviour, TeamBehaviour) else behaviour
        self.parameters = parameters
        self.waiting_for = "the world"
        self.begun = True  # while false, the robot stands and reports no reason for waiting
        self.duties = (0.0, 0.0)  # equivalent to the last command
        self.gate = Gate(pose_xyt_t)  # whose stamps `_poses` checks
        self._keep_clear = keep_clear
        self._fence = FenceGuard(robot_id, geofence, margin, program) if geofence else None
        self._poses = PoseGuard(robot_id, needed=geofence is not None)
        self._world = WorldView()
        self._world.geofence = geofence
        self._estop = EmergencyStop()
        self._zeros_to_send = 0
        self._kind = kind
        self._caution = Caution[ParameterFile](_duties_of)
        self._sha256 = ""
        self._look_at_parameters()

    @property
    def me(self) -> Robot | None:
        """The robot in WORLD_STATE; None if it is not there."""
        return self._world.robot(self.robot_id)

    @property
    def model(self) -> RobotParameters | None:
        """The robot's parameters in use; None if they are missing."""
        return self._model()[0]

    @property
    def estop_reason(self) -> str:
        """Who stopped this robot by emergency stop, and why; empty if nobody did."""
        return self._estop.reason if self._estop.holds(self.robot_id) else ""

    @property
    def fence(self) -> tuple[float, float] | None:
        """The robot's distance [m] from the border of its geofence, and the margin; None without a geofence or a
        position.
        """
        return self._fence.kept if self._fence else None

    @property
    def left_fence(self) -> str:
        """A sentence on where the robot left its geofence; empty if it did not."""
        return self._fence.left if self._fence else ""

    def prepare(self) -> None:
        """Load what the behaviour needs, which may take seconds; call it while no robot waits for a command."""
        self.behaviour.prepare()
        if self._keep_clear:
            load()

    def turn(self, utime: int) -> None:
        """Set the time to `utime` [us]; call this before handling messages."""
        self.gate.turn(utime)

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle WORLD_STATE, POSE_N, MOTOR_FEEDBACK_N, GYRO_N, PARAMETERS_N, WAYPOINTS_N, ESTOP or ESTOP_LATCH_N.

        Impossible numbers are rejected; `gate` reports them.
        """
        _, robot_id = identify(channel) or (None, None)
        self._estop.handle(utime, channel, message)
        if robot_id not in (None, self.robot_id):
            return
        usable = self.gate.let_in(channel, message)
        if isinstance(usable, motor_feedback_t | gyro_t | pose_xyt_t) and isinstance(self.behaviour, Behaviour):
            self.behaviour.hear(utime, channel, usable)
        if isinstance(usable, world_state_t):
            self._world.handle(utime, channel, usable)
        elif isinstance(usable, pose_xyt_t):
            self._take_pose(usable)
        elif isinstance(usable, motor_feedback_t):
            if usable.status & motor_feedback_t.STATUS_COMMAND_STALE:  # the driver may just have started
                self._zeros_to_send = FIRST_ZEROS
        elif isinstance(usable, parameters_t):
            self.parameters.handle(utime, channel, usable)
        elif isinstance(usable, waypoints_t):
            self._take_path(channel, usable)

    def _take_pose(self, pose: pose_xyt_t) -> None:
        now = self.gate.now
        if self._poses.take(pose, now) and self._fence is not None:
            me = self._world.robot(self.robot_id)
            is_known = me is not None and abs(now - me.utime) <= OLDEST_WORLD
            estimated = (me.state.x, me.state.y) if me is not None and is_known else None
            self._fence.look_at_pose(pose.x, pose.y, estimated, now)

    def _take_path(self, channel: str, path: waypoints_t) -> None:
        me = self._world.robot(self.robot_id)
        if me is not None and is_out_of_reach(path, me.state.x, me.state.y):
            self.gate.refuse(channel, OUT_OF_REACH)
        else:
            self.behaviour.take_waypoints(list(path.x), list(path.y))

    @property
    def parameters_sha256(self) -> str:
        """The digest of the parameters in use."""
        return self._sha256

    @property
    def new_parameters(self) -> str:
        """A sentence on parameters that wait until the robot rests, with both duties; empty if there are none."""
        now, new = self._caution.values()
        if self._caution.waiting is None:
            return ""
        text = WAITING if now and new and now[2] == new[2] else UNUSABLE
        return text.format(robot=self.robot_id, speed=SPEED, turn=TURN_RATE, now=now, new=new)

    def confirm_parameters(self) -> None:
        """Use the waiting parameters, as confirmed by a person."""
        self._caution.confirm()
        self._look_at_parameters()

    def _look_at_parameters(self) -> None:
        """Take over the newest parameters, unless they must wait."""
        newest = self.parameters.parameters
        if newest is not None:
            if newest is not self._caution.now:
                self._caution.offer(newest)
            if newest is self._caution.now:
                self._sha256 = self.parameters.sha256

    @property
    def kind(self) -> str:
        """The kind of command, of cmr.model.command_kinds."""
        self._look_at_parameters()
        known = self._caution.now
        return self._kind or (VELOCITY if known is not None and known.has_velocity_controller else DUTY)

    def command(self, utime: int) -> Command:
        """Return the current command, of this `kind`; zero whenever the robot must not, or need not, move."""
        self.turn(utime)
        self._look_at_parameters()
        self.duties = self._decide(utime)
        known = self._caution.now
        controller = known.velocity_controller if known is not None and any(self.duties) else None
        return command_of(self.kind, utime, self.robot_id, self.duties, controller)

    def tell(self, utime: int) -> Iterable[tuple[Stream[Message], Message]]:
        """Return the behaviour's messages besides the command."""
        return self.behaviour.tell(utime)

    def stop(self) -> Command:
        """Return the command that ends a drive."""
        return command_of(self.kind, now_utime(), self.robot_id, (0.0, 0.0), None)

    def _decide(self, utime: int) -> tuple[float, float]:
        me = self._world.robot(self.robot_id)
        if me is not None:
            self._caution.note_motion(me.utime, me.state.psi_left, me.state.psi_right)
        model, without_model = self._model()
        is_virtual = me is not None and me.origin == VIRTUAL
        in_doubt = self._fence.doubt(utime) if self._fence else ""
        without_poses = "" if is_virtual else self._poses.missing(utime) or in_doubt
        self._look_at_fence(me, model)
        if self.left_fence:
            self.waiting_for = f"a new start of {self._program}"
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
        """Return the behaviour's duties, limited by robots in the way."""
        self.waiting_for = ""
        if not self.begun:
            return 0.0, 0.0
        duties = self.behaviour.command(utime, me, self._world, model)
        if not all(map(math.isfinite, duties)):
            self.waiting_for = f"its behaviour to decide on numbers, not on {duties}"
            return 0.0, 0.0
        if self._keep_clear:
            duties, self.waiting_for = kept_clear(me, self._world, model, duties)
        return duties

    def _model(self) -> tuple[RobotParameters | None, str]:
        """Return the robot's parameters in use, or what is missing."""
        known = self._caution.now
        if known is None:
            return None, f"parameters of robot {self.robot_id}. {self.parameters.message.removesuffix('.')}"
        try:
            if known.has_velocity_controller != (self.kind != DUTY):
                return None, OTHER_KIND.format(kind=self.kind, robot=self.robot_id)
            return known.robot_parameters, ""
        except ParameterFileError as error:
            return None, f"complete parameters of robot {self.robot_id}: {error}"

    def _look_at_fence(self, me: Robot | None, model: RobotParameters | None) -> None:
        """Check the estimated position and velocity against the geofence, once there are poses; a virtual robot has
        none.
        """
        if self._fence is None or me is None:
            return
        if self._poses.heard or me.origin == VIRTUAL:
            speed = float(forward(me.state.psi_left, me.state.psi_right, model)) if model else 0.0
            going = (speed * math.cos(me.state.theta), speed * math.sin(me.state.theta))
            self._fence.look(me.state.x, me.state.y, going)


def _duties_of(parameters: ParameterFile) -> tuple[float, ...] | None:
    """Return the duties for two reference speeds, and the kind of command; None if something is missing."""
    try:
        return (*duties_for(parameters.robot_parameters), 1.0 + parameters.has_velocity_controller)
    except ParameterFileError:
        return None
