"""Reaction: virtual robots act as late as real ones, and then drive as these do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.experiments.team.experiment import run
from cmr.experiments.team.hidden import HiddenRobot, Laboratory
from cmr.experiments.team.roles import Roles
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.reaction import Reaction
from cmr.world.view import TWIN, VIRTUAL, Robots
from tests.support.small_teams import BELIEVED, NUMBERS, line_of_three

BOTH = Robots((1, 2), (VIRTUAL, TWIN), RobotState.at_rest(np.zeros(2)))


def test_virtual_robots_act_later_than_they_decide_and_twins_at_once() -> None:
    reaction = Reaction(0.02)
    in_force = [reaction.late(np.full((2, 2), float(k)), BOTH)[:, 0].tolist() for k in range(1, 6)]
    assert in_force == [[0.0, 1.0], [0.0, 2.0], [1.0, 3.0], [2.0, 4.0], [3.0, 5.0]]


def test_a_robot_that_comes_later_stands_until_its_first_decision_is_in_force() -> None:
    reaction, three = Reaction(0.01), Robots((1, 2, 3), (VIRTUAL, TWIN, VIRTUAL), RobotState.at_rest(np.zeros(3)))
    reaction.late(np.ones((2, 2)), BOTH)
    assert reaction.late(np.full((3, 2), 2.0), three)[:, 0].tolist() == [1.0, 2.0, 0.0]
    assert reaction.late(np.full((3, 2), 3.0), three)[:, 0].tolist() == [2.0, 3.0, 2.0]


class SharpEyed(Laboratory):
    """Robots just as told, whose poses and gyros have no noise: what they do differently is not chance."""

    def robot(self, _robot_id: int) -> HiddenRobot:
        return HiddenRobot(**self.believed, gyro_noise=0.0, position_noise=0.0, heading_noise=0.0)


@pytest.mark.slow
def test_virtual_robots_that_react_as_late_as_real_ones_steer_as_they_do(tmp_path: Path) -> None:
    lively = NUMBERS | {"k1": 0.05, "base_width": 0.14}  # they turn faster than everybody believes
    virtual, scenario = dict.fromkeys((1, 2), RobotParameters.of(lively)), line_of_three(tmp_path)

    def turned(real: tuple[int, ...], reaction: float) -> float:
        """Return by how much the first follower turns, to and fro [rad]."""
        roles = Roles(BELIEVED, real, SharpEyed(lively), virtual)
        return float(np.abs(np.diff(run(replace(scenario, reaction=reaction), roles, 1).theta[:, 1])).sum())

    as_real_ones = turned((0, 1, 2), 0.0)
    assert turned((0,), 0.03) == pytest.approx(as_real_ones, rel=0.03)
    assert turned((0,), 0.0) > 1.04 * as_real_ones
