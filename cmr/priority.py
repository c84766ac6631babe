"""Who runs first on a busy computer: what serves motors and sensors before all else, what only computes last."""

import os
import threading
from contextlib import suppress

COMPUTING = 10  # niceness; 19 would be the last of all


def go_first() -> None:
    """Have this thread run before all that is not urgent, where the system permits it: see limits.conf(5), `rtprio`.

    While what serves motors and sensors waits for a busy computer, commands are late, and the moments of readings are
    not known.
    """
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR)))


def give_way() -> None:
    """Let this thread run after all that has usual priority; on systems where threads have one of their own."""
    with suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), COMPUTING)
