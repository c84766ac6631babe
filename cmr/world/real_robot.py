"""The world's data on a real robot."""

from cmr.bus.message import Message
from cmr.model.parameters import RobotParameters
from cmr.msg import motor_feedback_t
from cmr.parameters.caution import Caution, motion_of
from cmr.world.commands import CommandMemory
from cmr.world.estimator import Estimator


class RealRobot:
    """The estimate of a real robot, and its command.

    Parameters that change the motion per wheel rotation considerably are used only once the robot rests.
    """

    def __init__(self, robot_id: int) -> None:
        self.estimator = Estimator(robot_id)
        self.commands = CommandMemory()
        self.last_driven = 0
        self._caution = Caution[RobotParameters](motion_of)

    def handle(self, utime: int, channel: str, message: Message) -> str:
        """Handle MOTOR_FEEDBACK_N, GYRO_N or POSE_N; return why it was not used, empty if it was."""
        unused = self.estimator.handle(utime, channel, message)
        if isinstance(message, motor_feedback_t) and not unused:
            self._caution.note_motion(message.utime, message.psi_left, message.psi_right)
            self.estimator.parameters = self._caution.now
        return unused

    def use(self, model: RobotParameters) -> None:
        """Set the parameters of the estimate, at once or at rest."""
        self._caution.offer(model)
        self.estimator.parameters = self._caution.now

    def waiting(self) -> str:
        """Return a sentence if parameters wait until the robot rests; otherwise empty."""
        now, waiting = self._caution.values()
        if not waiting:
            return ""
        me = self.estimator.robot_id
        return (
            f"New parameters of robot {me} are used by its twin, and when it rests by its estimate: "
            f"they change its way from {now[0]:.4g} m to {waiting[0]:.4g} m per rad of both wheels, and its turn from "
            f"{now[1]:.4g} rad to {waiting[1]:.4g} rad per rad against each other."
        )
