"""The duties that were sent to a controller, and those of them that nobody would else hear of."""

from collections.abc import Callable
from typing import Any, NamedTuple

from cmr.bus.messages import make
from cmr.msg import motor_duty_t


class SentDuty(NamedTuple):
    """The duty of each side, forward positive, and when it was sent [us since the Unix epoch]."""

    left: float
    right: float
    utime: int


class SentDuties:
    """Publishes, as motor_duty_t, the duties that may have been in force although no feedback tells them."""

    def __init__(self, robot_id: int, publish: Callable[[Any], None]) -> None:
        self._robot_id = robot_id
        self._publish = publish
        self._untold: list[SentDuty] = []

    def add(self, duty: SentDuty) -> None:
        """Note that a duty was sent."""
        self._untold.append(duty)

    def tell_all_but(self, told: SentDuty) -> None:
        """Publish what was sent since the last call, but the duty that a feedback tells."""
        for duty in self._untold:
            if duty is not told:
                left, right = float(duty.left), float(duty.right)
                message = make(
                    motor_duty_t, utime=duty.utime, robot_id=self._robot_id, sent_left=left, sent_right=right
                )
                self._publish(message)
        self._untold.clear()
