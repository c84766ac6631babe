"""Run the cases of scripts/study_diagnosis in parallel processes."""

from collections.abc import Iterator, Sequence

from cmr.workers import Telling, Workers
from studies.work import row
from tests.hidden_effects.cases import Case
from tests.hidden_effects.rows import Row

Task = tuple[str, Case]  # set, case


def perform(tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    """Yield the row of each task when it is finished; if a process dies, the row of its task contains the error."""
    with Workers[Task, Row](jobs, _with_task, _died) as workers:
        yield from workers.perform(tasks, lambda _sentence: None)


def _with_task(task: Task, _tell: Telling) -> Row:
    return row(*task)


def _died(task: Task, how: str) -> Row:
    return Row(set_name=task[0], case=task[1], error=how)
