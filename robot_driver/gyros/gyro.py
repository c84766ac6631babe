"""Interface to gyros that send readings on their own."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field


@dataclass(slots=True)  # not frozen: a thousand a second are created
class GyroReading:
    """One reading.

    `yaw_rate` is in rad/s, counter-clockwise positive seen from above with the sensor upright; NaN if not `valid`.
    `bytes_since` is how many bytes of the stream had been received since the reading began: what the time stamp is
    computed from, unless the sensor's clock runs with ours and says when it `measured` (monotonic ns).
    `lost_before` is how many readings were sent just before this one but never came, where the protocol shows it.
    `per_period`: the device reported the angle turned since its last message, so that the rate is right if messages
    come as often as it says.
    """

    yaw_rate: float
    valid: bool
    bytes_since: int = field(compare=False, default=0)
    measured: int | None = field(compare=False, default=None)
    lost_before: int = field(compare=False, default=0)
    per_period: bool = field(compare=False, default=False)


class Gyro(ABC):
    """The protocol of a gyro; it does no I/O.

    A new object is made for each connection and after each gap, since the gyro may have been off. `problem` is a
    sentence on why what comes cannot be used as it is, or "". `nominal_rate` (Hz) is how often readings come by the
    device's own account, 0 where and while that is not known or not steady; a gap of a few readings can only be seen
    where it is. `unnoticed` is how many readings, or a multiple of it, may be lost without `lost_before` showing it.
    """

    baud_rate: int
    problem = ""
    nominal_rate = 0.0
    unnoticed = 1

    @property
    @abstractmethod
    def wake_up(self) -> bytes:
        """What to send after connecting, and after a silence, to receive readings in the supported mode."""

    @abstractmethod
    def feed(self, data: bytes) -> list[GyroReading]:
        """Process the next bytes of the stream, in pieces of any size; return the readings completed by them."""

    @property
    def farewell(self) -> bytes:
        """What to send before the port is closed, so that readings continue; b"" if nothing is needed."""
        return b""

    @property
    def unanswered(self) -> bytes:
        """What to send again after a while without an answer; b"" if no answer is expected."""
        return b""

    def next_request(self) -> bytes:
        """Return, once, what to send after the bytes fed; b"" if there is nothing to send."""
        return b""
