"""Behaviours of many robots: shared by those described equally, brought by packages, and the same one in a pilot."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from cmr.commands.robots import behaviour_of, described_robots, numbered
from cmr.geometry.obstacles import Geofence, Obstacles
from cmr.model.catalogue import together
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import (
    Behaviour,
    BehaviourError,
    FigureEight,
    Follow,
    TeamBehaviour,
    make_behaviour,
    make_behaviours,
)
from cmr.world.behaviours.following import SPEED_PER_DISTANCE
from cmr.world.behaviours.team import Duties, Memory, duties_of
from cmr.world.behaviours.waypoints import Waypoints, read_points
from cmr.world.view import VIRTUAL, Robots, WorldView
from cmr.world.world import VirtualRobot, World
from tests.support.project import PROJECT
from tests.world.behaviours.team_bench import DIAMETER, EPOCH, MODEL, Bench

DOCS = PROJECT / "docs"


class Numbered(TeamBehaviour):
    """Gives each robot a duty of its own, and notes who was asked for."""

    def __init__(self, scale: float = 0.01) -> None:
        self.scale = scale
        self.asked: list[tuple[int, ...]] = []
        self.told: dict[int, list[float]] = {}

    def commands(self, _utime: int, me: Robots, _world: WorldView, parameters: RobotParameters) -> Duties:
        self.asked.append(me.robot_id)
        assert parameters.base_width.shape == me.state.x.shape == (len(me.robot_id),)
        return np.outer(me.robot_id, [self.scale, 2.0 * self.scale])

    def take_waypoints(self, robot_id: int, x: list[float], _y: list[float]) -> None:
        self.told[robot_id] = x


class Wrong(TeamBehaviour):
    def commands(self, _utime: int, me: Robots, _world: WorldView, _parameters: RobotParameters) -> Duties:
        return np.zeros(len(me.robot_id))


class NoNumber(TeamBehaviour):
    def commands(self, _utime: int, _me: Robots, _world: WorldView, _parameters: RobotParameters) -> Duties:
        return np.array([[math.nan, 0.2], [5.0, -5.0]])


def test_robots_described_equally_share_a_behaviour_and_others_do_not() -> None:
    name = "tests.world.behaviours.test_team_behaviours:Numbered"
    made = make_behaviours({1: (name, {}), 2: (name, {"scale": "0.02"}), 3: (name, {}), 4: ("commanded", {})})
    assert made[1] is made[3]
    assert made[1] is not made[2]
    assert isinstance(made[4], Behaviour)


def test_followers_with_leaders_of_their_own_share_a_behaviour() -> None:
    robots = described_robots([numbered("11=follow,leader=10"), numbered("12=follow,leader=11,gap=0.4")], 0)
    first, second = (robot.behaviour for robot in robots)
    assert first is second
    assert isinstance(first, Follow)
    rows = first.memory.rows((11, 12))
    assert first.memory["leader"][rows].tolist() == [10, 11]
    assert first.memory["gap"][rows].tolist() == [0.5, 0.4]


def test_a_wrong_setting_of_one_robot_is_refused_though_others_share_the_behaviour() -> None:
    with pytest.raises(BehaviourError, match="gap"):
        make_behaviours({11: ("follow", {}), 12: ("follow", {"gap": "-1"})})


def test_a_package_brings_a_behaviour_by_its_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "company-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: company\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cmr.behaviours]\ncompany = a_behaviour_of_your_own:Company\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.syspath_prepend(str(DOCS))
    behaviour, _pose = behaviour_of("company,gap=0.4")
    assert type(behaviour).__name__ == "Company"
    with pytest.raises(BehaviourError, match="of packages: company"):
        make_behaviour("compani", {})
    sys.modules.pop("a_behaviour_of_your_own")


def test_the_page_shows_the_example_that_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    example = (DOCS / "a_behaviour_of_your_own.py").read_text()
    assert f"```python\n{example}```" in (DOCS / "how_to" / "write_a_behaviour.md").read_text()
    monkeypatch.syspath_prepend(str(DOCS))
    company = make_behaviour("a_behaviour_of_your_own:Company", {})
    assert isinstance(company, TeamBehaviour)
    bench = Bench([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)], [(company, [0])])
    for _ in bench.run(20.0):
        pass
    assert bench.x[0] == pytest.approx(1.5, abs=0.1)


def test_what_is_no_number_stands_and_what_is_too_much_is_clipped() -> None:
    me = Robots((1, 2), (VIRTUAL, VIRTUAL), Robots.of([]).state)
    assert duties_of(NoNumber(), EPOCH, me, WorldView(), together([MODEL] * 2)).tolist() == [[0.0, 0.0], [1.0, -1.0]]


def test_duties_of_a_wrong_shape_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"Wrong.commands must return an array of shape \(2, 2\)"):
        duties_of(Wrong(), EPOCH, Robots((1, 2), (1, 1), Robots.of([]).state), WorldView(), MODEL)


def test_the_memory_keeps_numbers_by_robot_whoever_is_asked_for() -> None:
    memory = Memory(speed=1.5)
    memory["speed"][memory.rows((7, 3))] = [70.0, 30.0]
    rows = memory.rows(tuple(range(40)))
    assert memory["speed"][rows].tolist() == [30.0 if i == 3 else 70.0 if i == 7 else 1.5 for i in range(40)]


def test_a_world_asks_a_team_once_a_step_and_hands_it_waypoints(tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    ParameterFile(0, {name: Value(value) for name, value in MODEL.values.items()}).save(path)
    team = Numbered()
    robots = [VirtualRobot(i, team, parameters_of=0, y=float(i)) for i in (5, 6, 7)]
    world = World(robots, lambda robot_id: ParameterFollower(robot_id, path if robot_id == 0 else None))
    for k in range(6):
        world.advance(EPOCH + 10_000 * k)
    assert set(team.asked) == {(5, 6, 7)}
    assert len(team.asked) <= 6
    faster = [robot.state.psi_right for robot in world.robots()]
    assert faster == sorted(faster)
    assert faster[0] > 0.0


def test_points_are_read_and_what_is_none_is_refused() -> None:
    assert read_points("0:1/-2.5:3") == ([0.0, -2.5], [1.0, 3.0])
    for text in ("1", "1:2:3", "a:b", "1:nan"):
        with pytest.raises(ValueError):  # noqa: PT011 - float says what is wrong with a text that is no number
            read_points(text)


def test_robots_that_meet_go_round_each_other_and_arrive() -> None:
    team = Waypoints(speed=0.4)
    for robot, x in enumerate((2.0, 0.0)):
        team.take_waypoints(robot, [x], [0.0])
    bench = Bench([(0.0, 0.0, 0.0), (2.0, 0.0, math.pi)], [(team, [0, 1])])
    assert min(bench.nearest() for _ in bench.run(20.0)) > DIAMETER
    assert bench.x == pytest.approx([2.0, 0.0], abs=0.06)


def test_a_robot_goes_round_one_that_stands_on_its_path() -> None:
    team = Waypoints(points="3:0")
    bench = Bench([(0.0, 0.0, 0.0), (1.5, 0.05, 0.0)], [(team, [0])])
    assert min(bench.nearest() for _ in bench.run(20.0)) > DIAMETER
    assert bench.x[0] == pytest.approx(3.0, abs=0.06)


@pytest.mark.parametrize("aside", [0.0, 0.05, -0.12])
def test_a_robot_goes_round_a_disc_on_its_path(aside: float) -> None:
    bench = Bench([(0.0, 0.0, 0.0)], [(Waypoints(points="2:0"), [0])])
    bench.world.obstacles = Obstacles([(1.0, aside, 0.2)])
    nearest = min(math.hypot(bench.x[0] - 1.0, bench.y[0] - aside) for _ in bench.run(20.0))
    assert nearest > 0.2 + DIAMETER / 2.0
    assert bench.x[0] == pytest.approx(2.0, abs=0.06)


@pytest.mark.parametrize("goal", ["3:0", "3:2.5", "1:-2"])
def test_a_robot_sent_over_the_geofence_stops_inside_of_it(goal: str) -> None:
    bench = Bench([(0.0, 0.0, 0.0)], [(Waypoints(points=goal, speed=0.6), [0])])
    bench.world.geofence = Geofence([(-1.0, -1.0), (2.0, -1.0), (2.0, 2.0), (-1.0, 2.0)])
    for _ in bench.run(12.0):
        assert bench.world.geofence.contains(bench.x, bench.y).all()
    assert np.asarray(bench.world.geofence.distance(bench.x, bench.y))[0] < 0.1
    assert abs(bench.speed[0]) < 0.01


def test_a_line_of_followers_keeps_its_gaps_on_the_leaders_path() -> None:
    follow = Follow()
    for robot in range(1, 4):
        follow.adopt(robot, {"leader": robot - 1, "gap": 0.5})
    bench = Bench(
        [(-0.5 * robot, 0.0, 0.0) for robot in range(4)],
        [(FigureEight(size=1.0, speed=0.3, start=0.0), [0]), (follow, [1, 2, 3])],
    )
    nearest = min(bench.nearest() for _ in bench.run(15.0))
    assert nearest > DIAMETER
    gaps = np.hypot(np.diff(bench.x), np.diff(bench.y))
    assert (gaps > 0.4).all()  # they are kept along the path, which bends
    assert (gaps < 0.5 + 0.3 / SPEED_PER_DISTANCE + 0.02).all()  # who keeps up with 0.3 m/s is that much behind
