"""Exported robots of scripts/study_export that were once diagnosed wrong, each for a cause that is fixed."""

import sys

import pytest

from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from studies.exported_robots import Task, run_task

pytestmark = [pytest.mark.slow, pytest.mark.further]
ONCE_WRONG = {
    Task("python", "same", 13): "a tracked point that is off in place of a surface patch a little elsewhere",
    Task("python", "same", 15): "saturation, where the mean of two commands was in force in place of both",
    Task("mjcf", "same", 1): "a law of the encoders, where delays were rounded to 2 ms",
    Task("mjcf", "same", 13): "a law of the wheels' slip, where wheels were ahead of their speeds",
    Task("mjcf", "planted", 21): "nothing, where all readings were a time step old",
    Task("mjcf", "planted", 22): "motors and encoders that are apart, where the smaller wheel had less inertia",
}


@pytest.mark.parametrize("task", ONCE_WRONG, ids=lambda task: f"{task.target}-{task.kind}-{task.seed}")
def test_a_robot_that_was_diagnosed_wrong_is_diagnosed_right(task: Task) -> None:
    result = run_task(task)
    assert result.right, (ONCE_WRONG[task], result)
