"""Many diagnoses at once: which logs belong together, and processes that work them off side by side."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import TracebackType

from cmr import threads
from cmr.diagnosis.job import Job, Outcome, Telling, robots_in
from cmr.recordings.recording import RecordingError

Work = Callable[[Job, Telling], Outcome]

# Processes are started afresh, not forked: a fork would inherit the threads' locks in the state they happen to be in.
START = multiprocessing.get_context("spawn")


def jobs_of(logs: Sequence[Path], pattern: Job, *, each: bool = False) -> list[Job]:
    """Return the jobs that these logs make: one for each robot, or, with `each`, for each robot of each log.

    `pattern` is a job with all that they have in common: its robot, if one is asked for, and the folder that holds
    theirs. One robot's logs alone are diagnosed right there. With `each`, a log that is of no use is a job all the
    same, which will fail.
    Raises RecordingError when a log cannot be opened or holds no robot.
    """
    if each:
        jobs = [
            replace(pattern, logs=(log,), robot_id=robot_id, folder=pattern.folder / name)
            for log, robot_id, name in _named(logs, pattern.robot_id)
        ]
    elif pattern.robot_id is not None:
        jobs = [replace(pattern, logs=tuple(logs))]
    else:
        robots = {log: robots_in(log) for log in logs}
        present = sorted({robot_id for found in robots.values() for robot_id in found})
        jobs = [
            replace(
                pattern,
                logs=tuple(log for log in logs if robot_id in robots[log]),
                robot_id=robot_id,
                folder=pattern.folder / f"robot_{robot_id}" if len(present) > 1 else pattern.folder,
            )
            for robot_id in present
        ]
    return _with_held_out(jobs) if pattern.held_out and pattern.robot_id is None else jobs


def _named(logs: Sequence[Path], robot_id: int | None) -> Iterator[tuple[Path, int | None, str]]:
    """Yield each log with each of its robots, and a name that no other has."""
    taken: set[str] = set()
    for log, distinct in zip(logs, distinct_names(logs), strict=True):
        for robot in _robots_of(log, robot_id):
            name = distinct if robot is None else f"{distinct}_robot_{robot}"
            name = next(one for one in (name, *(f"{name}_{k}" for k in range(2, len(taken) + 3))) if one not in taken)
            taken.add(name)
            yield log, robot, name


def distinct_names(logs: Sequence[Path]) -> list[str]:
    """Return the logs' names without endings; of logs of the same name with the folders that distinguish them."""
    places = [log.resolve().with_suffix("").parts[1:] for log in logs]
    return ["_".join(place[-_needed(place, places) :]) for place in places]


def _needed(place: tuple[str, ...], places: Sequence[tuple[str, ...]]) -> int:
    """Return how many parts of a path, from its end, no different one has."""
    others = [other for other in places if other != place]
    return next(k for k in range(1, len(place) + 1) if k == len(place) or all(o[-k:] != place[-k:] for o in others))


def _robots_of(log: Path, robot_id: int | None) -> Sequence[int | None]:
    if robot_id is not None:
        return (robot_id,)
    try:
        return robots_in(log)
    except RecordingError:
        return (None,)


def _with_held_out(jobs: list[Job]) -> list[Job]:
    """Return the jobs, each with those of the held-out logs that its robot is in.

    Raises RecordingError for a held-out log in which none of the robots is.
    """
    robots = {log: robots_in(log) for log in jobs[0].held_out}
    diagnosed = {job.robot_id for job in jobs}
    for log, found in robots.items():
        if not diagnosed & set(found):
            raise RecordingError(f"{log}: cannot be held out: it has robots {found}, none of which is diagnosed")
    return [replace(job, held_out=tuple(log for log in job.held_out if job.robot_id in robots[log])) for job in jobs]


class Pool:
    """Processes that do jobs side by side; use it as a context manager, which leaves none of them behind.

    `work` must be found by name in its module: each process imports it. At most `count` run at once.
    """

    def __init__(self, count: int, work: Work) -> None:
        self._count, self._work = count, work
        self._workers: list[_Worker] = []

    def __enter__(self) -> "Pool":
        # One process for each core: threads inside them would only be in each other's way.
        for name in threads.ALL:
            os.environ[name] = "1"
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()

    def perform(self, jobs: Sequence[Job], tell: Telling) -> Iterator[Outcome]:
        """Yield what came of each job as it ends. `tell` receives sentences on progress.

        A process that dies fails its job, and another takes its place.
        """
        waiting = deque(jobs)
        while waiting or any(worker.job for worker in self._workers):
            while waiting and (worker := self._idle()):
                worker.begin(waiting.popleft())
            busy = {worker.connection: worker for worker in self._workers if worker.job}
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]
                said = worker.hear()
                if isinstance(said, str):
                    tell(said)
                else:
                    if not worker.alive:
                        self._workers.remove(worker)
                    yield said

    def _idle(self) -> "_Worker | None":
        """Return a worker without a job, a new one if there may be more; None if all are busy."""
        idle = next((worker for worker in self._workers if not worker.job), None)
        if idle is None and len(self._workers) < self._count:
            idle = _Worker(self._work)
            self._workers.append(idle)
        return idle


class _Worker:
    """A process that does one job at a time, and the line to it."""

    def __init__(self, work: Work) -> None:
        self.job: Job | None = None
        self.alive = True
        self.connection, theirs = START.Pipe()
        with _interrupts_held():
            self.process = START.Process(target=_serve, args=(theirs, work), daemon=True)
            self.process.start()
        theirs.close()

    def begin(self, job: Job) -> None:
        """Hand over a job; a process that has died since its last one will be found out by `hear`."""
        self.job = job
        with suppress(OSError):
            self.connection.send(job)

    def hear(self) -> str | Outcome:
        """Return a sentence on what is being done, or what came of the job."""
        assert self.job is not None
        try:
            said: str | Outcome = self.connection.recv()
        except (EOFError, OSError):
            self.alive = False
            self.process.join()
            said = Outcome(folder=self.job.folder, failure=_death(self.process.exitcode))
        if isinstance(said, Outcome):
            self.job = None
        return said


def _death(exit_code: int | None) -> str:
    how = f"was killed by signal {-exit_code}" if exit_code and exit_code < 0 else f"ended with exit code {exit_code}"
    return f"Its process {how}. If memory ran out, --jobs 1 needs less."


def _serve(connection: Connection, work: Work) -> None:
    """Do jobs as they come, until the line is closed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent has ended
        while True:
            connection.send(work(connection.recv(), connection.send))


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
