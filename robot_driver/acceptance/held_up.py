"""Detect delays of this computer, so that the driver is not blamed for them.

A busy computer or a virtual machine does not always get its processors, and the kernel's workers, which carry the bytes
of ports, are delayed as well. A byte that circulates through a pseudo-terminal shows both.
"""

import os
import select
import threading
import time
import tty
from types import TracebackType

from cmr.priority import go_first
from robot_driver.acceptance.filter import SECOND
from robot_driver.acceptance.record import Span

PERIOD = 0.005  # s between two checks
LATE = 0.03  # s; longer delays can affect the results


class HeldUp:
    """Watches the computer; a context manager."""

    def __init__(self) -> None:
        self._stalls: list[Span] = []
        self._looked = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="held up", daemon=True)

    def __enter__(self) -> "HeldUp":
        self._thread.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()

    def longest(self, span: Span) -> float:
        """Return the longest delay of this computer in a span (s); 0 without one."""
        stalls = [*self._stalls, Span(self._looked, time.monotonic_ns())]
        met = [stall.seconds for stall in stalls if stall.end > span.begin and stall.begin < span.end]
        return max((seconds for seconds in met if seconds > LATE), default=0.0)

    def _watch(self) -> None:
        go_first()
        master, slave = os.openpty()
        tty.setraw(slave)
        self._looked = time.monotonic_ns()
        try:
            while not self._stop.wait(PERIOD):
                os.write(master, b"x")
                select.select([slave], [], [], 1.0)
                os.read(slave, 1)
                now = time.monotonic_ns()
                if now - self._looked > LATE * SECOND:
                    self._stalls.append(Span(self._looked, now))
                self._looked = now
        finally:
            os.close(master)
            os.close(slave)
