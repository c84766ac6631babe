"""Robots of a world meet: virtual ones give way to each other, to real ones and to obstacles; twins meet nobody."""

from itertools import combinations
from math import hypot

import numpy as np
import pytest

from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.fleet import STEP, Fleet
from cmr.world.interaction.contacts import TOLERANCE
from cmr.world.interaction.obstacles import Obstacles
from cmr.world.view import TWIN, VIRTUAL

EPOCH = 1_700_000_000_000_000  # us
PAPER = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
RADIUS = 0.65 * 0.16  # m


def fleet_of(
    x: list[float], effects: dict[str, float] | None = None, obstacles: Obstacles | None = None, origin: int = VIRTUAL
) -> Fleet:
    """Robots on the x axis, all driving along it."""
    fleet = Fleet(obstacles)
    keys = [(robot_id, origin) for robot_id in range(len(x))]
    fleet.place(keys, RobotState.at_rest(np.array(x)), RobotParameters.of({**PAPER, **(effects or {})}))
    fleet.command(0, [(0.5, 0.5)] * len(x))
    return fleet


def run(fleet: Fleet, steps: int) -> RobotState:
    for k in range(steps):
        assert fleet.advance(EPOCH + k * STEP)
    return fleet.robots().state


@pytest.mark.parametrize("effects", [{}, {"electrical_lag": 0.05}])
def test_robots_that_start_in_one_place_part_and_stay_apart(effects: dict[str, float]) -> None:
    state = run(fleet_of([0.0] * 6, effects), 100)
    places = list(zip(state.x, state.y, strict=True))
    nearest = min(hypot(u[0] - v[0], u[1] - v[1]) for u, v in combinations(places, 2))
    assert nearest >= 2.0 * RADIUS - TOLERANCE


@pytest.mark.parametrize("effects", [{}, {"electrical_lag": 0.05}])
def test_a_robot_stops_at_a_real_one_that_stays_where_it_is(effects: dict[str, float]) -> None:
    fleet = fleet_of([0.0], effects)
    fleet.standing = np.array([[0.6], [0.0], [0.1]])
    state = run(fleet, 300)
    assert state.x[0] == pytest.approx(0.6 - 0.1 - RADIUS, abs=1e-3)
    assert abs(state.psi_left[0]) < 1.5  # rad/s: what the motor brings about in a step, of 9 without the contact
    assert np.array_equal(fleet.standing, [[0.6], [0.0], [0.1]])


def test_a_wall_stops_robots() -> None:
    state = run(fleet_of([0.0], obstacles=Obstacles(walls=[(0.5, -1.0, 0.5, 1.0)])), 300)
    assert state.x[0] == pytest.approx(0.5 - RADIUS, abs=1e-3)


def test_twins_meet_nobody() -> None:
    wall = Obstacles(walls=[(0.5, -1.0, 0.5, 1.0)])
    state = run(fleet_of([0.0, 0.0], obstacles=wall, origin=TWIN), 300)
    assert state.x[0] == state.x[1] > 0.9


def test_a_robot_has_the_radius_that_it_is_given() -> None:
    fleet = Fleet(Obstacles(walls=[(0.5, -1.0, 0.5, 1.0)]), {0: 0.2})
    fleet.place([(0, VIRTUAL)], RobotState.at_rest(np.zeros(1)), RobotParameters.of(PAPER))
    fleet.command(0, [(0.5, 0.5)])
    assert run(fleet, 300).x[0] == pytest.approx(0.3, abs=1e-3)
