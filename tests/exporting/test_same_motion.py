"""The Python file and the C source move as CMR's own model does, and as each other, with every effect."""

from pathlib import Path

import numpy as np
import pytest

from cmr.exporting.robot import ExportedRobot
from cmr.model.catalogue import CATALOGUE, GENERIC_TERMS
from tests.exporting.exported_robots import (
    COMPILER,
    ROBOTS,
    commands,
    driven_by_cmr,
    driven_in_c,
    driven_in_python,
    robot_with,
)

pytestmark = pytest.mark.slow

SPANS = commands(60.0)
SEED = 3
DIFFERENT_ROBOTS = [(), *((name,) for name in CATALOGUE), *ROBOTS]


def distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.max(np.hypot(one[:, 0] - other[:, 0], one[:, 1] - other[:, 1])))


@pytest.mark.parametrize("effects", DIFFERENT_ROBOTS, ids="+".join)
def test_the_exported_robot_drives_the_path_of_cmr(effects: tuple[str, ...], tmp_path: Path) -> None:
    robot: ExportedRobot = robot_with(effects)
    expected = driven_by_cmr(robot, SPANS, SEED)
    states, readings = driven_in_python(robot, SPANS, SEED)
    assert distance(states, expected) < 1e-6  # m
    np.testing.assert_allclose(states, expected, atol=1e-5)
    if COMPILER is None:
        pytest.skip("no C compiler")
    in_c, readings_in_c = driven_in_c(robot, SPANS, tmp_path, SEED)
    assert distance(in_c, expected) < 1e-6  # m
    np.testing.assert_allclose(in_c, states, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(readings_in_c, readings, rtol=0.0, atol=1e-12)


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_generic_terms_are_in_c_what_they_are_in_python(tmp_path: Path) -> None:
    robot, spans = robot_with(tuple(GENERIC_TERMS)), commands(10.0)
    states, _ = driven_in_python(robot, spans)
    in_c, _ = driven_in_c(robot, spans, tmp_path)
    np.testing.assert_allclose(in_c, states, rtol=0.0, atol=1e-12)
