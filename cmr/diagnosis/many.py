"""Many diagnoses at once: group logs into jobs, and run them in parallel."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from cmr.diagnosis.job import Job, Outcome, Telling, robots_in
from cmr.recordings.recording import RecordingError
from cmr.workers import Workers

Work = Callable[[Job, Telling], Outcome]


def jobs_of(logs: Sequence[Path], pattern: Job, *, each: bool = False) -> list[Job]:
    """Return the jobs for these logs: one per robot, or, with `each`, one per robot and log.

    `pattern` is a job with the common settings: the robot, if one is selected, and the folder for the results. The logs
    of a single robot are diagnosed directly in that folder. With `each`, a useless log still becomes a job, which will
    fail. Raises RecordingError when a log cannot be opened or holds no robot.
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
    """Yield each log with each of its robots, and a unique name."""
    taken: set[str] = set()
    for log, distinct in zip(logs, distinct_names(logs), strict=True):
        for robot in _robots_of(log, robot_id):
            name = distinct if robot is None else f"{distinct}_robot_{robot}"
            name = next(one for one in (name, *(f"{name}_{k}" for k in range(2, len(taken) + 3))) if one not in taken)
            taken.add(name)
            yield log, robot, name


def distinct_names(logs: Sequence[Path]) -> list[str]:
    """Return the logs' names without endings; logs with the same name get the folders that distinguish them."""
    places = [log.resolve().with_suffix("").parts[1:] for log in logs]
    return ["_".join(place[-_needed(place, places) :]) for place in places]


def _needed(place: tuple[str, ...], places: Sequence[tuple[str, ...]]) -> int:
    """Return how many trailing parts of a path make it unique."""
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
    """Return the jobs, each with the held-out logs that contain its robot.

    Raises RecordingError for a held-out log with none of the robots.
    """
    robots = {log: robots_in(log) for log in jobs[0].held_out}
    diagnosed = {job.robot_id for job in jobs}
    for log, found in robots.items():
        if not diagnosed & set(found):
            raise RecordingError(f"{log}: cannot be held out: it has robots {found}, none of which is diagnosed")
    return [replace(job, held_out=tuple(log for log in job.held_out if job.robot_id in robots[log])) for job in jobs]


class Pool(Workers[Job, Outcome]):
    """A pool of processes for diagnoses; if a process dies, its job has failed."""

    def __init__(self, count: int, work: Work) -> None:
        super().__init__(count, work, _died)


def _died(job: Job, how: str) -> Outcome:
    return Outcome(folder=job.folder, failure=how)
