"""What every kind of tracker offers: sockets to wait at, samples, and what is wrong with the connection."""

import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, TypeAlias

from cmr.tracker.frames import Sample

Clock: TypeAlias = Callable[[], int]  # monotonic time [ns]
RETRY = 1.0  # s between two attempts to reach a tracker
CONNECT_TIMEOUT = 0.4  # s
SILENT = 2.0  # s without a byte after which a connection is made again


class SourceError(Exception):
    """A tracker cannot be used at all; the text says why and what to do."""


class Source(Protocol):
    """A tracker. `problem` is a sentence on what is wrong with it, empty if nothing is."""

    problem: str
    uncertainty: str  # what is not known about its stamps

    def filenos(self) -> list[int]:
        """Return the file descriptors that become readable when a sample comes."""

    def read(self) -> list[Sample]:
        """Return the samples that have come, without waiting."""

    def tend(self, now: float) -> None:
        """Keep the connection: called some times a second, with the monotonic time [s]."""

    def close(self) -> None:
        """Give everything back."""


class Stream:
    """A TCP connection to a server, which is made again when it breaks; `problem` says why there is none."""

    def __init__(self, host: str, port: int, clock: Clock) -> None:
        self.problem = f"Not connected to {host}:{port} yet."
        self._address, self._clock = (host, port), clock
        self._socket: socket.socket | None = None
        self._tried = self.heard = -1e9

    @property
    def is_open(self) -> bool:
        """Whether there is a connection."""
        return self._socket is not None

    def filenos(self) -> list[int]:
        """Return the file descriptor to wait at, if there is a connection."""
        return [] if self._socket is None else [self._socket.fileno()]

    def connect(self, now: float) -> bool:
        """Connect if it is time to try; return whether a new connection was made."""
        if self._socket is not None or now - self._tried < RETRY:
            return False
        self._tried = now
        host, port = self._address
        try:
            made = socket.create_connection(self._address, CONNECT_TIMEOUT)
        except OSError as error:
            self.problem = f"No connection to {host}:{port}: {error.strerror or error}."
            return False
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        made.setblocking(False)
        self._socket, self.problem, self.heard = made, "", now
        return True

    def send(self, data: bytes) -> None:
        """Send a few bytes."""
        if self._socket is not None:
            try:
                self._socket.sendall(data)
            except OSError as error:
                self.drop(str(error.strerror or error))

    def receive(self) -> bytes:
        """Return what has come; the connection is given up where the server has."""
        parts: list[bytes] = []
        while self._socket is not None:
            try:
                part = self._socket.recv(1 << 18)
            except BlockingIOError:
                break
            except OSError as error:
                self.drop(str(error.strerror or error))
                break
            if not part:
                self.drop("the server closed it")
                break
            parts.append(part)
            if len(part) < 1 << 18:
                break
        if parts:
            self.heard = self._clock() / 1e9
        return b"".join(parts)

    def drop(self, why: str) -> None:
        """Give the connection up; it is tried again."""
        host, port = self._address
        self.problem = f"The connection to {host}:{port} broke: {why}."
        self.close()
        self._tried = self._clock() / 1e9

    def close(self) -> None:
        """Close the connection, if there is one."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.close()
            self._socket = None
