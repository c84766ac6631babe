"""How much of a busy computer a process takes: threads of numerical libraries, and what runs first.

How many threads the libraries start is set by variables of the environment, which they read at their import.
"""

import os
import threading
from contextlib import suppress

LINEAR_ALGEBRA = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
THREADS = (*LINEAR_ALGEBRA, "NUMBA_NUM_THREADS")
COMPUTING = 10  # niceness; 19 would be the last of all


def one_thread_for_linear_algebra() -> None:
    """Let linear algebra start no threads, unless the user asks for some; to be called before NumPy is imported.

    Our matrices are small: threads cost more than they save. On a machine that is busy they cost very much, because
    those of OpenBLAS spin while they wait for one that does not get a core: a diagnosis of 4 s then took 60 s on two
    cores.
    """
    for name in LINEAR_ALGEBRA:
        os.environ.setdefault(name, "1")


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
