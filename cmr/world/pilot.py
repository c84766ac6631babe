"""Drive a real robot by a behaviour, from what WORLD_STATE says of the world."""

from typing import Any

from cmr.bus.estop import EmergencyStop
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import MOTOR_FEEDBACK, PARAMETERS, WAYPOINTS, WORLD_STATE
from cmr.msg import motor_command_t, motor_feedback_t
from cmr.parameters.file import ParameterFileError
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour
from cmr.world.view import WorldView

OLDEST_WORLD = 500_000  # us; with older knowledge of the world the robot stops
FIRST_ZEROS = 10  # commands; a driver takes nothing else before one, and any message may be lost


class Pilot:
    """The pilot of one real robot; `waiting_for` says what keeps it from driving, empty when nothing does."""

    def __init__(self, robot_id: int, behaviour: Behaviour, parameters: ParameterFollower) -> None:
        self.robot_id = robot_id
        self.behaviour = behaviour
        self.parameters = parameters
        self.waiting_for = "the world"
        self._world = WorldView()
        self._estop = EmergencyStop()
        self._zeros_to_send = 0

    def handle(self, utime: int, channel: str, message: Any) -> None:
        """Take WORLD_STATE, MOTOR_FEEDBACK_N, PARAMETERS_N, WAYPOINTS_N or ESTOP."""
        self._estop.handle(utime, channel, message)
        if channel == WORLD_STATE.name:
            self._world.handle(utime, channel, message)
        elif channel == MOTOR_FEEDBACK.channel(self.robot_id):
            if message.status & motor_feedback_t.STATUS_COMMAND_STALE:  # it may have been started just now
                self._zeros_to_send = FIRST_ZEROS
        elif channel == PARAMETERS.channel(self.robot_id):
            self.parameters.handle(utime, channel, message)
        elif channel == WAYPOINTS.channel(self.robot_id):
            self.behaviour.take_waypoints(list(message.x), list(message.y))

    def command(self, utime: int) -> Any:
        """Return the motor_command_t of this moment; zero whenever the robot must not, or need not, move."""
        return self._message(utime, *self._decide(utime))

    def stop(self) -> Any:
        """Return the motor_command_t that ends a drive."""
        return self._message(now_utime(), 0.0, 0.0)

    def _message(self, utime: int, left: float, right: float) -> Any:
        return make(motor_command_t, utime=utime, robot_id=self.robot_id, left=left, right=right)

    def _decide(self, utime: int) -> tuple[float, float]:
        me = self._world.robot(self.robot_id)
        if self._estop.engaged:
            self.waiting_for = f"release of the emergency stop ({self._estop.reason})"
            self._zeros_to_send = FIRST_ZEROS
        elif self._zeros_to_send:
            self.waiting_for = "the driver to hear of zero, after its start or an emergency stop"
            self._zeros_to_send -= 1
        elif me is None or utime - me.utime > OLDEST_WORLD:
            self.waiting_for = f"robot {self.robot_id} in WORLD_STATE (from cmr-sim and its driver)"
        elif self.parameters.parameters is None:
            self.waiting_for = f"parameters of robot {self.robot_id}. {self.parameters.message}"
        else:
            try:
                model = self.parameters.parameters.robot_parameters
            except ParameterFileError as error:
                self.waiting_for = f"complete parameters of robot {self.robot_id}: {error}"
            else:
                self.waiting_for = ""
                return self.behaviour.command(utime, me, self._world, model)
        return 0.0, 0.0
