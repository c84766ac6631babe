"""Measure CPU times of several functions alternately on one core, so that a slowdown of the machine affects all."""

import os
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

REPETITIONS = 9
SHORTEST = 0.03  # s; a repetition calls its function as often as needed to last this long
BANDWIDTH_NUMBERS = 20_000_000  # 160 MB: far larger than any cache

Clocked: TypeAlias = Callable[[int], float]  # calls a function this many times, and returns the CPU seconds


@dataclass(frozen=True)
class Timing:
    """CPU time of one call [s] over the repetitions."""

    median: float
    fastest: float


def pin() -> int:
    """Pin this process, and those it starts, to one core; return its number."""
    core = max(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return core


@contextmanager
def all_cores() -> Iterator[None]:
    """Let this process, and those it starts, use all cores within the context."""
    pinned = os.sched_getaffinity(0)
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    try:
        yield
    finally:
        os.sched_setaffinity(0, pinned)


def clocked(work: Callable[[], object]) -> Clocked:
    """Return a version of the function that is timed by this process's CPU clock."""

    def run(times: int) -> float:
        before = time.process_time()
        for _ in range(times):
            work()
        return time.process_time() - before

    return run


def in_turns(
    works: Mapping[str, Clocked], repetitions: int = REPETITIONS, shortest: float = SHORTEST
) -> dict[str, Timing]:
    """Measure the functions alternately, each once per repetition; return their timings by name."""
    times = {name: max(1, int(shortest / max(work(1), 1e-7))) for name, work in works.items()}
    times = {name: max(1, int(shortest / max(work(times[name]) / times[name], 1e-9))) for name, work in works.items()}
    seconds: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(repetitions):
        for name, work in works.items():
            seconds[name].append(work(times[name]) / times[name])
    return {name: Timing(statistics.median(values), min(values)) for name, values in seconds.items()}


def read_modify_write() -> Clocked:
    """Return the function for measuring memory bandwidth: it multiplies a large array in place."""
    numbers = np.ones(BANDWIDTH_NUMBERS)
    return clocked(lambda: np.multiply(numbers, 0.999, out=numbers))


def bandwidth(timing: Timing) -> float:
    """Return the bytes that `read_modify_write` reads and writes per second."""
    return 2 * 8 * BANDWIDTH_NUMBERS / timing.median
