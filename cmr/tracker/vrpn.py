"""VRPN servers, such as those of Vicon Tracker, Motive and NOKOV: poses of trackers with the server's time stamps.

The protocol is that of the VRPN library, version 7 (vrpn_Connection.C, vrpn_Tracker.C): a TCP connection, on which both
sides first send a cookie; then messages with length, time, sender and type, big-endian, padded to 8 bytes.
`motioncapture` reads VRPN, too, but at a fixed 100 Hz and without time stamps.
"""

import struct
import time
from collections.abc import Iterator

import numpy as np

from cmr.tracker.frames import Sample
from cmr.tracker.profile import Tracker
from cmr.tracker.source import Clock, Stream

PORT = 3883
COOKIE_SIZE = 24  # bytes
COOKIE = b"vrpn: ver. 07.35  0".ljust(COOKIE_SIZE, b"\0")
MAGIC = b"vrpn: ver. 07."  # what follows is the minor version, which does not matter
HEADER = struct.Struct(">IIIiiI")  # length, s, us, sender, type, padding
ALIGNMENT = 8
POSE = struct.Struct(">ii3d4d")  # sensor, padding, position [m], quaternion (x, y, z, w)
SENDER_DESCRIPTION, TYPE_DESCRIPTION = -1, -2
POSES = b"vrpn_Tracker Pos_Quat"
PING, PONG = b"vrpn_Base ping_message", b"vrpn_Base pong_message"
PING_PERIOD = 1.0  # s
LARGEST = 1 << 16  # bytes of a message


class Vrpn:
    """A VRPN server. Each of its senders is a body; if one has several sensors, they are named `NAME/SENSOR`."""

    uncertainty = "the time from the exposure to the server's stamp, beyond the profile's lag, and that of the network"

    def __init__(self, tracker: Tracker, clock: Clock = time.monotonic_ns) -> None:
        self.problem = ""
        self._clock = clock
        self._stream = Stream(tracker.server, tracker.port or PORT, clock)
        self._origin = f"{tracker.server}:{tracker.port or PORT}"
        self._begin()

    def filenos(self) -> list[int]:
        """Return the socket to wait on."""
        return self._stream.filenos()

    def read(self) -> list[Sample]:
        """Return the poses received, those of one time stamp together."""
        self._waiting += self._stream.receive()
        arrival = self._clock()
        together: dict[tuple[int, int], dict[str, tuple[float, ...]]] = {}
        for seconds, microseconds, name, numbers in self._messages():
            together.setdefault((seconds, microseconds), {})[name] = numbers
        return [self._sample(arrival, *stamp, poses) for stamp, poses in together.items()]

    def tend(self, now: float) -> None:
        """Connect, and send the library's cookie."""
        if self._stream.connect(now):
            self._begin()
            self._stream.send(COOKIE)
        self.problem = self._stream.problem or self._said

    def close(self) -> None:
        """Close the connection."""
        self._stream.close()

    def _begin(self) -> None:
        self._waiting = b""
        self._greeted = False
        self._said = ""
        self._senders: dict[int, str] = {}
        self._types: dict[int, bytes] = {}
        self._names: dict[tuple[int, int], str] = {}

    def _sample(self, arrival: int, seconds: int, microseconds: int, poses: dict[str, tuple[float, ...]]) -> Sample:
        numbers = np.array(list(poses.values()))
        measured = seconds + microseconds / 1e6
        return Sample(arrival, measured, measured, tuple(poses), numbers[:, :3], numbers[:, 3:], self._origin)

    def _messages(self) -> Iterator[tuple[int, int, str, tuple[float, ...]]]:
        """Yield seconds, microseconds, name and numbers of the complete poses; keep the rest."""
        data, at = self._waiting, 0
        if not self._greeted:
            if len(data) < COOKIE_SIZE:
                return
            if not data.startswith(MAGIC):
                return self._refuse("it is no VRPN server of version 7")
            self._greeted, at = True, COOKIE_SIZE
        while len(data) - at >= HEADER.size:
            length, seconds, microseconds, sender, kind, _ = HEADER.unpack_from(data, at)
            end = at + length + -length % ALIGNMENT
            if not HEADER.size <= length <= LARGEST:
                return self._refuse("it sent what is not VRPN's protocol")
            if len(data) < end:
                break
            body = at + HEADER.size
            if self._types.get(kind) == POSES and length - HEADER.size >= POSE.size:
                sensor, _, *numbers = POSE.unpack_from(data, body)
                yield seconds, microseconds, self._name(sender, sensor), tuple(numbers)
            elif kind < 0:
                self._describe(kind, sender, data[body : at + length])
            at = end
        self._waiting = data[at:]

    def _refuse(self, why: str) -> None:
        self._stream.drop(why)
        self._begin()

    def _describe(self, kind: int, number: int, content: bytes) -> None:
        """Store the name of a sender or of a type: its length, then the name with a zero."""
        name = content[4:].split(b"\0")[0]
        if kind == SENDER_DESCRIPTION:
            self._senders[number] = name.decode(errors="replace")
            self._names.clear()
        elif kind == TYPE_DESCRIPTION:
            self._types[number] = name

    def _name(self, sender: int, sensor: int) -> str:
        known = self._names.get((sender, sensor))
        if known is None:
            name = self._senders.get(sender, f"#{sender}")
            known = self._names[sender, sensor] = name if sensor == 0 else f"{name}/{sensor}"
        return known
