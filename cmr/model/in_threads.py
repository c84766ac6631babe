"""Compiled code in a second thread, where there is a second processor."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def in_two_threads(work: Callable[[int, int], None], count: int) -> None:
    """Do `work` on the numbers below `count`, from a first to a last one, which is not included: by halves at once.

    It must let other threads run, as compiled code does. With a single processor, or number, it is done in one go.
    """
    middle = (count + 1) // 2
    if middle == count or len(os.sched_getaffinity(0)) == 1:
        work(0, count)
        return
    with ThreadPoolExecutor(1) as other:
        second = other.submit(work, middle, count)
        work(0, middle)
        second.result()
