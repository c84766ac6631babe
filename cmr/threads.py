"""Threads: those of numerical libraries, which are told how many to start, and a second one for compiled code.

Libraries read the variables of the environment at their import.
"""

import os
from collections.abc import Callable

LINEAR_ALGEBRA = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
ALL = (*LINEAR_ALGEBRA, "NUMBA_NUM_THREADS")


def one_thread_for_linear_algebra() -> None:
    """Let linear algebra start no threads, unless the user asks for some; to be called before NumPy is imported.

    Our matrices are small: threads cost more than they save. On a machine that is busy they cost very much, because
    those of OpenBLAS spin while they wait for one that does not get a core: a diagnosis of 4 s then took 60 s on two
    cores.
    """
    for name in LINEAR_ALGEBRA:
        os.environ.setdefault(name, "1")


def in_two_threads(work: Callable[[int, int], None], count: int) -> None:
    """Do `work` on the numbers below `count`, from a first to a last one, which is not included: by halves at once.

    It must let other threads run, as compiled code does. With a single processor, or number, it is done in one go.
    """
    middle = (count + 1) // 2
    if middle == count or len(os.sched_getaffinity(0)) == 1:
        work(0, count)
        return
    from concurrent.futures import ThreadPoolExecutor  # this module is imported before anything that takes time

    with ThreadPoolExecutor(1) as other:
        second = other.submit(work, middle, count)
        work(0, middle)
        second.result()
