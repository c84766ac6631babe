"""Work off many cases in parallel processes."""

import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from studies.work import row
from tests.hidden_effects.cases import Case
from tests.hidden_effects.rows import Row

Task = tuple[str, Case]  # set, case


def perform(tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    """Yield the row of each task as it is there; a process that dies makes rows of what was in work, with an error."""
    waiting = deque(tasks)
    while waiting:
        yield from _until_a_process_dies(waiting, jobs)


def _until_a_process_dies(waiting: deque[Task], jobs: int) -> Iterator[Row]:
    # Started afresh, not forked: a fork would inherit the threads' locks in the state they happen to be in.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, context, initializer=_end_with_parent)
    running: dict[Future[Row], Task] = {}
    broken = False
    try:
        while (waiting and not broken) or running:
            while waiting and not broken and len(running) < jobs:
                task = waiting.popleft()
                running[pool.submit(row, *task)] = task
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task = running.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    broken = True
                    yield Row(set_name=task[0], case=task[1], error="the process of this log, or of another, died")
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _end_with_parent() -> None:
    """Let this process end with its parent, however that ends."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
