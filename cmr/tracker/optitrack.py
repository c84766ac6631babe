"""OptiTrack's Motive 2 and 3, over NatNet: multicast or unicast, with the server's stamps of the exposure.

Names of bodies come from Motive's data descriptions, which the package `natnet` reads.
"""

import socket
import struct
import time
from contextlib import suppress

from cmr.tracker.frames import Sample
from cmr.tracker.natnet_frames import parse
from cmr.tracker.profile import Tracker
from cmr.tracker.source import RETRY, SILENT, Clock, SourceError

COMMAND_PORT = 1510
CONNECT, SERVER_INFO, REQUEST_DESCRIPTIONS, DESCRIPTIONS, FRAME, KEEP_ALIVE = 0, 1, 4, 5, 7, 10
HEADER = struct.Struct("<HH")
VERSIONS = struct.Struct("<256s4B4B")
CLOCK = struct.Struct("<QH?4B")  # ticks per second, data port, multicast, its group
KEEP_ALIVE_PERIOD = 0.5  # s; a unicast server stops sending to silent clients
DESCRIBED_AGAIN = 10.0  # s; bodies may be renamed
LARGEST = 1 << 16  # bytes
BUFFER = 1 << 21  # bytes of the socket, for times when the computer is busy
OLDEST = (3, 0)
MOST_PACKETS = 64  # taken at once
TAKES_OVER = 1.0  # s of silence after which frames of another sender are accepted


class OptiTrack:
    """A Motive server. Frames of another sender in the same group are ignored and reported."""

    uncertainty = "the least time that a frame takes over the network"

    def __init__(self, tracker: Tracker, clock: Clock = time.monotonic_ns) -> None:
        import natnet  # noqa: F401 - needed when the server answers

        self.problem = f"No answer from Motive at {tracker.server} yet."
        self._tracker, self._clock = tracker, clock
        self._server = (tracker.server, tracker.port or COMMAND_PORT)
        self._command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._command.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        try:
            self._command.bind((tracker.local, 0))
        except OSError as error:
            raise SourceError(f"The address {tracker.local} is none of this computer's: {error.strerror}.") from error
        self._command.setblocking(False)
        self._data: socket.socket | None = None
        self._version = (0, 0)
        self._ticks = 0
        self._names: dict[int, str] = {}
        self._ids: tuple[int, ...] = ()
        self._named: tuple[str, ...] = ()
        self._asked = self._described = self._heard = self._sent = -1e9
        self._sender: tuple[str, int] | None = None
        self._stranger: tuple[str, float] = ("", -1e9)
        self._malformed = 0

    def filenos(self) -> list[int]:
        """Return the sockets of commands and of data."""
        return [one.fileno() for one in (self._command, self._data) if one is not None]

    def read(self) -> list[Sample]:
        """Return the frames received."""
        samples = []
        for one in (self._data, self._command):
            for _ in range(MOST_PACKETS if one is not None else 0):
                assert one is not None
                try:
                    data, sender = one.recvfrom(LARGEST)
                except OSError:  # no more data; or no Motive on the server, which its silence shows
                    break
                sample = self._take(data, sender)
                if sample is not None:
                    samples.append(sample)
        return samples

    def tend(self, now: float) -> None:
        """Request the server's data until it answers, and descriptions of unnamed bodies; keep it sending."""
        if now - self._heard > SILENT and now - self._asked > RETRY:
            self._asked = now
            self._send(CONNECT, b"Ping\0")
        if now - self._sent > KEEP_ALIVE_PERIOD and self._data is None and self._version != (0, 0):
            self._sent = now
            self._send(KEEP_ALIVE, b"\0")
        if now - self._described > DESCRIBED_AGAIN and self._version != (0, 0):
            self._described = now
            self._send(REQUEST_DESCRIPTIONS, b"\0")
        self.problem = self._wrong(now)

    def close(self) -> None:
        """Close the sockets."""
        for one in (self._command, self._data):
            if one is not None:
                one.close()

    def _wrong(self, now: float) -> str:
        if self._version == (0, 0):
            return f"No answer from Motive at {self._server[0]}:{self._server[1]}."
        if self._version < OLDEST:
            return f"Motive speaks NatNet {self._version[0]}.{self._version[1]}; 3.0 (Motive 2) is the oldest known."
        name, when = self._stranger
        if now - when < SILENT and self._sender is None:
            return f"Frames come from {name}, not from {self._server[0]}, which the profile names."
        if now - when < SILENT:
            return f"A second tracker sends frames to this address, from {name}; only the first is used."
        return ""

    def _send(self, kind: int, payload: bytes) -> None:
        with suppress(OSError):  # no network: the missing frames are reported
            self._command.sendto(HEADER.pack(kind, len(payload)) + payload, self._server)

    def _take(self, data: bytes, sender: tuple[str, int]) -> Sample | None:
        if len(data) < HEADER.size:
            return None
        kind, _ = HEADER.unpack_from(data)
        try:
            if kind == FRAME:
                return self._frame(data[HEADER.size :], sender)
            if sender[0] == self._server[0] and kind == SERVER_INFO:
                self._server_info(data[HEADER.size :])
            elif sender[0] == self._server[0] and kind == DESCRIPTIONS:
                self._descriptions(data[HEADER.size :])
        except (ValueError, struct.error):
            self._malformed += 1
        return None

    def _server_info(self, data: bytes) -> None:
        _, *versions = VERSIONS.unpack_from(data)
        self._version = (versions[4], versions[5])
        ticks, port, is_multicast, *group = CLOCK.unpack_from(data, VERSIONS.size)
        self._ticks = ticks
        if is_multicast and self._data is None:
            self._data = self._joined(".".join(map(str, group)), port)
        self._described = -1e9

    def _joined(self, group: str, port: int) -> socket.socket | None:
        data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        data.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        data.setblocking(False)
        try:
            data.bind((group, port))
            membership = socket.inet_aton(group) + socket.inet_aton(self._tracker.local)
            data.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        except OSError as error:
            data.close()
            raise SourceError(
                f"The multicast group {group}:{port} cannot be joined: {error.strerror}. "
                "'local' in the profile is this computer's address in the tracker's network."
            ) from error
        return data

    def _descriptions(self, data: bytes) -> None:
        from natnet.data_descriptions import DataDescriptions
        from natnet.packet_buffer import PacketBuffer
        from natnet.version import Version

        described = DataDescriptions.read_from_buffer(PacketBuffer(data), Version(*self._version))
        self._names = {body.id_num: body.name or str(body.id_num) for body in described.rigid_bodies}
        self._ids = ()

    def _frame(self, data: bytes, sender: tuple[str, int]) -> Sample | None:
        now = self._clock()
        if self._version < OLDEST or not self._is_ours(sender, now / 1e9):
            return None
        frame = parse(data, self._version)
        self._heard = now / 1e9
        bodies = frame.bodies
        if bodies.ids != self._ids:
            self._name(bodies.ids)
        has_clock = self._ticks > 0 and frame.exposure > 0
        measured = frame.exposure / self._ticks if has_clock else frame.stamp
        sent = frame.transmitted / self._ticks if has_clock else frame.stamp
        origin = f"{sender[0]}:{sender[1]}"
        return Sample(now, measured, sent, self._named, bodies.positions, bodies.quaternions, origin)

    def _is_ours(self, sender: tuple[str, int], now: float) -> bool:
        """Return whether frames of this sender are accepted: those of the server, from one port."""
        if sender == self._sender:
            return True
        if sender[0] == self._server[0] and (self._sender is None or now - self._heard > TAKES_OVER):
            self._sender = sender
            return True
        self._stranger = (f"{sender[0]}:{sender[1]}", now)
        return False

    def _name(self, ids: tuple[int, ...]) -> None:
        """Store the names of bodies seen; request those that are not described yet."""
        now = self._clock() / 1e9
        if not all(number in self._names for number in ids) and now - self._described > RETRY:
            self._described = now
            self._send(REQUEST_DESCRIPTIONS, b"\0")
        self._named = tuple(self._names.get(number, f"#{number}") for number in ids)
        self._ids = ids if all(number in self._names for number in ids) else ()
