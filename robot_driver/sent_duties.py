"""Publishes the duties that were sent to a controller but are in no feedback, because an answer was lost."""

from collections.abc import Callable
from typing import NamedTuple

from cmr.bus.messages import make
from cmr.msg import motor_duty_t


class SentDuty(NamedTuple):
    """The duty of each side, forward positive, and when it was sent [us since the Unix epoch]."""

    left: float
    right: float
    utime: int


class SentDuties:
    """Collects the duties that were sent; publishes those that no feedback contains, as motor_duty_t.

    The motors may have obeyed them although the controller's answer was lost.
    """

    def __init__(self, robot_id: int, publish: Callable[[motor_duty_t], None]) -> None:
        self._robot_id = robot_id
        self._publish = publish
        self._unreported: list[SentDuty] = []

    def add(self, duty: SentDuty) -> None:
        """Note that a duty was sent."""
        self._unreported.append(duty)

    def publish_all_but(self, reported: SentDuty) -> None:
        """Publish the duties sent since the last call, except the one that the next feedback contains."""
        for duty in self._unreported:
            if duty is not reported:
                left, right = float(duty.left), float(duty.right)
                message = make(
                    motor_duty_t, utime=duty.utime, robot_id=self._robot_id, sent_left=left, sent_right=right
                )
                self._publish(message)
        self._unreported.clear()
