"""The Python file and the C source move as CMR's own model does, and as each other, with every effect."""

from pathlib import Path

import numpy as np
import pytest

from cmr.exporting.carried import Carry, of_robot
from cmr.exporting.robot import ExportedRobot
from cmr.model.catalogue import CATALOGUE, GENERIC_TERMS, learn, unlearn
from cmr.model.laws import Law
from cmr.model.parameters import RobotParameters
from tests.exporting.exported_robots import (
    COMPILER,
    PAPER,
    ROBOTS,
    commands,
    driven_by_cmr,
    driven_in_c,
    driven_in_python,
    robot_with,
)

pytestmark = pytest.mark.slow

SPANS = commands(30.0)
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


LAWS = {
    Law("law_cost", "yaw_rate", ("w * v**2", "disc(px, 0.2, 0.5)"), "", {"px": 0.3}): (-0.3, 0.1),
    Law(
        "law_rich",
        "wheel_acceleration",
        ("low_pass(abs(psi), tau) * psi", "cos(theta) * sign(u)", "step(t, begin) * exp(-since_turn / tau)"),
        "opposite",
        {"tau": 5.0, "begin": 20.0037},
    ): (-0.05, 1.0, 2.0),
    Law("law_counts", "encoder_rate", ("tanh(psi / fast)", "dead_zone(effort, 0.1)"), "left", {"fast": 4.0}): (
        0.1,
        0.2,
    ),
    Law("law_gyro", "gyro", ("w * abs(v)",)): (0.1,),
}


def test_laws_of_the_motion_are_exported_with_the_model_and_those_of_sensors_are_not(tmp_path: Path) -> None:
    values: dict[str, float] = {}
    for law, coefficients in LAWS.items():
        learn(law)
        values |= dict(zip(law.coefficients, coefficients, strict=True))
        values |= {law.parameter_of(name): value for name, value in law.constants.items()}
    try:
        robot, spans = ExportedRobot(0, RobotParameters(*PAPER, effects=values)), commands(30.0)
        expected = driven_by_cmr(robot, spans, SEED)
        states, _ = driven_in_python(robot, spans, SEED)
        assert distance(states, expected) < 1e-6  # m
        np.testing.assert_allclose(states, expected, atol=1e-5)
        carried = {name: one.how for name, one in of_robot("python", robot).items()}
        assert carried.pop("law_gyro") is Carry.NOT
        assert {*carried.values()} == {Carry.EXACTLY}
        if COMPILER is None:
            pytest.skip("no C compiler")
        in_c, _ = driven_in_c(robot, spans, tmp_path, SEED)
        np.testing.assert_allclose(in_c, states, rtol=0.0, atol=1e-12)
    finally:
        for law in LAWS:
            unlearn(law.name)


@pytest.mark.parametrize(
    "words", ['"""; raise SystemExit(3); """', "*/ int main(void) {} /*", "\\", "]]> -- <!-- &amp;", "{0} %s ${x}"]
)
def test_the_description_of_a_law_is_never_more_than_words(words: str, tmp_path: Path) -> None:
    law = Law("law_words", "yaw_rate", ("w * abs(v)",), description=words)
    learn(law)
    try:
        robot = ExportedRobot(0, RobotParameters(*PAPER, effects={"law_words": -0.1}))
        states, _ = driven_in_python(robot, commands(0.1))
        assert np.all(np.isfinite(states))
        if COMPILER is not None:
            driven_in_c(robot, commands(0.1), tmp_path)
    finally:
        unlearn(law.name)
