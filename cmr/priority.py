"""Thread priorities: first what serves motors and sensors, last what only computes."""

import os
import threading
from contextlib import suppress

COMPUTING = 10  # niceness; 19 is the lowest priority


def go_first() -> None:
    """Give this thread real-time priority where the system permits it: see limits.conf(5), `rtprio`.

    If such a thread has to wait for the processor, commands are late and the times of readings are uncertain.
    """
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR)))


def give_way() -> None:
    """Lower this thread's priority below normal, on systems with per-thread priorities."""
    with suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), COMPUTING)
