"""Commands as a robot obeys them: the newest one counts, for half a second, of whichever kind it is.

Simulated robots are driven by duties. What commanded speeds stand for says the robot's own velocity controller.
"""

import math
from typing import Any

from cmr.bus.messages import make
from cmr.bus.streams import COMMAND_LIFETIME, MOTOR_COMMAND, VELOCITY_COMMAND, WHEEL_SPEED_COMMAND, Stream
from cmr.model.command_kinds import DUTY, WHEEL_SPEED
from cmr.model.velocity_controller import VelocityController
from cmr.recordings.arrivals import COMMANDS_OF

TAKEN = tuple(COMMANDS_OF.values())  # streams of commands
FIELDS = {
    MOTOR_COMMAND.name: ("left", "right"),
    WHEEL_SPEED_COMMAND.name: ("psi_left", "psi_right"),
    VELOCITY_COMMAND.name: ("v", "omega"),
}


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


class CommandMemory:
    """The newest motor command of one robot."""

    def __init__(self) -> None:
        self._command = (0, 0.0, 0.0)

    def take(self, utime: int, left: float, right: float) -> None:
        """Take a command decided at `utime` [us].

        One that is no number, or a little older than the last, is passed over; one that is older by more than a
        command's lifetime comes from another clock, and counts.
        """
        in_order = not 0 < self._command[0] - utime <= COMMAND_LIFETIME
        if in_order and math.isfinite(left) and math.isfinite(right):
            self._command = (utime, left, right)

    def at(self, utime: int) -> tuple[float, float]:
        """Return the duties (left, right) in force at `utime` [us]."""
        decided, left, right = self._command
        return (left, right) if abs(utime - decided) <= COMMAND_LIFETIME else (0.0, 0.0)
