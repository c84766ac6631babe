"""The experiments of a study: a team of real robots, and the same team with one real robot, prepared in several ways.

Each experiment has a laboratory of its own, drawn by its seed. Two sets of real teams, A and B, show how much teams
differ by chance; in a third set of laboratories one robot is real. All controllers use the same believed parameters, as
if one program ran on all robots; virtual robots move with their prepared parameters.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from cmr.experiments.fidelity.preparing import OTHERS, calibrated, diagnosed, moved_by
from cmr.experiments.team.experiment import ExperimentError, run
from cmr.experiments.team.hidden import Laboratory, believed_of
from cmr.experiments.team.plan import Scenario
from cmr.experiments.team.roles import Roles
from cmr.parameters.file import ParameterFile
from cmr.workers import Telling, Workers

REAL_A, REAL_B = "real A", "real B"
UNCALIBRATED, CALIBRATED, DIAGNOSED, POPULATION = "uncalibrated", "calibrated", "diagnosed", "population"
PREPARATIONS = (UNCALIBRATED, CALIBRATED, DIAGNOSED, POPULATION)
PREPARED = "prepared"
SETS = (REAL_A, REAL_B, *PREPARATIONS)
LABORATORIES = 3  # per number: one for either set of real teams, the third for all preparations

Scores = Mapping[str, float]  # of one experiment, by metric, and PREPARED


@dataclass(frozen=True, kw_only=True)
class Study:
    """The subject of the study.

    `real` is the id of the robot that is real in mixed teams, `believed` its parameter file before any preparation.
    `size` scales the differences between real robots, as in Laboratory.
    """

    scenario: Scenario
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
        """The random seed, including that of the laboratory; it is the same for all preparations."""
        return self.number * LABORATORIES + min(SETS.index(self.group), LABORATORIES - 1)


def tasks_of(numbers: Sequence[int], preparations: Sequence[str] = PREPARATIONS) -> list[Task]:
    """Return the tasks of these numbers. The longest come last, so that a study that is stopped has all others."""
    chosen = sorted(preparations, key=lambda name: name == DIAGNOSED)
    return [Task(group, number) for group in (REAL_A, REAL_B, *chosen) for number in numbers]


def perform(study: Study, task: Task) -> Scores:
    """Return the scores of one experiment.

    If a preparation fails, virtual robots use the believed parameters. PREPARED, besides the metrics, is the share of
    robots that were prepared. Raises ExperimentError if the scenario cannot be run.
    """
    laboratory = Laboratory(believed_of(study.believed), task.seed, study.size)
    ids = [robot.robot_id for robot in study.scenario.robots]
    if task.group in (REAL_A, REAL_B):
        return {**run(study.scenario, Roles(study.believed, ids, laboratory), task.seed).metrics, PREPARED: 1.0}
    files = _prepared(study, laboratory, task)
    moves_by = moved_by(files, [robot_id for robot_id in ids if robot_id != study.real], task.seed)
    result = run(study.scenario, Roles(study.believed, (study.real,), laboratory, moves_by), task.seed)
    known = sum(file is not None for file in files)
    return {**result.metrics, PREPARED: known / len(files) if files else 1.0}


def _prepared(study: Study, laboratory: Laboratory, task: Task) -> list[ParameterFile | None]:
    """Return the parameter files of a preparation; None for a robot for which it failed."""
    robots = {UNCALIBRATED: (), POPULATION: (study.real, *OTHERS)}.get(task.group, (study.real,))
    prepare = diagnosed if task.group == DIAGNOSED else calibrated
    return [prepare(laboratory, study.believed, robot_id, task.seed) for robot_id in robots]


def perform_all(study: Study, tasks: Sequence[Task], processes: int) -> Iterator[tuple[Task, Scores]]:
    """Do all tasks, side by side; yield each with its scores when done.

    Raises what `perform` raises, and ExperimentError where a process dies. Closing the generator ends the processes.
    """
    with Workers[Task, tuple[Task, Scores]](processes, partial(_with_task, study), _died) as workers:
        yield from workers.perform(tasks, lambda _sentence: None)


def _with_task(study: Study, task: Task, _tell: Telling) -> tuple[Task, Scores]:
    return task, perform(study, task)


def _died(task: Task, how: str) -> tuple[Task, Scores]:
    raise ExperimentError(f"Experiment {task.number} of {task.group} was not finished. {how}")


def gathered(done: Mapping[Task, Scores]) -> dict[str, list[Scores]]:
    """Return the scores by set, in the order of the tasks' numbers."""
    return {
        name: [done[task] for task in sorted(done, key=lambda one: one.number) if task.group == name]
        for name in SETS
        if any(task.group == name for task in done)
    }
