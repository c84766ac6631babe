"""The gate through which messages of strangers come in: numbers that can be, stamps near the clock of this host."""

from collections.abc import Mapping

from cmr.bus.estop import LAST_UTIME
from cmr.bus.message import Message
from cmr.bus.possible import screened
from cmr.bus.rejections import Rejections
from cmr.bus.senders import keep
from cmr.bus.streams import COMMAND_LIFETIME, identify
from cmr.msg import (
    gyro_t,
    motor_command_t,
    motor_duty_t,
    motor_feedback_t,
    pose_xyt_t,
    velocity_command_t,
    waypoints_t,
    wheel_speed_command_t,
    world_state_t,
)

# us: clocks of two hosts may be 1 s apart, and messages half a second on their way. What is further from this host's
# clock tells of another time.
MEASURED_WITHIN = 1_500_000
# How far [us] stamps may be from the clock. Those of other types are not looked at: an emergency stop always counts.
NEAR: Mapping[type[Message], int] = {
    pose_xyt_t: MEASURED_WITHIN,
    gyro_t: MEASURED_WITHIN,
    motor_feedback_t: MEASURED_WITHIN,
    motor_duty_t: MEASURED_WITHIN,
    world_state_t: MEASURED_WITHIN,
    waypoints_t: MEASURED_WITHIN,
    motor_command_t: COMMAND_LIFETIME,
    wheel_speed_command_t: COMMAND_LIFETIME,
    velocity_command_t: COMMAND_LIFETIME,
}
AHEAD, BEHIND = "ahead of this host's clock", "behind this host's clock"
LIVES_FOR = 10_000_000  # us since a stamp of a robot was near the clock, for which its others must be, too
SPOKEN_OF = 2_000_000  # us for which a refusal is spoken of


class Gate:
    """Lets messages in. `turn` says what time it is, before messages are handed over; before the first, any stamp is.

    `refused` counts by (channel, reason) what was not let in since the start. A caller that finds something else
    wrong with a message says so to `refuse`. Stamps of the types in `stamps_of_all_times` are looked at elsewhere.
    With `replays` also a log that is played again comes in: robots none of whose stamps were near the clock lately,
    at a time that a clock can show.
    """

    def __init__(self, *stamps_of_all_times: type[Message], replays: bool = False) -> None:
        self.refused = Rejections()
        self._replays = replays
        self._live: dict[int | None, int] = {}  # when a stamp was near the clock at last [us], by robot
        self._near = {kind: near for kind, near in NEAR.items() if not issubclass(kind, stamps_of_all_times)}
        self._before = self.now = 0
        self._lately = Rejections()
        self._last = 0

    def turn(self, utime: int) -> None:
        """Note that it is `utime` [us]. Messages that are handed over from now on came since the last turn."""
        if utime != self.now:
            self._before, self.now = self.now or utime, utime

    def let_in(self, channel: str, message: Message) -> Message | None:
        """Return a message as far as it can be used; None if it cannot."""
        kind = world_state_t if isinstance(message, world_state_t) else type(message)  # ours is made of arrays
        near = self._near.get(kind)
        if near is not None and self.now:
            why = self._wrong_time(message.utime, near)
            if why and (not self._replays or self._lives(channel) or not 0 <= message.utime < LAST_UTIME):
                self.refuse(channel, why)
                return None
            if not why and self._replays:
                keep(self._live, _robot_of(channel), self.now)
        usable, reasons = screened(message)
        for reason in reasons:
            self.refuse(channel, reason)
        return usable

    def refuse(self, channel: str, reason: str) -> None:
        """Note that a message, or a part of it, was not used, if there is a reason."""
        if not reason:
            return
        if abs(self.now - self._last) > SPOKEN_OF:
            self._lately.clear()
        self._last = self.now
        self._lately.note(channel, reason)
        self.refused.note(channel, reason)

    def problem(self) -> str:
        """Return, as a sentence, what was refused lately; empty if nothing was."""
        if not self._lately or abs(self.now - self._last) > SPOKEN_OF:
            return ""
        what = ", ".join(f"{channel} {reason} ({count})" for (channel, reason), count in self._lately.items())
        return f"Messages were refused: {what}."

    def _lives(self, channel: str) -> bool:
        """Return whether stamps of a robot were near the clock lately."""
        last = self._live.get(_robot_of(channel))
        return last is not None and abs(self.now - last) <= LIVES_FOR

    def _wrong_time(self, stamp: int, near: int) -> str:
        """Return what is wrong with a stamp; one is right that is near the clock at any time since the last turn."""
        if stamp > max(self._before, self.now) + near:
            return AHEAD
        return BEHIND if stamp < min(self._before, self.now) - near else ""


def _robot_of(channel: str) -> int | None:
    return (identify(channel) or (None, None))[1]
