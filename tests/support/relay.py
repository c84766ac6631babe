"""Two buses joined by a bad network: packets between them are lost, late, and overtake one another."""

import heapq
import random
import select
import socket
import struct
import threading
import time
from types import TracebackType
from urllib.parse import urlsplit

GROUP = "239.255.76.67"
LARGEST = 65_536  # bytes of a packet
LONGEST_WAIT = 0.05  # s


class Relay:
    """Carries packets between two buses of this host, given by their URLs; a context manager.

    Each packet is lost with the probability `loss`; the others arrive `delay` [s] later, give or take `jitter` [s], so
    that they overtake one another. Nothing is carried while `joined` is False.
    """

    def __init__(self, urls: tuple[str, str], *, loss: float, delay: float, jitter: float, seed: int = 0) -> None:
        self.joined = True
        self.carried = self.lost = 0
        self._loss, self._delay, self._jitter = loss, delay, jitter
        self._random = random.Random(seed)
        self._ports = [urlsplit(url).port or 0 for url in urls]
        self._ears = [_ear(port) for port in self._ports]
        self._mouths = [_mouth() for _ in urls]
        self._own = {mouth.getsockname()[1] for mouth in self._mouths}
        self._under_way: list[tuple[float, int, int, bytes]] = []
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Relay":
        self._thread.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._ended = True
        self._thread.join()
        for one in (*self._ears, *self._mouths):
            one.close()

    def _run(self) -> None:
        while not self._ended:
            due = self._under_way[0][0] - time.monotonic() if self._under_way else LONGEST_WAIT
            for ear in select.select(self._ears, [], [], min(max(due, 0.0), LONGEST_WAIT))[0]:
                self._take(self._ears.index(ear), *ear.recvfrom(LARGEST))
            while self._under_way and self._under_way[0][0] <= time.monotonic():
                _, _, side, packet = heapq.heappop(self._under_way)
                self._mouths[side].sendto(packet, (GROUP, self._ports[side]))

    def _take(self, side: int, packet: bytes, sender: tuple[str, int]) -> None:
        if sender[1] in self._own or not self.joined:
            return
        if self._random.random() < self._loss:
            self.lost += 1
            return
        self.carried += 1
        due = time.monotonic() + self._delay + self._random.uniform(-self._jitter, self._jitter)
        heapq.heappush(self._under_way, (due, self.carried, 1 - side, packet))


def _ear(port: int) -> socket.socket:
    """Return a socket that hears all that is said on a bus."""
    ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    ear.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_194_304)
    ear.bind((GROUP, port))
    group = struct.pack("=4sl", socket.inet_aton(GROUP), socket.INADDR_ANY)
    ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    return ear


def _mouth() -> socket.socket:
    """Return a socket from which packets reach this host only, and that is known by its port."""
    mouth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    mouth.bind(("", 0))
    return mouth
