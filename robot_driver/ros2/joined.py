"""Both buses in one loop: whatever comes on either is handled at once."""

import os
import select
from collections.abc import Callable
from contextlib import suppress

from cmr.bus.process import Process


class Wake:
    """Wakes up, from any thread, the thread that waits for its descriptor."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)

    def fileno(self) -> int:
        """Return the descriptor that becomes readable."""
        return self._read

    def __call__(self) -> None:
        """Wake up the thread that waits."""
        with suppress(BlockingIOError):  # full: that thread wakes up anyway
            os.write(self._write, b"!")

    def has_come(self) -> bool:
        """Return whether anything has come since the last call."""
        try:
            return bool(os.read(self._read, 65536))
        except BlockingIOError:
            return False

    def close(self) -> None:
        """Give the descriptors up."""
        os.close(self._read)
        os.close(self._write)


def waiting_for_both(
    process: Process, wake: Wake, take_bus: Callable[[], object], take_ros: Callable[[], object]
) -> Callable[[float], None]:
    """Return what `Process.loop` waits with: it returns when anything has come on either bus.

    `take_bus` handles what the bus has brought, `take_ros` what has arrived from ROS 2.
    """

    def wait(seconds: float) -> None:
        take_bus()
        select.select([process.bus.fileno(), wake.fileno()], [], [], seconds)
        if wake.has_come():
            take_ros()

    return wait
