"""The gate for incoming messages: it checks that numbers are possible and stamps near this host's clock."""

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

# us: clocks of two hosts may differ by 1 s, and messages may take half a second. A stamp further from this host's clock
# belongs to another time.
MEASURED_WITHIN = 1_500_000
# Largest distance [us] of a stamp from the clock. Stamps of other types are not checked: an emergency stop always
# counts.
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
# us for which a robot counts as live after a stamp near the clock; all its stamps must then be near the clock
LIVES_FOR = 10_000_000
SPOKEN_OF = 2_000_000  # us for which a refusal is reported


class Gate:
    """Checks incoming messages. Call `turn` with the time before handing over messages; until then any stamp passes.

    `refused` counts refused messages by (channel, reason) since the start. A caller that rejects a message for another
    reason calls `refuse`. Stamps of the types in `stamps_of_all_times` are checked elsewhere. With `replays` a replayed
    log also passes: robots with no recent stamp near the clock, at any valid time.
    """

    def __init__(self, *stamps_of_all_times: type[Message], replays: bool = False) -> None:
        self.refused = Rejections()
        self._replays = replays
        self._live: dict[int | None, int] = {}  # when a stamp was last near the clock [us], by robot
        self._near = {kind: near for kind, near in NEAR.items() if not issubclass(kind, stamps_of_all_times)}
        self._before = self.now = 0
        self._lately = Rejections()
        self._last = 0

    def turn(self, utime: int) -> None:
        """Set the time to `utime` [us]. Messages handed over from now on arrived since the previous turn."""
        if utime != self.now:
            self._before, self.now = self.now or utime, utime

    def let_in(self, channel: str, message: Message) -> Message | None:
        """Return the usable part of a message; None if it must be refused."""
        kind = world_state_t if isinstance(message, world_state_t) else type(message)  # our own subclass holds arrays
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
        """Count a message, or part of one, as refused if `reason` is not empty."""
        if not reason:
            return
        if abs(self.now - self._last) > SPOKEN_OF:
            self._lately.clear()
        self._last = self.now
        self._lately.note(channel, reason)
        self.refused.note(channel, reason)

    def problem(self) -> str:
        """Return a sentence on recent refusals; empty if there were none."""
        if not self._lately or abs(self.now - self._last) > SPOKEN_OF:
            return ""
        what = ", ".join(f"{channel} {reason} ({count})" for (channel, reason), count in self._lately.items())
        return f"Messages were refused: {what}."

    def _lives(self, channel: str) -> bool:
        """Return whether a robot had a stamp near the clock recently."""
        last = self._live.get(_robot_of(channel))
        return last is not None and abs(self.now - last) <= LIVES_FOR

    def _wrong_time(self, stamp: int, near: int) -> str:
        """Return what is wrong with a stamp; it is right if it is near the clock at any time since the last turn."""
        if stamp > max(self._before, self.now) + near:
            return AHEAD
        return BEHIND if stamp < min(self._before, self.now) - near else ""


def _robot_of(channel: str) -> int | None:
    return (identify(channel) or (None, None))[1]
