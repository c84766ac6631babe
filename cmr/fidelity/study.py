"""The experiments of a study: a team of real robots, and the same team with one real robot, prepared in several ways.

Each experiment has a laboratory of its own, drawn by its seed. Two sets of real teams, A and B, tell how much teams
differ anyway; in a third set of laboratories one robot is real. Everybody steers by what is believed of all robots, as
where one program runs on all of them; virtual robots move by what they were prepared with.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context

from cmr.fidelity.preparing import calibrated, diagnosed, population
from cmr.model.parameters import DEFINITIONS, RobotParameters
from cmr.parameters.file import ParameterFile
from cmr.team.casting import Cast, ScenarioLike
from cmr.team.experiment import run
from cmr.team.hidden import Laboratory

REAL_A, REAL_B = "real A", "real B"
UNCALIBRATED, CALIBRATED, DIAGNOSED, POPULATION = "uncalibrated", "calibrated", "diagnosed", "population"
PREPARATIONS = (UNCALIBRATED, CALIBRATED, DIAGNOSED, POPULATION)
SETS = (REAL_A, REAL_B, "one real")  # the third has all preparations of the same laboratories

# One process for each core: threads of linear algebra inside them would only be in each other's way.
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

Scores = Mapping[str, float]  # of one experiment, by metric


@dataclass(frozen=True, kw_only=True)
class Study:
    """What is compared.

    `real` is the id of the robot that is real in mixed teams, `believed` its parameter file before any preparation.
    `size` scales what sets real robots apart, as in Laboratory; `preparations` are some of PREPARATIONS.
    """

    scenario: ScenarioLike
    believed: ParameterFile
    real: int
    size: float = 1.0
    preparations: Sequence[str] = PREPARATIONS


@dataclass(frozen=True)
class Task:
    """The experiments of one laboratory: its set, one of SETS, and its number from 0 on."""

    group: str
    number: int

    @property
    def seed(self) -> int:
        """What fixes all that is random; no two tasks have the same."""
        return self.number * len(SETS) + SETS.index(self.group)


def tasks_of(numbers: Sequence[int]) -> list[Task]:
    """Return what there is to do for so many seeds, the longest tasks first."""
    return [Task(group, number) for group in reversed(SETS) for number in numbers]


def perform(study: Study, task: Task) -> dict[str, Scores]:
    """Return the scores of the experiments of one laboratory: by set, or by preparation.

    Raises ExperimentError where the scenario cannot be run, or the real robot not be prepared.
    """
    believed = {name: study.believed.value(name) for name in DEFINITIONS}
    laboratory = Laboratory(believed, task.seed, study.size)
    ids = [robot.robot_id for robot in study.scenario.robots]
    if task.group in (REAL_A, REAL_B):
        return {task.group: run(study.scenario, Cast(study.believed, ids, laboratory), task.seed).metrics}
    virtual = [robot_id for robot_id in ids if robot_id != study.real]
    return {
        name: run(study.scenario, Cast(study.believed, (study.real,), laboratory, moves_by), task.seed).metrics
        for name, moves_by in _prepared(study, laboratory, virtual, task.seed)
    }


def _prepared(
    study: Study, laboratory: Laboratory, virtual: list[int], seed: int
) -> Iterator[tuple[str, dict[int, RobotParameters]]]:
    """Yield the preparations, and what the virtual robots then move by."""
    believed, chosen = study.believed, study.preparations
    if UNCALIBRATED in chosen:
        yield UNCALIBRATED, {}
    known = None
    if CALIBRATED in chosen or POPULATION in chosen:
        known = calibrated(laboratory, believed, study.real, seed)
    if known and CALIBRATED in chosen:
        yield CALIBRATED, dict.fromkeys(virtual, known.robot_parameters)
    if DIAGNOSED in chosen:
        found = diagnosed(laboratory, believed, study.real, seed)
        yield DIAGNOSED, dict.fromkeys(virtual, found.robot_parameters)
    if known and POPULATION in chosen:
        yield POPULATION, population(laboratory, believed, known, virtual, seed)


def perform_all(
    study: Study, tasks: Sequence[Task], processes: int, tell: Callable[[int], None] = lambda _done: None
) -> dict[str, list[Scores]]:
    """Do all tasks, side by side; return the scores by set or preparation, in the order of the tasks' numbers.

    `tell` is told how many are done. Raises what `perform` raises.
    """
    found: dict[Task, dict[str, Scores]] = {}
    with _single_threads(), ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(perform, study, task): task for task in tasks}
        try:
            for done, future in enumerate(as_completed(futures), 1):
                found[futures[future]] = future.result()
                tell(done)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    scores: dict[str, list[Scores]] = {}
    for task in sorted(found, key=lambda one: one.seed):
        for name, one in found[task].items():
            scores.setdefault(name, []).append(one)
    return scores


@contextmanager
def _single_threads() -> Iterator[None]:
    """Let processes started meanwhile compute with one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
