"""The sensors of a virtual robot: readings of encoders, a gyro and a tracker at its place in the world."""

import math
from collections.abc import Iterator

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, POSE
from cmr.model.body import wrap
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t
from cmr.world.view import Robot

TICK = 1e-3  # rad; of a good encoder
LONGEST_GAP = 200_000  # us between two readings, over which wheels are integrated
Reading = tuple[str, Message]


class VirtualSensors:
    """Reads a virtual robot's sensors at each new state of the world.

    A robot that is not driven from outside gets the duties of `driven`, from then on until the next reading.
    """

    def __init__(self) -> None:
        self._before: Robot | None = None
        self._turned = [0.0, 0.0]  # rad
        self._driven = 0, (0.0, 0.0)

    def driven(self, utime: int, duties: tuple[float, float]) -> None:
        """Note the duties of this moment [us]."""
        self._driven = utime, duties

    def read(self, me: Robot) -> Iterator[Reading]:
        """Yield the readings of the robot's sensors, if its state is new."""
        before, self._before = self._before, me
        if before is None or not 0 < me.utime - before.utime < LONGEST_GAP:
            return
        seconds = 1e-6 * (me.utime - before.utime)
        now, then = me.state, before.state
        speeds = (now.psi_left, now.psi_right), (then.psi_left, then.psi_right)
        for side, (psi, psi_then) in enumerate(zip(*speeds, strict=True)):
            self._turned[side] += 0.5 * seconds * float(psi + psi_then)
        rate = float(wrap(now.theta - then.theta)) / seconds
        who = {"utime": me.utime, "robot_id": me.robot_id}
        yield MOTOR_FEEDBACK.channel(me.robot_id), self._feedback(me, who)
        # Its mean over the time between two readings is the rate in the middle of it.
        middle = {**who, "utime": (me.utime + before.utime) // 2}
        yield GYRO.channel(me.robot_id), make(gyro_t, **middle, yaw_rate=rate, valid=1, received_utime=me.utime)
        pose = make(pose_xyt_t, **who, x=float(now.x), y=float(now.y), theta=float(wrap(now.theta)))
        yield POSE.channel(me.robot_id), pose

    def _feedback(self, me: Robot, who: dict[str, int]) -> motor_feedback_t:
        unknown = dict.fromkeys(("current_left", "current_right", "battery_voltage", "temperature"), math.nan)
        applied_utime, (left, right) = self._driven
        return make(
            motor_feedback_t,
            **who,
            **unknown,
            ticks_left=round(self._turned[0] / TICK),
            ticks_right=round(self._turned[1] / TICK),
            psi_left=float(me.state.psi_left),
            psi_right=float(me.state.psi_right),
            applied_left=left if applied_utime else math.nan,
            applied_right=right if applied_utime else math.nan,
            status=0,
            received_utime=me.utime,
            applied_utime=applied_utime,
        )
