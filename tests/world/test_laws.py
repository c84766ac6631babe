"""A law of a parameter file runs in a world as any effect does."""

from pathlib import Path

import numpy as np
import pytest

from cmr.model.catalogue import learn, unlearn
from cmr.model.laws import Law
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import FigureEight
from cmr.world.world import VirtualRobot, World

pytestmark = pytest.mark.slow  # compiles the model with a law

PAPER = {"wheel_radius": 0.04, "k2_over_k3": 60.0, "k1": 0.04, "base_width": 0.2}
DRAG = Law("law_drag", "wheel_voltage", ("sign(s)",), "left")
SECONDS = 3.0


def turned_after(path: Path, drag: float) -> float:
    """Return the heading [rad] of a virtual robot whose file has the law, after some seconds of the same behaviour."""
    learn(DRAG)
    values = {name: Value(value) for name, value in {**PAPER, "law_drag": drag}.items()}
    ParameterFile(0, values, (DRAG.name,)).save(path)
    unlearn(DRAG.name)  # who reads the file has not heard of it
    world = World([VirtualRobot(7, FigureEight(start=0.0), parameters_of=0)], lambda n: ParameterFollower(n, path))
    for turn in range(round(SECONDS * 100.0)):
        world.advance(turn * 10_000)
    (robot,) = world.robots()
    assert np.hypot(robot.state.x, robot.state.y) > 0.1
    return float(robot.state.theta)


def test_a_virtual_robot_moves_by_the_law_of_its_file(tmp_path: Path) -> None:
    free, dragged = (turned_after(tmp_path / f"{drag:g}.yaml", drag) for drag in (0.0, -0.05))
    assert dragged > free + 0.05  # the left wheel lags behind
