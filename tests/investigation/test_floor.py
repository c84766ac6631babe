"""No movement that the guard lets pass leaves the floor: not by the model, and not in the independent plant."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.geometry.obstacles import Obstacles
from cmr.investigation.choosing import keeps_to
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, candidates, opening
from cmr.investigation.prediction import Situation, paths
from cmr.model.commands import Commands
from cmr.model.duty_ramp import Limits
from tests.investigation.guarded import guarded
from tests.investigation.investigated import L_SHAPE, DrivenRobot

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
NONE = Commands(np.array([-1.0]), np.zeros((1, 2)))


def still(x: float, y: float, theta: float) -> Situation:
    """Return a robot at rest that was told nothing yet."""
    return Situation(
        (x, y, theta, 0.0, 0.0), 0.0, (0.0, 0.0), NONE, 0.0, 0.0, 0.0, Limits(1e6, 1e6), (0.01, 0.01, 0.04)
    )


def ensemble() -> list[dict[str, float]]:
    """Return robots that are faster and more uneven than the one that is driven."""
    faster = {**ROBOT, "k1": 0.95 * ROBOT["k1"]}
    return [ROBOT, *({**faster, "motor_gain_asymmetry": gain} for gain in (-0.03, 0.03))]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), gain=st.floats(-0.03, 0.03), slower=st.floats(0.95, 1.0))
@pytest.mark.slow
def test_a_movement_that_passes_keeps_the_real_robot_on_an_l_shaped_floor(
    seed: int, gain: float, slower: float
) -> None:
    """The plant, which shares no code with the model, drives what passed, coasts, and stays inside the border."""
    random = np.random.default_rng(seed)
    floor = Floor(L_SHAPE)
    x, y, theta = -0.5, -0.5, float(random.uniform(-math.pi, math.pi))
    drawn = candidates(random, 12)
    kept = [
        m for m, path in zip(drawn, paths(still(x, y, theta), drawn, ensemble()), strict=True) if keeps_to(floor, path)
    ]
    for movement in kept[:3]:
        robot = DrivenRobot(
            {**ROBOT, "k1": slower * ROBOT["k1"], "motor_gain_asymmetry": gain}, seed=seed, pose=(x, y, theta)
        )
        for left, right in movement.duty:
            robot.drive(float(left), float(right), PERIOD)
        robot.drive(0.0, 0.0, 1.0)
        assert np.all(L_SHAPE.contains(*robot.path.T)), movement.name


def test_a_path_is_the_one_of_the_plant() -> None:
    """Without noise, the predicted opening is where the plant goes: within 2 mm."""
    [path] = paths(still(0.1, 0.2, 0.3), [opening()[2]], [ROBOT])
    robot = DrivenRobot(ROBOT, pose=(0.1, 0.2, 0.3))
    for left, right in opening()[2].duty:
        robot.drive(float(left), float(right), PERIOD)
    robot.drive(0.0, 0.0, 1.0)
    places = robot.path[10::10][: len(path)]
    assert np.max(np.abs(path[: len(places), 0, :2] - places)) < 0.002 + 3.0 * 0.003 * 0.3  # slip's noise on 0.3 m


@settings(max_examples=50, deadline=None)
@given(x=st.floats(-2.0, 2.0), y=st.floats(-2.0, 2.0))
def test_room_is_negative_outside_and_near_what_stands_there(x: float, y: float) -> None:
    """Room is the distance from the nearest border, disc or wall, less the margin; outside it is below 0."""
    floor = Floor(L_SHAPE, margin=0.1, obstacles=Obstacles([(-0.5, 0.5, 0.1)], [(0.2, -0.8, 0.6, -0.8)]))
    room = float(floor.room(np.array(x), np.array(y)))
    if not L_SHAPE.contains(x, y):
        assert room <= -0.1
    assert room <= math.hypot(x + 0.5, y - 0.5) - 0.1 - 0.1 + 1e-9
    along = min(max(x, 0.2), 0.6)
    assert room <= math.hypot(x - along, y + 0.8) - 0.1 + 1e-9


def test_a_place_that_is_no_number_has_no_room() -> None:
    """A model that lost its way must not count as being on the floor."""
    assert float(Floor(L_SHAPE).room(np.array(math.nan), np.array(0.0))) == -math.inf


def test_other_robots_are_kept_clear_of() -> None:
    """Where another robot stands there is no room, and around it neither."""
    floor = Floor(L_SHAPE, margin=0.14).with_robots([(-0.5, -0.5)])
    assert float(floor.room(np.array(-0.5), np.array(-0.3))) < 0.0 < float(floor.room(np.array(0.3), np.array(-0.5)))
    assert L_SHAPE.contains(*floor.middle)


@pytest.mark.slow
def test_a_robot_that_turns_less_than_anybody_knows_is_stopped_on_its_floor() -> None:
    """By its movements towards the border alone it would leave it: its speed says early enough that it must stop."""
    drive = guarded(131)
    assert drive.effect == "turn_rate_limit"
    assert drive.within > 0.0
