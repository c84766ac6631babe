"""What stops a real robot whatever its behaviour says: its geofence, missing poses, and robots in its way."""

import math
from pathlib import Path

import pytest

from cmr.geometry.obstacles import Geofence
from cmr.model.motion import RobotState
from cmr.world.interaction.body import body_radius
from cmr.world.view import VIRTUAL, Robot
from tests.support.emulated_drive import EPOCH, TRUTH
from tests.support.pilot_bench import PERIOD, Bench, StraightOn

SQUARE = Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def standing_at(x: float, y: float = 0.0) -> Robot:
    return Robot(EPOCH, 11, VIRTUAL, RobotState.at_rest(x, y, 0.0))


def test_inside_its_geofence_it_drives(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    assert bench.turn() == (0.5, 0.5)
    assert bench.pilot.waiting_for == bench.pilot.left_fence == ""


def test_a_robot_that_left_its_geofence_stands_for_good(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE, margin=0.3)
    assert bench.turn(0.65) == (0.5, 0.5)
    assert bench.turn(0.75) == (0.0, 0.0)
    assert "left its geofence" in bench.pilot.left_fence
    assert "start cmr-pilot again" in bench.pilot.left_fence
    assert bench.turn(0.0) == (0.0, 0.0)  # somebody carried it back: it must not drive on in the hands


def test_a_fast_robot_is_stopped_before_it_cannot_stop_inside(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE, margin=0.1)
    assert bench.turn(0.6, psi=10.0) == (0.5, 0.5)
    assert bench.turn(0.6, psi=50.0) == (0.0, 0.0)  # 2 m/s


def test_a_pose_outside_stops_it_though_the_estimate_is_inside(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    bench.turn()
    bench.pose(3.0)
    assert bench.turn(pose=False) == (0.0, 0.0)


def test_one_wrong_pose_stops_it_for_half_a_second_and_not_for_good(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    bench.turn()
    bench.pose(1_000.0)
    assert bench.turn() == (0.0, 0.0)
    assert "one at (1000.00, 0.00) m is far from where cmr-sim has robot 0" in bench.pilot.waiting_for
    later = [bench.turn() for _ in range(25)]
    assert later[22] == (0.0, 0.0)
    assert later[24] == (0.5, 0.5)
    assert bench.pilot.left_fence == ""


def test_poses_outside_that_come_for_half_a_second_stop_it_for_good_though_the_estimate_stays_inside(
    tmp_path: Path,
) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    bench.turn()
    for count in range(27):
        bench.pose(3.0 + 0.1 * count)
        assert bench.turn(pose=False) == (0.0, 0.0)
    assert "left its geofence" in bench.pilot.left_fence
    assert [bench.turn() for _ in range(50)][-1] == (0.0, 0.0), "it must not drive on in the hands"


def test_two_wrong_poses_far_apart_stop_it_for_good_only_where_no_good_one_is_between(tmp_path: Path) -> None:
    for is_good_between, left in ((True, False), (False, True)):
        bench = Bench(tmp_path, geofence=SQUARE)
        bench.turn()
        bench.pose(1_000.0)
        for _ in range(30):
            bench.turn(pose=is_good_between)
        bench.pose(1_000.0)
        assert bool(bench.pilot.left_fence) is left


def test_a_pose_outside_and_near_the_estimate_is_no_glitch(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    bench.turn(0.65)
    bench.pose(0.75)
    bench.turn(0.65)
    assert "left its geofence" in bench.pilot.left_fence


def test_before_it_knows_where_it_is_one_wrong_pose_is_doubtful_too(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    bench.pilot.turn(bench.utime)
    bench.pose(1_000.0)
    assert bench.turn() == (0.0, 0.0)
    assert [bench.turn() for _ in range(26)][-1] == (0.5, 0.5)


def test_with_a_geofence_it_waits_for_the_first_pose(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    assert bench.turn(pose=False) == (0.0, 0.0)
    assert "POSE_0" in bench.pilot.waiting_for
    assert bench.turn() == (0.5, 0.5)


@pytest.mark.parametrize("fence", [SQUARE, None])
def test_half_a_second_without_poses_stops_it_and_their_return_lets_it_go_on(
    tmp_path: Path, fence: Geofence | None
) -> None:
    bench = Bench(tmp_path, geofence=fence)
    bench.turn()
    silent = [bench.turn(pose=False) for _ in range(26)]
    assert silent[23] == (0.5, 0.5)
    assert silent[25] == (0.0, 0.0)
    assert "fell silent" in bench.pilot.waiting_for
    assert bench.turn() == (0.5, 0.5)


def test_the_same_pose_again_and_again_is_none(tmp_path: Path) -> None:
    bench = Bench(tmp_path, geofence=SQUARE)
    bench.turn()
    stamp = bench.utime
    for _ in range(26):
        bench.pose(0.0, age=bench.utime - stamp)
        last = bench.turn(pose=False)
    assert last == (0.0, 0.0)


def test_poses_that_are_old_or_of_another_clock_are_said_to_be(tmp_path: Path) -> None:
    for age, said in ((700_000, "0.7 s old"), (-5_000_000, "5.0 s ahead")):
        bench = Bench(tmp_path, geofence=SQUARE)
        bench.turn(pose=False)
        bench.pose(0.0, age=age - PERIOD)
        assert bench.turn(pose=False) == (0.0, 0.0)
        assert said in bench.pilot.waiting_for


def test_a_robot_that_never_had_poses_drives_without(tmp_path: Path) -> None:
    assert Bench(tmp_path).turn(pose=False) == (0.5, 0.5)


def test_a_duty_that_is_no_number_is_zero(tmp_path: Path) -> None:
    bench = Bench(tmp_path, StraightOn(math.nan, 0.5))
    assert bench.turn() == (0.0, 0.0)
    assert "numbers" in bench.pilot.waiting_for


@pytest.mark.parametrize("duty", [0.3, 0.9, -0.9])
def test_it_never_runs_into_a_virtual_robot_standing_in_its_way(tmp_path: Path, duty: float) -> None:
    """The robot moves as its motors let it, on what the world said 60 ms ago."""
    bench = Bench(tmp_path, StraightOn(duty, duty))
    other = standing_at(math.copysign(1.5, duty))
    x, speed, seen = 0.0, 0.0, [(0.0, 0.0)] * 3
    for _ in range(400):
        command, _right = bench.turn(seen[0][0], others=(other,), psi=seen[0][1] / 0.04)
        speed += (command / TRUTH["k1"] * 0.04 - speed) * PERIOD * 1e-6 * TRUTH["k1"] * TRUTH["k2_over_k3"]
        x += speed * PERIOD * 1e-6
        seen = [*seen[1:], (x, speed)]
        assert abs(other.state.x - x) > 2.0 * body_radius(TRUTH["base_width"])
    assert abs(x) > 1.0
    assert "robot 11" in bench.pilot.waiting_for


def test_a_robot_beside_the_way_is_no_reason_to_stop(tmp_path: Path) -> None:
    assert Bench(tmp_path).turn(others=(standing_at(0.3, 0.4),)) == (0.5, 0.5)


def test_it_turns_on_the_spot_and_drives_away_before_whoever_stands_there(tmp_path: Path) -> None:
    near = (standing_at(0.25),)
    assert Bench(tmp_path, StraightOn(-0.3, 0.3)).turn(others=near) == (-0.3, 0.3)
    assert Bench(tmp_path, StraightOn(-0.3, -0.3)).turn(others=near) == (-0.3, -0.3)
    assert Bench(tmp_path, StraightOn(0.3, 0.3)).turn(others=near) == (0.0, 0.0)


def test_keeping_clear_can_be_switched_off(tmp_path: Path) -> None:
    assert Bench(tmp_path, keep_clear=False).turn(others=(standing_at(0.25),)) == (0.5, 0.5)
