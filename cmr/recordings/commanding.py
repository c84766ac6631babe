"""Command messages of all kinds, and the equivalent duties.

The conversion of commanded speeds depends on the robot's own velocity controller.
"""

from cmr.bus.messages import make
from cmr.model.command_kinds import DUTY, WHEEL_SPEED
from cmr.model.velocity_controller import VelocityController
from cmr.msg import motor_command_t, velocity_command_t, wheel_speed_command_t
from cmr.recordings.arrivals import Command

COMMANDS = (motor_command_t, wheel_speed_command_t, velocity_command_t)  # the types of a Command


def asked_by(command: Command) -> tuple[float, float]:
    """Return the two numbers of a command: duties, or wheel speeds [rad/s], of left and right, or v and omega."""
    if isinstance(command, motor_command_t):
        return command.left, command.right
    if isinstance(command, wheel_speed_command_t):
        return command.psi_left, command.psi_right
    return command.v, command.omega


def duties_of(command: Command, controller: VelocityController | None) -> tuple[float, float] | None:
    """Return the duties (left, right) equivalent to a command.

    None if speeds are commanded and no controller is known for the conversion.
    """
    if isinstance(command, motor_command_t):
        return command.left, command.right
    if controller is None:
        return None
    of_wheels = isinstance(command, wheel_speed_command_t)
    left, right = (controller.duties if of_wheels else controller.duties_of_body)(*asked_by(command))
    return float(left), float(right)


def asks_to_move(command: Command) -> bool:
    """Return whether a command is other than to stand."""
    return any(asked_by(command))


def command_of(
    kind: str, utime: int, robot_id: int, duties: tuple[float, float], controller: VelocityController | None
) -> Command:
    """Return the message of a kind that is equivalent to these duties; zero is zero for every kind.

    Speeds other than zero need the robot's velocity controller.
    """
    if kind == DUTY:
        return make(motor_command_t, utime=utime, robot_id=robot_id, left=float(duties[0]), right=float(duties[1]))
    values = (0.0, 0.0)
    if controller is not None:
        values = (controller.wheel_speeds if kind == WHEEL_SPEED else controller.body_velocity)(*duties)
    first, second = map(float, values)
    if kind == WHEEL_SPEED:
        return make(wheel_speed_command_t, utime=utime, robot_id=robot_id, psi_left=first, psi_right=second)
    return make(velocity_command_t, utime=utime, robot_id=robot_id, v=first, omega=second)
