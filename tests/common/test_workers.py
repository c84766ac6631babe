"""Promises of the one pool of processes: results as they come, errors as they are, nobody left behind."""

import os
import signal
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from cmr import threads
from cmr.workers import Telling, Workers


def work(job: str, tell: Telling) -> str:
    """Do what the job says, in a process of the pool."""
    tell(f"begin {job}")
    if job == "raise":
        raise ValueError("not this one")
    if job == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if job == "nested":
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            return pool.submit(str, 7).result()
    return os.environ["OPENBLAS_NUM_THREADS"] + job


def died(job: str, how: str) -> str:
    return f"{job}: {how}"


def test_results_come_with_progress_and_the_environment_is_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    before = {name: os.environ.get(name) for name in threads.ALL}
    said: list[str] = []
    with Workers(1, work, died) as workers:
        results = list(workers.perform(["a", "die", "nested"], said.append))
    assert results == ["1a", "die: Its process was killed by signal 9. If memory ran out, --jobs 1 needs less.", "7"]
    assert said == ["begin a", "begin die", "begin nested"]
    assert {name: os.environ.get(name) for name in threads.ALL} == before


def test_what_a_job_raises_is_raised_and_ends_the_processes() -> None:
    with pytest.raises(ValueError, match="not this one"), Workers(2, work, died) as workers:
        list(workers.perform(["raise", "b"], lambda _sentence: None))
    assert all(not worker.process.is_alive() for worker in workers._workers)
