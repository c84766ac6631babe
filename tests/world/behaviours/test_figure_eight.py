"""The drive to calibrate with: figure-eights at one speed or several, each for the same time."""

import math
from pathlib import Path

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.bus.streams import WAYPOINTS
from cmr.commands.demo import DRIVE, GAP, SIZE
from cmr.msg import waypoints_t
from cmr.world.behaviours import FigureEight, Follow, make_behaviour
from cmr.world.behaviours.leading import LENGTH, SPEEDS, laps_within, read_speeds, seconds_of
from cmr.world.view import VIRTUAL
from cmr.world.world import VirtualRobot
from tests.support.emulated_drive import EPOCH
from tests.world.test_world import MODEL, TRUE, robots, run, world_of


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot_0.yaml"
    TRUE.save(path)
    return path


def test_a_leader_drives_equally_long_at_each_of_its_speeds_without_a_rest_between(file: Path) -> None:
    size, speeds = 0.7, read_speeds(SPEEDS)
    laps = laps_within(60.0, size, speeds)
    world = world_of(file, VirtualRobot(10, FigureEight(size=size, laps=laps, start=0.0), parameters_of=0))
    driven = []
    for k in range(140):
        run(world, 0.5, EPOCH + k * 500_000)
        state = robots(world)[10, VIRTUAL].state
        driven.append(0.5 * MODEL.wheel_radius * (state.psi_left + state.psi_right))
    slow, fast = (np.flatnonzero(np.abs(np.array(driven) - speed) < 0.05) for speed in speeds)
    assert 0.5 * len(slow) == pytest.approx(30.0, abs=3.0)
    assert 0.5 * len(fast) == pytest.approx(30.0, abs=3.0)
    assert slow[0] < fast[0]
    assert min(driven[slow[0] : fast[-1]]) > 0.15  # m/s: no rest between
    end = robots(world)[10, VIRTUAL].state
    assert math.hypot(end.x, end.y) < 0.06
    assert abs(end.psi_left) + abs(end.psi_right) < 1e-3


def test_the_speeds_of_a_leader_are_parts_of_the_waypoints_it_is_told(file: Path) -> None:
    world = world_of(file, VirtualRobot(10, make_behaviour("figure_eight", {"laps": "0", "speed": "0.5/0.1"}), 0))
    utime = run(world, 1.0)
    world.handle(utime, WAYPOINTS.channel(10), make(waypoints_t, utime=utime, robot_id=10, x=[3.0], y=[0.0]))
    utime = run(world, 3.0, utime)
    assert robots(world)[10, VIRTUAL].state.x == pytest.approx(1.25, abs=0.1)
    utime = run(world, 4.0, utime)  # the border is at five sixths of the way: 2.5 m
    fast = robots(world)[10, VIRTUAL].state.x
    assert fast == pytest.approx(2.63, abs=0.1)
    run(world, 1.0, utime)
    assert robots(world)[10, VIRTUAL].state.x - fast == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize(("text", "speeds"), [("0.3", (0.3,)), ("0.2/0.5", (0.2, 0.5)), (SPEEDS, (0.2, 0.5))])
def test_speeds_are_read_whether_one_or_several(text: str, speeds: tuple[float, ...]) -> None:
    assert read_speeds(text) == speeds
    assert tuple(FigureEight(speed=text).speeds) == speeds


def test_a_minute_of_whole_figure_eights_is_five_laps_at_two_speeds_and_four_at_the_papers() -> None:
    assert (laps_within(60.0, 0.7, (0.2, 0.5)), laps_within(60.0, 0.7, (0.3,))) == (5, 4)
    assert laps_within(1.0, 5.0, (0.3,)) == 1
    assert seconds_of(LENGTH * 0.7 * 5, (0.2, 0.5)) == pytest.approx(61.0, abs=0.1)


@pytest.mark.slow
def test_three_robots_in_line_do_not_hold_each_other_up_at_the_crossing_of_the_demo(file: Path) -> None:
    laps = laps_within(DRIVE, SIZE, read_speeds(SPEEDS))
    leader = FigureEight(size=SIZE, laps=laps, start=0.0)
    line = [VirtualRobot(10, leader, 0, x=GAP), VirtualRobot(1, Follow(leader=10, gap=GAP), 0)]
    world = world_of(file, *line, VirtualRobot(11, Follow(leader=1, gap=GAP), 0, x=-GAP))
    way, behind = dict.fromkeys((10, 1, 11), 0.0), []
    places: dict[int, tuple[float, float]] = {}
    for k in range(round(DRIVE / 0.1) - 10):
        run(world, 0.1, EPOCH + k * 100_000)
        for robot_id in way:
            state = robots(world)[robot_id, VIRTUAL].state
            way[robot_id] += math.dist(places.get(robot_id, (state.x, state.y)), (state.x, state.y))
            places[robot_id] = state.x, state.y
        behind.append((way[10] - way[1], way[1] - way[11]))
    assert laps == 3
    assert np.max(behind) < 0.4  # m more than the gap, at 0.5 m/s; smaller figure-eights make that a metre
    assert np.min(behind) > -0.1
