"""An emulated VRPN server with trackers: a TCP connection as the VRPN library 7.35 makes it.

The format is that of vrpn_Connection.C and vrpn_Tracker.C, from the server's side. A client may connect by TCP, or ask
by a UDP datagram with its address to be connected to.
"""

import socket
import struct
import time
from contextlib import suppress

from tests.support.trackers.frame import Emitted

COOKIE = b"vrpn: ver. 07.35  0".ljust(24, b"\0")
SENDER, TYPE = -1, -2
TYPES = ["vrpn_Tracker Pos_Quat", "vrpn_Base ping_message", "vrpn_Base pong_message"]
POSE, PING, PONG = 0, 1, 2


class VrpnServer:
    """A server on the loopback. Each body is a sender of its own; one that is not tracked sends nothing."""

    def __init__(self, address: str = "127.0.0.1", port: int = 0) -> None:
        self.listener = socket.create_server((address, port))
        self.listener.setblocking(False)
        self.port = self.listener.getsockname()[1]
        self.lobs = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.lobs.bind((address, self.port))
        self.lobs.setblocking(False)
        self.names: list[str] = []  # which a client of VRPN learns with the first pose of each body
        self.clients: list[_Client] = []
        self.handed_over = 0.0  # s, time of the day; when the last frame was given to the system to send

    def poll(self) -> None:
        """Take new clients, and answer pings."""
        with suppress(BlockingIOError):
            while True:
                self.clients.append(_Client(self.listener.accept()[0]))
        with suppress(BlockingIOError):
            while True:
                host, port = self.lobs.recvfrom(256)[0].rstrip(b"\0").decode().split()
                self.clients.append(_Client(socket.create_connection((host, int(port)), 1.0)))
        for client in list(self.clients):
            client.answer()
            if client.is_gone:
                self.clients.remove(client)

    def send(self, frame: Emitted) -> None:
        """Send the poses of a frame to all clients; their stamps are those of the exposure."""
        self.poll()
        stamp = round(frame.exposed * 1e6)
        for client in self.clients:
            out = b""
            for body in frame.bodies:
                if body.tracked:
                    sender = client.sender(body.name)
                    pose = struct.pack(">ii3d4d", 0, 0, body.x, body.y, body.z, *body.quaternion)
                    out += client.pending() + message(stamp, sender, POSE, pose)
            self.handed_over = time.time()
            client.write(out)

    def close(self) -> None:
        """Close all connections."""
        for client in self.clients:
            client.socket.close()
        self.listener.close()
        self.lobs.close()


class _Client:
    """A connection: the senders that it knows of."""

    def __init__(self, made: socket.socket) -> None:
        made.setblocking(False)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = made
        self.is_gone = False
        self._senders: dict[str, int] = {}
        self._described = b"".join(_description(TYPE, number, name) for number, name in enumerate(TYPES))
        self._received = b""
        self._greeted = False
        self._types: dict[int, bytes] = {}
        self.write(COOKIE + self.pending())

    def sender(self, name: str) -> int:
        """Return the number of a sender; a new one is described before it is used."""
        if name not in self._senders:
            self._senders[name] = len(self._senders)
            self._described += _description(SENDER, self._senders[name], name)
        return self._senders[name]

    def pending(self) -> bytes:
        """Return the descriptions that have not been sent."""
        described, self._described = self._described, b""
        return described

    def answer(self) -> None:
        """Answer pings, as the library warns of a silent server otherwise."""
        try:
            while data := self.socket.recv(4096):
                self._received += data
            self.is_gone = True
        except BlockingIOError:
            pass
        except OSError:
            self.is_gone = True
        if not self._greeted and len(self._received) >= len(COOKIE):
            self._greeted, self._received = True, self._received[len(COOKIE) :]
        while self._greeted and len(self._received) >= 24:
            length, _, _, sender, kind, _ = struct.unpack_from(">IIIiiI", self._received)
            whole = length + -length % 8
            if len(self._received) < whole:
                break
            body = self._received[24:length]
            if kind == TYPE:
                self._types[sender] = body[4:].split(b"\0")[0]
            elif self._types.get(kind) == b"vrpn_Base ping_message" and sender in self._senders.values():
                self.write(message(0, sender, PONG, b""))
            self._received = self._received[whole:]

    def write(self, data: bytes) -> None:
        """Send bytes; a client that takes none is let go."""
        try:
            self.socket.sendall(data)
        except OSError:
            self.is_gone = True


def message(stamp: int, sender: int, kind: int, payload: bytes) -> bytes:
    """Return a message with a time stamp [us], filled up to 8 bytes."""
    header = struct.pack(">IIIiiI", 24 + len(payload), stamp // 1_000_000, stamp % 1_000_000, sender, kind, 0)
    return header + payload + b"\0" * (-len(payload) % 8)


def _description(kind: int, number: int, name: str) -> bytes:
    text = name.encode() + b"\0"
    return message(0, number, kind, struct.pack(">I", len(text)) + text)
