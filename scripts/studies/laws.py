"""Run the robots of scripts/study_laws in parallel processes."""

from collections.abc import Iterator, Sequence

from cmr.workers import Telling, Workers
from tests.hidden_effects.laws.answers import LawRow, row_of
from tests.hidden_effects.laws.robots import LawCase


def perform(tasks: Sequence[LawCase], jobs: int) -> Iterator[LawRow]:
    """Yield the row of each robot when it is finished; if a process dies, the row of its robot contains the error."""
    with Workers[LawCase, LawRow](jobs, _with_task, _died) as workers:
        yield from workers.perform(tasks, lambda _sentence: None)


def _with_task(task: LawCase, _tell: Telling) -> LawRow:
    return row_of(task)


def _died(task: LawCase, how: str) -> LawRow:
    set_name, hidden, seed = task.key
    return LawRow(set_name=set_name, hidden=hidden, seed=seed, error=how)
