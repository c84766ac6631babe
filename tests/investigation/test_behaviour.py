"""The behaviour investigate: it needs a floor, and refuses to begin where the opening would leave it."""

import pytest

from cmr.bus.messages import make
from cmr.geometry.obstacles import Geofence
from cmr.investigation.behaviour import NEEDS_FLOOR, Investigate
from cmr.investigation.engine import DATA_SHEET
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.msg import pose_xyt_t
from cmr.world.behaviours import BehaviourError, make_behaviour
from cmr.world.view import REAL, Robot, WorldView

PARAMETERS = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.16)
SQUARE = "-1:-1/1:-1/1:1/-1:1"


def heard(behaviour: Investigate) -> Investigate:
    """Return the behaviour after it heard a pose: something is measured."""
    behaviour.hear(0, "POSE_0", make(pose_xyt_t, utime=0, robot_id=0, x=0.0, y=0.0, theta=0.0))
    return behaviour


def at(x: float, y: float) -> Robot:
    """Return the robot at rest at this place."""
    return Robot(0, 0, REAL, RobotState(x, y, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_without_a_floor_it_ends_with_a_sentence() -> None:
    """There is no default: a floor is what nobody can know but the user."""
    behaviour = heard(Investigate())
    assert behaviour.command(0, at(0.0, 0.0), WorldView(), PARAMETERS) == (0.0, 0.0)
    assert (behaviour.finished, behaviour.problem) == (True, NEEDS_FLOOR)


def test_before_anything_was_measured_it_stands() -> None:
    """Without a recording there is nothing to learn from."""
    behaviour = Investigate(SQUARE)
    assert behaviour.command(0, at(0.0, 0.0), WorldView(), PARAMETERS) == (0.0, 0.0)
    assert not behaviour.finished


@pytest.mark.parametrize("place", [(0.84, 0.0), (1.2, 0.0), (0.0, -0.87)])
def test_it_does_not_begin_where_the_opening_might_leave_the_floor(place: tuple[float, float]) -> None:
    """By what a data sheet may be off, the opening from near the border would go beyond what is allowed."""
    behaviour = heard(Investigate(SQUARE))
    assert behaviour.command(0, at(*place), WorldView(), PARAMETERS) == (0.0, 0.0)
    assert (behaviour.finished, behaviour.problem) == (True, DATA_SHEET)


def test_the_geofence_is_the_floor_and_other_robots_are_on_it() -> None:
    """Without a floor of its own it takes that of the pilot; where another robot stands there is no room."""
    world = WorldView()
    world.geofence = Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    world.put(Robot(0, 7, REAL, RobotState(0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0)))
    behaviour = heard(Investigate())
    behaviour.command(0, at(0.0, 0.0), world, PARAMETERS)
    assert not behaviour.finished
    assert behaviour.driving is not None
    assert behaviour.driving.investigation.floor.obstacles.discs[:2].T.tolist() == [[0.5, 0.5]]


def test_a_floor_that_is_none_is_refused() -> None:
    """What is wrong with a floor is said before anything drives."""
    with pytest.raises(BehaviourError, match="at least 3 corners"):
        make_behaviour("investigate", {"floor": "0:0/1:1"})
    with pytest.raises(BehaviourError, match="goal must be"):
        make_behaviour("investigate", {"floor": SQUARE, "goal": "speed"})
