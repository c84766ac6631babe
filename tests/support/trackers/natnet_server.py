"""An emulated Motive: NatNet 3.x (Motive 2) or 4.x (Motive 3), multicast or unicast.

The format is that of NatNet SDK 4.1, samples/PythonClient/NatNetClient.py, from the server's side.
"""

import socket
import struct
import time
from contextlib import suppress

from tests.support.trackers.frame import Body, Emitted

TICKS = 10_000_000  # per second of the server's clock


class NatNetServer:
    """A server on the loopback. `up` is the axis that its bodies' data have upwards."""

    def __init__(
        self,
        version: tuple[int, int] = (4, 1),
        *,
        group: str | None = None,
        up: str = "z",
        data_port: int = 0,
        address: str = "127.0.0.1",
    ) -> None:
        self.version, self.group, self.up = version, group, up
        self.command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.command.bind((address, 0))
        self.command.setblocking(False)
        self.port = self.command.getsockname()[1]
        self.data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.data.bind((address, 0))
        self.data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
        self.data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        self.data_port = data_port or _free_port()
        self.names: list[str] = []
        self.clients: dict[tuple[str, int], None] = {}
        self.handed_over = 0.0  # s, time of the day; when the last frame was given to the system to send

    def poll(self) -> None:
        """Answer requests."""
        with suppress(BlockingIOError):
            while True:
                data, client = self.command.recvfrom(1 << 16)
                self.clients[client] = None
                (kind,) = struct.unpack_from("<H", data)
                if kind == 0:
                    self._answer(client, 1, self._info())
                elif kind == 4:
                    self._answer(client, 5, self._descriptions())
                elif kind == 2:
                    self._answer(client, 3, struct.pack("<i", 0))

    def send(self, frame: Emitted) -> None:
        """Send a frame to the group, or to all clients."""
        self.names = [body.name for body in frame.bodies]
        self.poll()
        payload = self._frame(frame)
        packet = struct.pack("<HH", 7, len(payload)) + payload
        self.handed_over = time.time()
        if self.group is not None:
            self.data.sendto(packet, (self.group, self.data_port))
        else:
            for client in self.clients:
                self.command.sendto(packet, client)

    def close(self) -> None:
        """Close the sockets."""
        self.command.close()
        self.data.close()

    def _answer(self, client: tuple[str, int], kind: int, payload: bytes) -> None:
        self.command.sendto(struct.pack("<HH", kind, len(payload)) + payload, client)

    def _info(self) -> bytes:
        name = b"Motive".ljust(256, b"\0")
        motive = (3, 1, 0, 0) if self.version[0] == 4 else (2, 3, 0, 0)
        group = socket.inet_aton(self.group or "0.0.0.0")
        return (
            name
            + bytes(motive)
            + bytes((*self.version, 0, 0))
            + struct.pack("<QH?", TICKS, self.data_port, self.group is not None)
            + group
        )

    def _descriptions(self) -> bytes:
        sets = [(0, _text("all") + struct.pack("<I", 1) + _text("marker"))]
        for number, name in enumerate(self.names, start=1):
            body = _text(name) + struct.pack("<ii3f", number, -1, 0.0, 0.0, 0.0)
            if self.version >= (4, 2):
                body += struct.pack("<4f", 0.0, 0.0, 0.0, 1.0)
            body += struct.pack("<I3f3fii", 2, 0.05, 0.0, 0.0, -0.05, 0.0, 0.0, 0, 0)
            if self.version[0] >= 4:
                body += _text("front") + _text("back")
            sets.append((1, body))
        out = struct.pack("<I", len(sets))
        for kind, content in sets:
            out += struct.pack("<I", kind)
            if self.version >= (4, 1):
                out += struct.pack("<I", len(content))
            out += content
        return out

    def _frame(self, frame: Emitted) -> bytes:
        sets = _text("all") + struct.pack("<I", 1) + struct.pack("<3f", 1.0, 2.0, 3.0)
        bodies = b"".join(self._body(number, body) for number, body in enumerate(frame.bodies, start=1))
        labelled = struct.pack("<i3ffhf", 1 << 16 | 1, 1.0, 2.0, 3.0, 0.014, 8, 0.0002)
        out = struct.pack("<I", frame.number & 0xFFFFFFFF)
        out += self._part(1, sets) + self._part(2, struct.pack("<6f", *range(6)))
        out += self._part(len(frame.bodies), bodies) + self._part(0, b"")
        if self.version >= (4, 1):
            out += self._part(0, b"")
        out += self._part(1, labelled)
        out += self._part(1, struct.pack("<IIIf", 1, 1, 1, 0.5)) + self._part(0, b"")
        out += struct.pack("<IId", 0, 0, frame.exposed)
        exposed, sent = round(frame.exposed * TICKS), round(frame.sent * TICKS)
        out += struct.pack("<QQQ", exposed, (exposed + sent) // 2, sent)
        if self.version >= (4, 1):
            out += struct.pack("<II", 0, 0)
        return out + struct.pack("<hi", 0, 0)

    def _part(self, count: int, content: bytes) -> bytes:
        size = struct.pack("<I", len(content)) if self.version >= (4, 1) else b""
        return struct.pack("<I", count) + size + content

    def _body(self, number: int, body: Body) -> bytes:
        x, y, z, (qx, qy, qz, qw) = body.x, body.y, body.z, body.quaternion
        if self.up == "y":
            y, z, qy, qz = z, -y, qz, -qy
        return struct.pack("<i3f4ffh", number, x, y, z, qx, qy, qz, qw, 0.0001, 1 if body.tracked else 0)


def _text(text: str) -> bytes:
    return text.encode() + b"\0"


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
