"""Both buses in one loop: messages on either are handled at once."""

import os
import select
from collections.abc import Callable
from contextlib import suppress

from cmr.bus.process import Process


class Wake:
    """Wakes, from any thread, the thread that waits on its descriptor."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)

    def fileno(self) -> int:
        """Return the descriptor that becomes readable."""
        return self._read

    def __call__(self) -> None:
        """Wake the waiting thread."""
        with suppress(BlockingIOError):  # full: that thread wakes up anyway
            os.write(self._write, b"!")

    def has_come(self) -> bool:
        """Return whether it was called since the last time."""
        try:
            return bool(os.read(self._read, 65536))
        except BlockingIOError:
            return False

    def close(self) -> None:
        """Close the descriptors."""
        os.close(self._read)
        os.close(self._write)


def waiting_for_both(
    process: Process, wake: Wake, take_bus: Callable[[], object], take_ros: Callable[[], object]
) -> Callable[[float], None]:
    """Return the wait function for `Process.loop`: it returns when a message has arrived on either bus.

    `take_bus` handles messages of the bus, `take_ros` those of ROS 2.
    """

    def wait(seconds: float) -> None:
        take_bus()
        select.select([process.bus.fileno(), wake.fileno()], [], [], seconds)
        if wake.has_come():
            take_ros()

    return wait
