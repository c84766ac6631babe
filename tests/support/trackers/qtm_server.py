"""An emulated Qualisys Track Manager: QTM RT protocol 1.19, little-endian, 6D and 6DEuler over TCP or UDP.

The format is that of Qualisys' "QTM Real-time Server Protocol Documentation", from the server's side.
"""

import math
import socket
import struct
import time
from contextlib import suppress

from tests.support.trackers.frame import Body, Emitted

ERROR, COMMAND, XML, DATA, EVENT = 0, 1, 2, 3, 6
COMPONENTS = {"6d": 5, "6deuler": 6, "3dnolabels": 2}


class QtmServer:
    """A server on the loopback; the port is that for little-endian clients."""

    def __init__(self, address: str = "127.0.0.1", port: int = 0) -> None:
        self.listener = socket.create_server((address, port))
        self.listener.setblocking(False)
        self.port = self.listener.getsockname()[1]
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.names: list[str] = []
        self.began: float | None = None
        self.clients: list[_Client] = []
        self.handed_over = 0.0  # s, time of the day; when the last frame was given to the system to send

    def poll(self) -> None:
        """Take new clients, and answer commands."""
        with suppress(BlockingIOError):
            while True:
                made, address = self.listener.accept()
                made.setblocking(False)
                made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                client = _Client(made, address[0])
                client.send(COMMAND, b"QTM RT Interface connected\0")
                self.clients.append(client)
        for client in list(self.clients):
            for command in client.commands():
                self._obey(client, command)
            if client.is_gone:
                self.clients.remove(client)

    def send(self, frame: Emitted) -> None:
        """Send a frame to all clients that stream."""
        self.names = [body.name for body in frame.bodies]
        self.began = frame.exposed if self.began is None else self.began
        self.poll()
        for client in self.clients:
            if client.components:
                packet = self._frame(frame, client.components)
                self.handed_over = time.time()
                if client.udp_port:
                    self.udp.sendto(packet, (client.address, client.udp_port))
                else:
                    client.write(packet)

    def close(self) -> None:
        """Close all connections."""
        for client in self.clients:
            client.socket.close()
        self.listener.close()
        self.udp.close()

    def _obey(self, client: "_Client", command: str) -> None:
        word, _, rest = command.lower().partition(" ")
        if word == "version":
            client.send(COMMAND, f"Version set to {rest}\0".encode())
        elif word == "qtmversion":
            client.send(COMMAND, b"QTM Version is 2019.3 (build 4700)\0")
        elif word == "byteorder":
            client.send(COMMAND, b"Byte order is little endian\0")
        elif word in ("getstate", "getlastevent"):
            client.send(EVENT, b"\x03")
        elif word == "getparameters":
            client.send(XML, self._settings().encode() + b"\0")
        elif word == "streamframes":
            client.stream(rest)
        else:
            client.send(ERROR, b"Parse error\0")

    def _settings(self) -> str:
        bodies = "".join(
            f"<Body><Name>{name}</Name><RGBColor>255</RGBColor><Point><X>0</X><Y>0</Y><Z>0</Z></Point></Body>"
            for name in self.names
        )
        euler = "<Euler><First>Roll</First><Second>Pitch</Second><Third>Yaw</Third></Euler>"
        return (
            f"<QTM_Parameters_Ver_1.19><The_6D><Bodies>{len(self.names)}</Bodies>{bodies}{euler}</The_6D>"
            "</QTM_Parameters_Ver_1.19>"
        )

    def _frame(self, frame: Emitted, components: list[str]) -> bytes:
        parts = b""
        for component in components:
            if component == "3dnolabels":
                content = struct.pack("<Ihh", 0, 0, 0)
            else:
                bodies = b"".join(_body(body, component == "6deuler") for body in frame.bodies)
                content = struct.pack("<ihh", len(frame.bodies), 0, 0) + bodies
            parts += struct.pack("<II", 8 + len(content), COMPONENTS[component]) + content
        assert self.began is not None
        stamp = round((frame.exposed - self.began) * 1e6)
        payload = struct.pack("<qII", stamp, frame.number & 0xFFFFFFFF, len(components)) + parts
        return struct.pack("<II", 8 + len(payload), DATA) + payload


class _Client:
    """A connection: what it asked for, and what it has not taken yet."""

    def __init__(self, made: socket.socket, address: str) -> None:
        self.socket, self.address = made, address
        self.components: list[str] = []
        self.udp_port = 0
        self.is_gone = False
        self._received = b""

    def commands(self) -> list[str]:
        """Return the commands that have come."""
        try:
            while data := self.socket.recv(4096):
                self._received += data
            self.is_gone = True
        except BlockingIOError:
            pass
        except OSError:
            self.is_gone = True
        commands = []
        while len(self._received) >= 8:
            size, kind = struct.unpack_from("<II", self._received)
            if len(self._received) < size:
                break
            if kind == COMMAND:
                commands.append(self._received[8:size].rstrip(b"\0").decode())
            self._received = self._received[size:]
        return commands

    def stream(self, words: str) -> None:
        """Begin to stream, or stop."""
        if words.startswith("stop"):
            self.components = []
            return
        chosen = words.split()
        self.udp_port = next((int(word.split(":")[-1]) for word in chosen if word.startswith("udp")), 0)
        self.components = [word for word in chosen if word in COMPONENTS]

    def send(self, kind: int, payload: bytes) -> None:
        """Send a packet."""
        self.write(struct.pack("<II", 8 + len(payload), kind) + payload)

    def write(self, data: bytes) -> None:
        """Send bytes; a client that takes none is let go."""
        try:
            self.socket.sendall(data)
        except OSError:
            self.is_gone = True


def _body(body: Body, euler: bool) -> bytes:
    if not body.tracked:
        return struct.pack("<6f" if euler else "<12f", *[math.nan] * (6 if euler else 12))
    x, y, z = body.x * 1e3, body.y * 1e3, body.z * 1e3
    if euler:
        return struct.pack("<6f", x, y, z, 0.0, 0.0, math.degrees(body.theta))
    c, s = math.cos(body.theta), math.sin(body.theta)
    return struct.pack("<12f", x, y, z, c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0)  # the matrix, column by column
