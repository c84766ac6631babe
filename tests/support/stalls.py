"""When the machine stood still, so that a test which keeps time does not blame the driver for it.

A virtual machine is not always given its processors, and the kernel's workers, which carry the bytes of
pseudo-terminals from one end to the other, wait for a processor like anybody else. A process of its own sees both: on
each processor a thread sleeps for a millisecond at a time and looks at the clock, and one passes a byte through a
pseudo-terminal.
"""

import gc
import multiprocessing
import os
import threading
import time
import tty
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import NamedTuple

from cmr.priority import go_first

PERIOD = 0.001  # s between two looks
LATE = 0.003  # s beyond that after which the machine counts as having stood still
LARGEST_SHARE = 0.5  # of what is measured, that may be excused


class Interval(NamedTuple):
    """From when to when, in s of the monotonic clock, which all processes share."""

    begin: float
    end: float


class Stalls:
    """Watches the machine; a context manager. `seen` holds each stall, up to the last look, ordered by its end.

    A stall begins when the machine was last seen to run, so that it is told by up to a millisecond too long.
    """

    def __init__(self) -> None:
        self.seen: list[Interval] = []

    def __enter__(self) -> "Stalls":
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_watch, args=(other,), daemon=True)
        self._process.start()
        other.close()
        self.look()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._connection.close()
        self._process.join()

    @property
    def pid(self) -> int:
        """The process that watches."""
        assert self._process.pid is not None
        return self._process.pid

    def look(self) -> None:
        """Learn of all that happened until now."""
        self._connection.send(time.monotonic())
        self.seen += self._connection.recv()
        self.seen.sort(key=lambda stall: stall.end)

    def excused(self, late: Sequence[Interval], of: int) -> list[Interval]:
        """Return those in which the machine stood still, of what came late among `of`, and print how many they are.

        Fails where more than half would have to be excused: then nothing was measured.
        """
        self.look()
        excused = [interval for interval in late if self._within(interval)]
        print(f"{len(late)} of {of} late, {len(excused)} of them as the machine stood still")
        assert len(excused) <= LARGEST_SHARE * of, "The machine stands still too often to keep time on it."
        return excused

    def _within(self, interval: Interval) -> bool:
        """Tell whether the machine stood still at some moment of an interval."""
        first = bisect_right(self.seen, interval.begin, key=lambda stall: stall.end)
        return any(stall.begin < interval.end for stall in self.seen[first:])


class _Watch:
    """What the threads of the watching process note."""

    def __init__(self) -> None:
        self._stalls: deque[Interval] = deque()
        self._looked: dict[str, float] = {}
        self._start(self._on_terminal)
        for number in os.sched_getaffinity(0):
            self._start(self._on_processor, number)

    def upto(self, moment: float) -> list[Interval]:
        """Return the new stalls, once all threads have looked after a moment."""
        while min(self._looked.values()) <= moment:
            time.sleep(PERIOD)
        return [self._stalls.popleft() for _ in range(len(self._stalls))]

    def _start(self, target: Callable[..., None], *arguments: object) -> None:
        name = f"{target.__name__} {arguments}"
        self._looked[name] = 0.0
        threading.Thread(target=target, args=(name, *arguments), daemon=True).start()

    def _on_processor(self, name: str, number: int) -> None:
        os.sched_setaffinity(0, {number})
        self._repeat(name, lambda: time.sleep(PERIOD))

    def _on_terminal(self, name: str) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)

        def passed() -> None:
            time.sleep(PERIOD)
            os.write(master, b"x")
            os.read(slave, 1)

        self._repeat(name, passed)

    def _repeat(self, name: str, rest: Callable[[], None]) -> None:
        """Rest again and again, and note when that took too long."""
        _go_before_all()
        last = time.monotonic()
        while True:
            rest()
            now = time.monotonic()
            if now - last > PERIOD + LATE:
                self._stalls.append(Interval(last, now))
            last = self._looked[name] = now


def _go_before_all() -> None:
    """Go before a driver too: one that does not let go of its processor is no machine that stands still."""
    go_first()
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR) + 1))


def _watch(connection: Connection) -> None:
    """Watch until the other end of `connection` closes; at each moment that comes there, send the stalls until then."""
    gc.disable()
    watch = _Watch()
    with suppress(EOFError, OSError):
        while True:
            connection.send(watch.upto(connection.recv()))
