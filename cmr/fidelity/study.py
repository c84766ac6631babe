"""The experiments of a study: a team of real robots, and the same team with one real robot, prepared in several ways.

Each experiment has a laboratory of its own, drawn by its seed. Two sets of real teams, A and B, tell how much teams
differ anyway; in a third set of laboratories one robot is real. Everybody steers by what is believed of all robots, as
where one program runs on all of them; virtual robots move by what they were prepared with.
"""

import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread

from cmr import threads
from cmr.fidelity.preparing import OTHERS, calibrated, diagnosed, moved_by
from cmr.parameters.file import ParameterFile
from cmr.team.casting import Cast, ScenarioLike
from cmr.team.experiment import run
from cmr.team.hidden import Laboratory, believed_of

REAL_A, REAL_B = "real A", "real B"
UNCALIBRATED, CALIBRATED, DIAGNOSED, POPULATION = "uncalibrated", "calibrated", "diagnosed", "population"
PREPARATIONS = (UNCALIBRATED, CALIBRATED, DIAGNOSED, POPULATION)
PREPARED = "prepared"
SETS = (REAL_A, REAL_B, *PREPARATIONS)
LABORATORIES = 3  # of each number: one for either set of real teams, the third for all preparations alike

Scores = Mapping[str, float]  # of one experiment, by metric, and PREPARED


@dataclass(frozen=True, kw_only=True)
class Study:
    """What is compared.

    `real` is the id of the robot that is real in mixed teams, `believed` its parameter file before any preparation.
    `size` scales what sets real robots apart, as in Laboratory.
    """

    scenario: ScenarioLike
    believed: ParameterFile
    real: int
    size: float = 1.0


@dataclass(frozen=True)
class Task:
    """An experiment: its set, one of SETS, and its number from 0 on."""

    group: str
    number: int

    @property
    def seed(self) -> int:
        """What fixes all that is random, the laboratory included; it is the same for all preparations."""
        return self.number * LABORATORIES + min(SETS.index(self.group), LABORATORIES - 1)


def tasks_of(numbers: Sequence[int], preparations: Sequence[str] = PREPARATIONS) -> list[Task]:
    """Return what there is to do for so many numbers, what takes longest at last: who stops before has the rest."""
    chosen = sorted(preparations, key=lambda name: name == DIAGNOSED)
    return [Task(group, number) for group in (REAL_A, REAL_B, *chosen) for number in numbers]


def perform(study: Study, task: Task) -> Scores:
    """Return the scores of one experiment.

    Where a preparation fails, virtual robots move by what is believed. PREPARED, beside the metrics, is the share of
    the robots to be prepared that were. Raises ExperimentError where the scenario cannot be run.
    """
    laboratory = Laboratory(believed_of(study.believed), task.seed, study.size)
    ids = [robot.robot_id for robot in study.scenario.robots]
    if task.group in (REAL_A, REAL_B):
        return {**run(study.scenario, Cast(study.believed, ids, laboratory), task.seed).metrics, PREPARED: 1.0}
    files = _prepared(study, laboratory, task)
    moves_by = moved_by(files, [robot_id for robot_id in ids if robot_id != study.real], task.seed)
    result = run(study.scenario, Cast(study.believed, (study.real,), laboratory, moves_by), task.seed)
    known = sum(file is not None for file in files)
    return {**result.metrics, PREPARED: known / len(files) if files else 1.0}


def _prepared(study: Study, laboratory: Laboratory, task: Task) -> list[ParameterFile | None]:
    """Return the parameter files that a preparation came to; None for a robot with which it failed."""
    robots = {UNCALIBRATED: (), POPULATION: (study.real, *OTHERS)}.get(task.group, (study.real,))
    prepare = diagnosed if task.group == DIAGNOSED else calibrated
    return [prepare(laboratory, study.believed, robot_id, task.seed) for robot_id in robots]


def perform_all(study: Study, tasks: Sequence[Task], processes: int) -> Iterator[tuple[Task, Scores]]:
    """Do all tasks, side by side; yield each with its scores as it is done.

    Raises what `perform` raises. Whoever stops listening ends the processes.
    """
    spawn = get_context("spawn")
    with _single_threads(), ProcessPoolExecutor(processes, mp_context=spawn, initializer=_end_with_parent) as pool:
        futures = {pool.submit(perform, study, task): task for task in tasks}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in active_children():  # what they are at may take minutes
                child.terminate()
            raise


def _end_with_parent() -> None:
    """In a process of the pool: leave Ctrl-C to the parent, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is None:
        return

    def watch(sentinel: int) -> None:
        wait([sentinel])
        os._exit(1)

    Thread(target=watch, args=(parent.sentinel,), daemon=True).start()


def gathered(done: Mapping[Task, Scores]) -> dict[str, list[Scores]]:
    """Return the scores by set, in the order of the tasks' numbers."""
    return {
        name: [done[task] for task in sorted(done, key=lambda one: one.number) if task.group == name]
        for name in SETS
        if any(task.group == name for task in done)
    }


@contextmanager
def _single_threads() -> Iterator[None]:
    """Let processes started meanwhile compute with one thread each: more would only be in each other's way."""
    # A study that is killed, as any may be, needs no word about semaphores, which are tidied up all the same.
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    before = {name: os.environ.get(name) for name in threads.ALL}
    os.environ.update(dict.fromkeys(threads.ALL, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
