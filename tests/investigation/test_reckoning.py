"""Dead reckoning: what is not known of a robot's place grows as it must, and stays on the floor."""

import math

import numpy as np
import pytest

from cmr.geometry.obstacles import Geofence
from cmr.investigation.choosing import keeps_to
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, candidates, opening, towards
from cmr.investigation.prediction import BETWEEN_PLACES, Situation, paths, times_of
from cmr.investigation.reckoning import BIAS, HEADED, PLACED, ROLLED, SURE, Reckoned, put_down, reckoned
from cmr.model.commands import Commands
from cmr.model.duty_ramp import Limits
from cmr.recordings.signal import Floats
from tests.investigation.investigated import DrivenRobot, InvestigatedCase, investigated, without_poses

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
SQUARE = Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
SECONDS, WAY, STEPS = 10.0, 1.5, 400  # s, m
MOVEMENTS = 12
UNLIKELY = 2.5  # standard deviations: hidden errors are at most so large


def down(theta: float = 0.3) -> Reckoned:
    """A robot just put down."""
    return put_down((0.2, -0.1, theta), 0.16, with_gyro=True)


def straight(begin: Reckoned, way: float, seconds: float) -> Reckoned:
    """The robot after it went so far [m], back where that is below 0, at an even pace."""
    time = np.linspace(0.0, seconds, STEPS + 1)[1:]
    x, y, theta = begin.place
    along = way * time / seconds
    places = np.column_stack([x + along * math.cos(theta), y + along * math.sin(theta), np.full(STEPS, theta)])
    return begin.moved(begin.seconds + time, places)


def test_a_straight_drive_ends_in_an_ellipse_of_way_and_heading() -> None:
    """Along the way its share is unknown; across it what the heading was at first, and the bias, over half the time."""
    along = math.hypot(PLACED, ROLLED * WAY)
    across = math.sqrt(PLACED**2 + (HEADED * WAY) ** 2 + (0.5 * BIAS * SECONDS * WAY) ** 2)
    assert straight(down(), WAY, SECONDS).doubt == pytest.approx(SURE * max(along, across), rel=1e-3)


def test_the_way_back_takes_back_what_is_a_matter_of_the_way() -> None:
    """What remains is how the robot was put down, and the bias: over the time between the way there and that back."""
    back = straight(straight(down(), WAY, SECONDS), -WAY, SECONDS)
    assert back.place == pytest.approx((0.2, -0.1, 0.3), abs=1e-9)
    assert back.doubt == pytest.approx(SURE * math.hypot(PLACED, BIAS * SECONDS * WAY), rel=1e-3)


def test_a_path_ahead_is_doubted_as_it_is_once_it_was_driven() -> None:
    """What is planned with is what it comes to."""
    begin = straight(down(), 0.5, 3.0)
    time: Floats = np.arange(1.0, 41.0) * BETWEEN_PLACES
    x, y, theta = begin.place
    ahead = 0.4 * time
    turning = theta + 0.8 * time
    places = np.column_stack([x + ahead, y + 0.5 * ahead, turning])
    doubts = begin.doubts(time, places)
    driven = begin.moved(begin.seconds + time, places)
    assert doubts[-1] == pytest.approx(driven.doubt, rel=1e-9)
    assert np.all(np.isfinite(doubts))


def drifting(random: np.random.Generator) -> dict[str, float]:
    """What dead reckoning does not know: a gyro that reads wrong, and wheels of another size."""
    sizes = {"gyro_bias": 0.01, "gyro_scale": 0.02, "gyro_drift": 0.012, "wheel_radius_asymmetry": 0.015}
    sizes |= {"wheel_radius_scale": 0.04}
    return {name: size * float(np.clip(random.normal(), -UNLIKELY, UNLIKELY)) for name, size in sizes.items()}


def driven_unseen(seed: int) -> tuple[Floats, float]:
    """Drive random movements that keep to the floor by dead reckoning.

    Returns the true path (n, 2) [m], and how far the robot ever was from where it was reckoned to be, as a share of
    the doubt.
    """
    random = np.random.default_rng(seed)
    start = (*random.uniform(-0.3, 0.3, 2).tolist(), float(random.uniform(-math.pi, math.pi)))
    misplaced = np.array(start) + random.normal(size=3) * (PLACED, PLACED, HEADED)
    robot = DrivenRobot({**ROBOT, **drifting(random)}, seed=seed, pose=tuple(misplaced.tolist()))
    floor, worst = Floor(SQUARE), 0.0
    movements = opening()
    for _ in range(MOVEMENTS):
        for movement in movements:
            for left, right in movement.duty:
                robot.drive(float(left), float(right), PERIOD)
        robot.drive(0.0, 0.0, 1.0)
        here = reckoned(without_poses(robot.recording()), start, ROBOT["wheel_radius"], ROBOT["base_width"])
        off = math.hypot(here.place[0] - robot.state["x"], here.place[1] - robot.state["y"])
        worst = max(worst, off / here.doubt)
        none = Commands(np.array([-1.0]), np.zeros((1, 2)))
        state = (*here.place, 0.0, 0.0)
        still = Situation(state, 0.0, (0.0, 0.0), none, 0.0, 0.0, 0.0, Limits(1e6, 1e6), (None,) * 3)
        drawn = [*candidates(random, 20), *towards(0.5, 0.7, random)]
        movements = [
            movement
            for movement, path in zip(drawn, paths(still, drawn, [ROBOT]), strict=True)
            if keeps_to(floor, path, here.doubts(times_of(path), path[:, 0]))
        ][:1]
    return robot.path, worst


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.slow
def test_a_robot_that_nobody_sees_stays_on_the_floor(seed: int) -> None:
    """With a gyro and wheels that are wrong by what is usual, or by more, the doubt holds the truth.

    Of normal displacements in a plane, 1 % are farther than three standard deviations, one in 3,000 farther than four.
    """
    path, worst = driven_unseen(seed)
    assert np.all(SQUARE.contains(*path.T))
    assert SURE * worst < 4.0


@pytest.mark.slow
def test_a_robot_without_a_tracker_names_what_its_other_sensors_show() -> None:
    """A gyro's bias shows beside the wheels alone, and the true robot stays on the floor.

    The world's own estimate of the place drifts by that bias: it only tells how the robot moved since a decision.
    """
    outcome = investigated(
        InvestigatedCase(("gyro_bias",), seed=12, longest=20.0, unseen=True), until_named="gyro_bias"
    )
    assert list(outcome.named) == ["gyro_bias"]
    assert outcome.within > 0.0
