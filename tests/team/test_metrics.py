"""Metrics of a team, against figures worked out by hand."""

import math

import numpy as np
import pytest

from cmr.team import metrics
from cmr.team.metrics import Bond

TIME = np.array([0.0, 1.0, 2.0, 3.0])
X = np.array([[1.0, 0.0], [2.0, 1.0], [3.0, 1.0], [3.0, 2.5]])
Y = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.3], [0.0, 0.0]])


def test_formation_error_is_the_root_mean_square_of_distances_less_the_wanted_one() -> None:
    wanted = math.sqrt(np.mean(np.square([0.0, 0.0, math.hypot(2.0, 0.3) - 1.0, -0.5])))
    assert metrics.formation_error(X, Y, [Bond(1, 0, 1.0)]) == pytest.approx(wanted)


def test_time_to_goal_is_when_the_last_robot_was_first_there() -> None:
    assert metrics.time_to_goal(TIME, X, Y, {0: [(2.05, 0.05)], 1: [(2.5, 0.0)]}) == 3.0
    assert metrics.time_to_goal(TIME, X, Y, {0: [(2.05, 0.05)]}) == 1.0


def test_a_goal_never_reached_takes_the_whole_time() -> None:
    assert metrics.time_to_goal(TIME, X, Y, {0: [(0.0, 9.0)]}) == 3.0


def test_a_goal_counts_after_the_waypoints_before_it_as_on_a_way_that_ends_where_it_began() -> None:
    there_and_back = np.array([[0.0], [0.5], [0.9], [0.5], [0.05]])
    y = np.zeros((5, 1))
    way = [(0.0, 0.0), (1.0, 0.0), (0.0, 0.0)]
    assert metrics.time_to_goal(np.arange(5.0), there_and_back, y, {0: way}) == 4.0
    assert metrics.time_to_goal(np.arange(5.0), there_and_back, y, {0: [(0.0, 0.5), (0.0, 0.0)]}) == 4.0


def test_a_waypoint_on_the_way_is_passed_within_15_cm_and_the_goal_reached_within_10_cm() -> None:
    way = [(1.0, 0.0), (2.0, 0.0)]
    assert [metrics.passed(x, 0.0, way, 0) for x in (0.84, 0.86, 1.14, 1.16)] == [0, 1, 1, 0]
    assert [metrics.passed(x, 0.0, way, 1) for x in (1.89, 1.91, 2.09, 2.11)] == [1, 2, 2, 1]
    assert metrics.passed(math.nan, math.nan, way, 1) == 1


def test_minimum_separation_is_the_least_of_all_moments_and_pairs() -> None:
    assert metrics.minimum_separation(X, Y) == pytest.approx(0.5)
    third = np.column_stack([X, X[:, 0] + 0.2]), np.column_stack([Y, Y[:, 0]])
    assert metrics.minimum_separation(*third) == pytest.approx(0.2)


def test_path_spread_is_measured_from_the_path_and_not_from_the_place_of_the_leader() -> None:
    off = [1.0, 0.0, 0.3, 0.0]  # m; the leader's path lies on the x axis from 1 to 3
    assert metrics.path_spread(X, Y, [Bond(1, 0, 1.0)]) == pytest.approx(
        math.sqrt(np.mean(np.square([off[0], off[1], math.hypot(0.0, 0.3), off[3]])))
    )


def test_distance_driven_is_the_mean_way() -> None:
    second = 1.0 + 0.3 + math.hypot(1.5, 0.3)
    assert metrics.distance_driven(X, Y) == pytest.approx((2.0 + second) / 2.0)


def test_metrics_that_mean_nothing_are_no_numbers() -> None:
    assert math.isnan(metrics.formation_error(X, Y, []))
    assert math.isnan(metrics.path_spread(X, Y, []))
    assert math.isnan(metrics.time_to_goal(TIME, X, Y, {}))
    assert math.isnan(metrics.minimum_separation(X[:, :1], Y[:, :1]))
