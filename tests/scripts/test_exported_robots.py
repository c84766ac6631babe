"""Exported robots of scripts/study_export that were once diagnosed wrong, each for a cause that was mended."""

import importlib
import sys
from typing import Any

import pytest

from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
study: Any = importlib.import_module("studies.exported_robots")

pytestmark = [pytest.mark.slow, pytest.mark.further]
ONCE_WRONG = {
    study.Task("python", "same", 13): "a tracked point that is off in place of a surface patch a little elsewhere",
    study.Task("python", "same", 15): "saturation, where the mean of two commands was in force in place of both",
    study.Task("mjcf", "same", 1): "a law of the encoders, where delays were rounded to 2 ms",
    study.Task("mjcf", "planted", 21): "nothing, where all readings were a time step old",
    study.Task("mjcf", "planted", 22): "motors and encoders that are apart, where the smaller wheel had less inertia",
}


@pytest.mark.parametrize("task", ONCE_WRONG, ids=lambda task: f"{task.target}-{task.kind}-{task.seed}")
def test_a_robot_that_was_diagnosed_wrong_is_diagnosed_right(task: Any) -> None:
    found = study.studied(task)
    assert found.right, (ONCE_WRONG[task], found)
