"""Interface of all trackers: sockets to wait on, samples, and problems of the connection."""

import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, TypeAlias

from cmr.tracker.frames import Sample

Clock: TypeAlias = Callable[[], int]  # monotonic time [ns]
RETRY = 1.0  # s between two attempts to reach a tracker
CONNECT_TIMEOUT = 0.4  # s
SILENT = 2.0  # s without a byte after which it reconnects


class SourceError(Exception):
    """A tracker cannot be used at all; the text says why and what to do."""


class Source(Protocol):
    """A tracker. `problem` is a sentence about its problem, empty if there is none."""

    problem: str
    uncertainty: str  # uncertainty of its stamps, in words

    def filenos(self) -> list[int]:
        """Return the file descriptors that become readable when a sample arrives."""

    def read(self) -> list[Sample]:
        """Return the samples received, without blocking."""

    def tend(self, now: float) -> None:
        """Maintain the connection; called some times a second, with the monotonic time [s]."""

    def close(self) -> None:
        """Release all resources."""


class Stream:
    """A TCP connection to a server that reconnects when it breaks; `problem` says why there is none."""

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
        """Return the file descriptor to wait on, if there is a connection."""
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
        """Return the bytes received; closes the connection if the server has closed it."""
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
        """Close the connection; it will be tried again."""
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
