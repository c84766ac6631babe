"""A pool of worker processes with one thread each, used by all commands; none outlives its parent."""

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

# Processes are spawned, not forked: a fork would inherit the locks of threads in an arbitrary state.
START = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class _Progress:
    """A message from a process on the progress of its job."""

    sentence: str


@dataclass(frozen=True)
class _Done(Generic[Result]):
    """A message from a process: its job is done."""

    result: Result


@dataclass(frozen=True)
class _Raised:
    """A message from a process: its job raised an error."""

    error: Exception


@dataclass(frozen=True)
class _Died:
    """A process ended before its job; `how` is a sentence on the cause."""

    how: str


class Workers(Generic[Job, Result]):
    """A pool of processes for jobs; a context manager that ends all of them on exit.

    `work(job, tell)` must be a module-level function, because each process imports it by name. At most `count` run at
    once. `died(job, how)` is the result of a job whose process died.
    """

    def __init__(self, count: int, work: Callable[[Job, Telling], Result], died: Callable[[Job, str], Result]) -> None:
        self._count, self._work, self._died = count, work, died
        self._workers: list[_Worker[Job, Result]] = []
        self._before: dict[str, str | None] = {}

    def __enter__(self) -> "Workers[Job, Result]":
        # One process per core; further threads inside them would only compete.
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
        """Return an idle worker, starting one if the limit allows; None if all are busy."""
        idle = next((worker for worker in self._workers if not worker.is_busy), None)
        if idle is None and len(self._workers) < self._count:
            idle = _Worker(self._work)
            self._workers.append(idle)
        return idle


class _Worker(Generic[Job, Result]):
    """A process that does one job at a time, and the connection to it; `job` is set once one has begun."""

    def __init__(self, work: Callable[[Job, Telling], Result]) -> None:
        self.job: Job
        self.is_busy = False
        self.connection, theirs = START.Pipe()
        with _interrupts_held():
            # Not a daemon, because a job may start processes of its own. It still ends with its parent.
            self.process = START.Process(target=_serve, args=(theirs, work))
            self.process.start()
        theirs.close()

    def begin(self, job: Job) -> None:
        """Hand over a job; if the process has died since its last job, `receive` will notice."""
        self.job, self.is_busy = job, True
        with suppress(OSError):
            self.connection.send(job)

    def receive(self) -> _Progress | _Done[Result] | _Raised | _Died:
        """Return the process's next message about its job."""
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
    """Do jobs as they arrive, until the connection is closed."""
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
    """Block Ctrl-C while a process is started, which inherits the blocked signal.

    The terminal sends Ctrl-C to all processes, but only the parent should act on it.
    """
    resource_tracker.ensure_running()  # when it starts, it unblocks Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
