"""Messages by which robots are commanded, of whichever kind, and the duties that they stand for.

What commanded speeds stand for says the robot's own velocity controller.
"""

from typing import Any

from cmr.bus.messages import make
from cmr.bus.streams import MOTOR_COMMAND, WHEEL_SPEED_COMMAND, Stream
from cmr.model.command_kinds import DUTY, WHEEL_SPEED
from cmr.model.velocity_controller import VelocityController
from cmr.recordings.arrivals import COMMAND_SIGNALS, COMMANDS_OF, KEPT

TAKEN = tuple(COMMANDS_OF.values())  # streams of commands
FIELDS = {KEPT[name].stream.name: KEPT[name].fields for name in COMMAND_SIGNALS}


def duties_of(stream: Stream, message: Any, controller: VelocityController | None) -> tuple[float, float] | None:
    """Return the duties (left, right) that a command stands for; `stream` is one of TAKEN.

    None where speeds are commanded and no controller is known that would turn them into anything.
    """
    if stream is MOTOR_COMMAND:
        return message.left, message.right
    if controller is None:
        return None
    told = (getattr(message, name) for name in FIELDS[stream.name])
    left, right = (controller.duties if stream is WHEEL_SPEED_COMMAND else controller.duties_of_body)(*told)
    return float(left), float(right)


def asks_to_move(stream: Stream, message: Any) -> bool:
    """Tell whether a command is another than to stand; `stream` is one of TAKEN."""
    return any(getattr(message, name) for name in FIELDS[stream.name])


def command_of(
    kind: str, utime: int, robot_id: int, duties: tuple[float, float], controller: VelocityController | None
) -> Any:
    """Return the message of a kind that stands for these duties; zero is zero whoever takes it.

    Speeds other than zero need the robot's velocity controller.
    """
    stream, values = COMMANDS_OF[kind], duties
    if kind != DUTY:
        values = (0.0, 0.0)
        if controller is not None:
            values = (controller.wheel_speeds if kind == WHEEL_SPEED else controller.body_velocity)(*duties)
    fields = dict(zip(FIELDS[stream.name], map(float, values), strict=True))
    return make(stream.message_type, utime=utime, robot_id=robot_id, **fields)
