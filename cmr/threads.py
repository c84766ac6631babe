"""Limit the threads of numerical libraries, through environment variables that are read at their import."""

import os

LINEAR_ALGEBRA = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
ALL = (*LINEAR_ALGEBRA, "NUMBA_NUM_THREADS")


def one_thread_for_linear_algebra() -> None:
    """Disable threads in linear algebra unless the user has set a number; call this before NumPy is imported.

    Our matrices are small, so threads cost more than they save. On a busy machine they cost a lot, because OpenBLAS
    threads spin while waiting for one that has no core: a diagnosis of 4 s then took 60 s on two cores.
    """
    for name in LINEAR_ALGEBRA:
        os.environ.setdefault(name, "1")
