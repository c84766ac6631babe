"""Processes that do jobs side by side, one thread each, and that none survives: the one pool of all commands."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Generic, TypeVar

from cmr import threads

Job = TypeVar("Job")
Result = TypeVar("Result")
Telling = Callable[[str], None]

# Processes are started afresh, not forked: a fork would inherit the threads' locks in the state they happen to be in.
START = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class _Progress:
    """A process says how far its job has come."""

    sentence: str


@dataclass(frozen=True)
class _Done(Generic[Result]):
    """A process has done its job."""

    result: Result


@dataclass(frozen=True)
class _Raised:
    """A process failed to do its job."""

    error: Exception


@dataclass(frozen=True)
class _Died:
    """A process ended before its job did; `how` is a sentence on that."""

    how: str


class Workers(Generic[Job, Result]):
    """Processes for jobs; a context manager that leaves none of them behind.

    `work(job, tell)` must be found by name in its module, which each process imports. At most `count` run at once.
    `died(job, how)` is the result of a job whose process died.
    """

    def __init__(self, count: int, work: Callable[[Job, Telling], Result], died: Callable[[Job, str], Result]) -> None:
        self._count, self._work, self._died = count, work, died
        self._workers: list[_Worker[Job, Result]] = []
        self._before: dict[str, str | None] = {}

    def __enter__(self) -> "Workers[Job, Result]":
        # One process for each core: threads inside them would only be in each other's way.
        self._before = {name: os.environ.get(name) for name in threads.ALL}
        os.environ.update(dict.fromkeys(threads.ALL, "1"))
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for name, value in self._before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()

    def perform(self, jobs: Sequence[Job], tell: Telling) -> Iterator[Result]:
        """Yield the result of each job as it ends. `tell` receives sentences on progress.

        A process that dies fails its job, and another takes its place. Raises what `work` raises.
        """
        waiting = deque(jobs)
        while waiting or any(worker.is_busy for worker in self._workers):
            while waiting and (worker := self._idle()):
                worker.begin(waiting.popleft())
            busy = {worker.connection: worker for worker in self._workers if worker.is_busy}
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]
                job, report = worker.job, worker.receive()
                if isinstance(report, _Died):
                    self._workers.remove(worker)
                    yield self._died(job, report.how)
                elif isinstance(report, _Progress):
                    tell(report.sentence)
                elif isinstance(report, _Raised):
                    raise report.error
                else:
                    yield report.result

    def _idle(self) -> "_Worker[Job, Result] | None":
        """Return a worker without a job, a new one if there may be more; None if all are busy."""
        idle = next((worker for worker in self._workers if not worker.is_busy), None)
        if idle is None and len(self._workers) < self._count:
            idle = _Worker(self._work)
            self._workers.append(idle)
        return idle


class _Worker(Generic[Job, Result]):
    """A process that does one job at a time, and the line to it; `job` is there once one has begun."""

    def __init__(self, work: Callable[[Job, Telling], Result]) -> None:
        self.job: Job
        self.is_busy = False
        self.connection, theirs = START.Pipe()
        with _interrupts_held():
            # Not a daemon: what it works on may start processes of its own. It ends with its parent all the same.
            self.process = START.Process(target=_serve, args=(theirs, work))
            self.process.start()
        theirs.close()

    def begin(self, job: Job) -> None:
        """Hand over a job; a process that has died since its last one will be found out by `receive`."""
        self.job, self.is_busy = job, True
        with suppress(OSError):
            self.connection.send(job)

    def receive(self) -> _Progress | _Done[Result] | _Raised | _Died:
        """Return what the process reports of its job."""
        report: _Progress | _Done[Result] | _Raised | _Died
        try:
            report = self.connection.recv()
        except (EOFError, OSError):
            self.process.join()
            report = _Died(_death(self.process.exitcode))
        self.is_busy = isinstance(report, _Progress)
        return report


def _death(exit_code: int | None) -> str:
    how = f"was killed by signal {-exit_code}" if exit_code and exit_code < 0 else f"ended with exit code {exit_code}"
    return f"Its process {how}. If memory ran out, --jobs 1 needs less."


def _serve(connection: Connection, work: Callable[[Job, Telling], Result]) -> None:
    """Do jobs as they come, until the line is closed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent has ended
        while True:
            job = connection.recv()
            report: _Done[Result] | _Raised
            try:
                report = _Done(work(job, lambda sentence: connection.send(_Progress(sentence))))
            except Exception as error:
                report = _Raised(error)
            connection.send(report)


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, whatever it is doing."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while a process is started, which inherits that.

    The terminal sends Ctrl-C to all of us; the parent alone is to act on it.
    """
    resource_tracker.ensure_running()  # when it starts, it lets Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
