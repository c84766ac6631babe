"""Workers for many runs: processes on this computer, or an existing Dask cluster.

Each worker is one process with one thread. A worker that dies is replaced, and its run is repeated.
"""

import logging
import os
import pickle
import signal
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import TypeVar

import dask
from distributed import Client, LocalCluster, as_completed
from distributed.utils import LoopRunner
from tornado.ioloop import IOLoop

R = TypeVar("R")
PATIENCE = 10.0  # s to reach a scheduler
LOOK = 5.0  # s between checks for workers
AHEAD = 3  # runs handed out per thread; the others wait here


class ClusterError(Exception):
    """There are no workers; the text gives the reason and the remedy."""


@contextmanager
def workers(scheduler: str | None = None, count: int | None = None) -> Iterator[Client]:
    """Provide a client of the scheduler at this address, or of `count` local processes (None: one per core).

    Raises ClusterError when the scheduler cannot be reached, or no processes can be started.
    """
    dask.config.set({"distributed.comm.timeouts.connect": PATIENCE})
    # A client that is killed, as any sweep may be, should not print warnings about semaphores, which are cleaned up
    # anyway.
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # errors are reported here, in a sentence
    if scheduler is not None:
        with _client_of(scheduler) as client:
            yield client
        return
    count = count or len(os.sched_getaffinity(0))
    with _deaf_to_interrupts() as loop, _processes(count, loop) as cluster, Client(cluster) as client:
        yield client


@contextmanager
def _deaf_to_interrupts() -> Iterator[IOLoop]:
    """Provide an event loop in a thread with SIGINT blocked, which its child processes inherit.

    Ctrl-C in a terminal reaches all processes. The children end with this process, without messages.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        runner = LoopRunner()
        runner.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        yield runner.loop
    finally:
        runner.stop()


def _client_of(scheduler: str) -> Client:
    try:
        return Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"No Dask scheduler answers at {scheduler!r}. To start one: dask scheduler; then, on each computer: "
            f"{worker_command('tcp://HOST:8786')}"
        ) from error


def worker_command(scheduler: str) -> str:
    """Return the command that starts workers, one per core; threads of one process would block each other."""
    return f"dask worker {scheduler} --nthreads 1 --nworkers -1"


def _processes(count: int, loop: IOLoop) -> LocalCluster:
    try:
        return LocalCluster(
            loop=loop,
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=None,
            silence_logs=logging.CRITICAL,
        )
    except (OSError, RuntimeError) as error:
        raise ClusterError(f"{count} processes cannot be started here ({error}). Fewer may: --workers 1.") from error


@contextmanager
def lookout(client: Client, say: Callable[[], None]) -> Iterator[None]:
    """Call `say` whenever there are no workers: runs wait then, however long."""
    over = Event()
    thread = Thread(target=_look, args=(client, say, over), daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _look(client: Client, say: Callable[[], None], over: Event) -> None:
    there = True
    with suppress(OSError, CancelledError, RuntimeError):  # the scheduler has ended, which `perform` reports
        while True:
            was_there, there = there, bool(client.nthreads())
            if was_there and not there:
                say()
            if over.wait(LOOK):
                return


def perform(
    client: Client, work: Callable[..., R], jobs: Mapping[str, tuple[object, ...]]
) -> Iterator[tuple[str, R | BaseException]]:
    """Run `work(*arguments)` for each job; yield (key, result) when done, with an exception as result of a failed job.

    A job whose worker died is repeated elsewhere. After four dead workers it is given up: the result is Dask's
    KilledWorker (distributed.scheduler.allowed-failures). Raises ClusterError when the scheduler ends, or when a worker
    cannot run any job: it would consume all of them.
    """
    try:
        yield from _performed(client, work, jobs)
    except (OSError, CancelledError) as error:
        raise ClusterError(
            "The Dask scheduler has ended. What is done is kept; the same command goes on from here."
        ) from error


def _performed(
    client: Client, work: Callable[..., R], jobs: Mapping[str, tuple[object, ...]]
) -> Iterator[tuple[str, R | BaseException]]:
    waiting = iter(jobs.items())
    running = as_completed(with_results=True, raise_errors=False)
    names: dict[object, str] = {}
    unpacked = _unpacked_there()
    while True:
        if client.scheduler is None:
            raise CancelledError
        ahead = AHEAD * max(sum(client.nthreads().values()), 1)  # workers come and go
        while len(names) < ahead and (job := next(waiting, None)) is not None:
            key, arguments = job
            future = client.submit(unpacked, pickle.dumps((work, arguments)), key=f"run-{key}", pure=False)
            names[future.key] = key
            running.add(future)
        if not names:
            return
        future, came = next(running)
        if isinstance(came, CancelledError):
            raise came
        failure = _failure_of(came)
        result: R | BaseException = came if failure is None else failure
        if isinstance(result, ImportError):
            raise ClusterError(
                f"{str(result).rstrip('.')}. Install the same CMR on all computers, give PYTHONPATH to workers that "
                "need modules of yours, and start them again. What is done is kept; the same command goes on from here."
            )
        yield names.pop(future.key), result
        future.release()


def _unpacked_there() -> Callable[[bytes], object]:
    """Return a function that can be unpickled without our modules.

    A worker that cannot unpickle its task, because a module is missing, would fail without a message. This function can
    be unpickled anywhere, since Dask sends nested functions by value, and reports what is missing on which computer.
    """

    def unpacked(packed: bytes) -> object:
        import pickle
        from socket import gethostname

        try:
            work, arguments = pickle.loads(packed)
        except Exception as error:  # any exception: another version may lack anything
            raise ImportError(f"A worker on {gethostname()} cannot do the runs: {error}") from error
        return work(*arguments)

    return unpacked


def _failure_of(result: object) -> BaseException | None:
    """Return the error of a failure, which Dask returns directly or as (kind, error, trace); None for a result."""
    if isinstance(result, tuple) and len(result) == 3:
        result = result[1]
    return result if isinstance(result, BaseException) else None
