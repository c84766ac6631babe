"""Threads of numerical libraries: how many they start is set by variables of the environment, read at their import."""

import os

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
