"""Check a driver's duties against the messages that it received, independently of the driver's code."""

import math
from collections.abc import Callable, Sequence

from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.signing import without_signature
from cmr.bus.streams import ESTOP
from cmr.msg import estop_t, motor_command_t

LIFETIME_US = 600_000  # after which a command no longer moves a motor: 0.5 s, and time to stop
STOPPED_AFTER_US = 150_000  # after an emergency stop
ROUNDING = 1e-3  # duty


class DutyChecks:
    """Compares the duties that the device received with the largest duty that was commanded recently.

    The sender, signature and timestamp of a command are ignored: a duty above all recent commands is wrong in any
    case. Times are in us.
    """

    def __init__(self, channel: str, duties: Callable[[], Sequence[float]]) -> None:
        self._channel, self._duties = channel, duties
        self._commanded: list[tuple[int, float]] = []
        self._stopped_since: int | None = None

    def sent(self, channel: str, data: bytes, utime: int) -> None:
        """Record a message that is sent to the driver."""
        try:
            message = decode(channel, without_signature(data)).message
        except RejectedMessage:
            return
        if isinstance(message, estop_t) and channel == ESTOP.name:
            if not message.engaged:
                self._stopped_since = None
            elif self._stopped_since is None:
                self._stopped_since = utime
        if isinstance(message, motor_command_t) and channel == self._channel:
            largest = max(abs(message.left), abs(message.right))
            if math.isfinite(message.left) and math.isfinite(message.right) and largest <= 1.0:
                self._commanded.append((utime, largest))

    def problem(self, utime: int) -> str:
        """Return a description of a duty that is too large; empty if there is none."""
        self._commanded = [(when, duty) for when, duty in self._commanded if utime - when <= LIFETIME_US]
        permitted = max((duty for _, duty in self._commanded), default=0.0)
        if self._stopped_since is not None and utime - self._stopped_since > STOPPED_AFTER_US:
            permitted = 0.0
        duties = self._duties()
        if all(abs(duty) <= permitted + ROUNDING for duty in duties):
            return ""
        return f"the motors have duties {duties}, but at most {permitted} is permitted"
