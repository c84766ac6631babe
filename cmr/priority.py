"""Who runs first on a busy computer: what serves motors and sensors before all else, what only computes last."""

import os
import threading
from contextlib import suppress

LOWEST_REAL_TIME = 1
COMPUTING = 10  # niceness; 19 would be the last of all


def keep_time() -> None:
    """Give this thread, and those that it starts from now on, real-time priority; else leave all as it is.

    It takes the right to: root, CAP_SYS_NICE, or a limit on `rtprio` (see limits.conf(5)). While a driver waits for a
    busy computer, commands are late and the moments of readings are not known.
    """
    with suppress(AttributeError, OSError):  # not on this system; not permitted
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(LOWEST_REAL_TIME))


def give_way() -> None:
    """Let this thread run after all that has usual priority; on systems where threads have one of their own."""
    with suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), COMPUTING)
