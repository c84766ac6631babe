"""Feedback on a robot's motors: a motor_feedback_t from the encoders, the duty in force and slow readings.

Also a motor_duty_t for each duty that was sent to the controller but is in no feedback, because an answer was lost.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from cmr.bus.messages import make
from cmr.msg import motor_duty_t, motor_feedback_t
from robot_driver.clock import Stamps
from robot_driver.controllers import Telemetry
from robot_driver.encoders import WheelMotion, Wiring
from robot_driver.serial_port import Answer


class SentDuty(NamedTuple):
    """The duty of each side, forward positive, and when it was sent [us since the Unix epoch]."""

    left: float
    right: float
    utime: int


class SentDuties:
    """Collects the duties sent; publishes those that no feedback contains, as motor_duty_t.

    The motors may have obeyed them although the controller's answer was lost.
    """

    def __init__(self, robot_id: int, publish: Callable[[motor_duty_t], None]) -> None:
        self._robot_id = robot_id
        self._publish = publish
        self._unreported: list[SentDuty] = []

    def add(self, duty: SentDuty) -> None:
        """Record a duty that was sent."""
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


class Feedback:
    """Makes the feedback of one robot; `utime_at` converts times of the monotonic clock [ns] to wall-clock time
    [us].
    """

    def __init__(self, robot_id: int, wiring: Wiring, utime_at: Callable[[int], int]) -> None:
        self._robot_id = robot_id
        self._wiring = wiring
        self._utime_at = utime_at
        self._stamps = Stamps(utime_at)
        self._jumps_reported = 0

    def message(
        self,
        answer: Answer[tuple[int, int]],
        motion: WheelMotion,
        jumps: int,
        applied: SentDuty,
        telemetry: Telemetry,
        status: int,
    ) -> motor_feedback_t:
        """Return the message of one reading of the encoders, `jumps` of which were rejected so far.

        A jump is reported with the next accepted reading, since it has no velocity of its own to publish.
        """
        jumped, self._jumps_reported = jumps > self._jumps_reported, jumps
        status |= telemetry.get("status", 0) | (motor_feedback_t.STATUS_ENCODER_JUMP if jumped else 0)
        currents = self._wiring.sides(*telemetry.get("currents", (math.nan, math.nan)))
        return make(
            motor_feedback_t,
            utime=self._stamps.next(answer.measured),
            robot_id=self._robot_id,
            ticks_left=motion.ticks[0],
            ticks_right=motion.ticks[1],
            psi_left=motion.psi[0],
            psi_right=motion.psi[1],
            applied_left=applied.left,
            applied_right=applied.right,
            current_left=currents[0],
            current_right=currents[1],
            battery_voltage=telemetry.get("battery_voltage", math.nan),
            temperature=telemetry.get("temperature", math.nan),
            status=status,
            received_utime=self._utime_at(answer.arrived),
            applied_utime=applied.utime,
        )
