"""Several simulators share one world: each moves its own robots, sees the others', and takes over nobody's."""

import heapq
import importlib
import math
import random
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import make
from cmr.bus.streams import POSE, WORLD_STATE
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.msg import pose_xyt_t, world_state_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour, FigureEight, Follow
from cmr.world.behaviours.following import SPEED_PER_DISTANCE
from cmr.world.lateness import Lateness
from cmr.world.remote_robots import LOST, RemoteRobots
from cmr.world.view import REAL, VIRTUAL, Robot, WorldView, world_messages
from cmr.world.world import VirtualRobot, World

EPOCH = 1_700_000_000_000_000  # us
STEP = 10_000  # us
PUBLISH = 2  # steps between two messages: 50 Hz
LOOK = 7  # steps between two looks: at every phase between messages
PAPER = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
LOSS, DELAY, JITTER = 0.02, 20_000, 10_000  # of packets; us
TOP_SPEED = 0.7  # m/s, above what any robot here drives

# A circle's leader: its speed, the circle's radius, and how far straight behind it a follower is that keeps up.
DUTIES = (0.4, 0.5)
SPEED = PAPER["wheel_radius"] * sum(DUTIES) / 2.0 / PAPER["k1"]  # m/s
RADIUS = sum(DUTIES) / 2.0 * PAPER["base_width"] / (DUTIES[1] - DUTIES[0])  # m
GAP = 0.4  # m along the circle
BEHIND = 2.0 * RADIUS * math.sin((GAP + SPEED / SPEED_PER_DISTANCE) / RADIUS / 2.0)  # m
CUT = 0.02  # m by which a follower that looks ahead cuts the curve


class Network:
    """Carries messages between simulators: late, in another order, or not at all."""

    def __init__(self, seed: int) -> None:
        self.joined = True
        self._random = random.Random(seed)
        self._under_way: list[tuple[int, int, int, bytes]] = []
        self._number = count()

    def send(self, utime: int, sender: int, data: bytes) -> None:
        """Carry a message to the other simulator, and back to its sender at once, as multicast does."""
        self._put(utime, sender, data)
        if self.joined and self._random.random() >= LOSS:
            self._put(utime + DELAY + self._random.randint(-JITTER, JITTER), 1 - sender, data)

    def arrived(self, utime: int) -> Iterator[tuple[int, Any]]:
        """Yield what has arrived by now, with whom."""
        while self._under_way and self._under_way[0][0] <= utime:
            _, _, receiver, data = heapq.heappop(self._under_way)
            yield receiver, world_state_t.decode(data)

    def _put(self, utime: int, receiver: int, data: bytes) -> None:
        heapq.heappush(self._under_way, (utime, next(self._number), receiver, data))


class Shards:
    """Two worlds with a network between them, in made-up time."""

    def __init__(self, worlds: tuple[World, World], seed: int = 0, largest: int | None = None) -> None:
        self.worlds, self.network, self.largest = worlds, Network(seed), largest
        self.utime = EPOCH
        self.paths: dict[int, dict[int, RobotState]] = {}  # what each robot's own simulator says, by stamp
        self.now: dict[int, RobotState] = {}

    def run(self, seconds: float) -> Iterator[int]:
        """Let time pass; yield the time of each step."""
        for _ in range(round(seconds * 1e6) // STEP):
            self.utime += STEP
            for receiver, message in self.network.arrived(self.utime):
                self.worlds[receiver].handle(message.utime, WORLD_STATE.name, message)
            for number, world in enumerate(self.worlds):
                world.advance(self.utime)
                for robot in world.robots():
                    self.paths.setdefault(robot.robot_id, {})[robot.utime] = robot.state
                    self.now[robot.robot_id] = robot.state
                if self.utime // STEP % PUBLISH == 0:
                    world.remote_robots.sent(world.utime)
                    for message in world_messages(world.utime, world.everybody(), self.largest):
                        self.network.send(self.utime, number, message.encode())
            yield self.utime


def world_of(*robots: VirtualRobot, real: tuple[int, ...] = ()) -> World:
    """Return a world that owns these virtual robots and estimates these real ones."""
    world = World(list(robots), ParameterFollower, estimates=lambda robot_id: robot_id in real)
    file = ParameterFile(0, {name: Value(value) for name, value in PAPER.items()})
    world.handle(EPOCH, "PARAMETERS_0", file.announcement(1))
    return world


def standing(robot_id: int, x: float = 0.0) -> VirtualRobot:
    return VirtualRobot(robot_id, FigureEight(laps=0), 0, x=x)


class Circle(Behaviour):
    """Drives a circle."""

    def command(self, _utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        return DUTIES


def leader(robot_id: int, y: float) -> VirtualRobot:
    return VirtualRobot(robot_id, Circle(), 0, y=y)


def shards(seed: int = 0, largest: int | None = None) -> Shards:
    """Two simulators: each has leaders, and a follower of a leader of the other."""
    first = world_of(leader(10, 0.0), leader(11, 5.0), VirtualRobot(12, Follow(leader=20, gap=GAP), 0, x=-0.5, y=10.0))
    second = world_of(leader(20, 10.0), leader(21, 15.0), VirtualRobot(22, Follow(leader=10, gap=GAP), 0, x=-0.5))
    return Shards((first, second), seed, largest)


ALL = {10, 11, 12, 20, 21, 22}


def known(world: World) -> dict[int, Robot]:
    """The robots that a world shows to its behaviours."""
    return {robot_id: robot for robot_id in ALL if (robot := world.view.robot(robot_id)) is not None}


def assert_as_their_owners_say(both: Shards, utime: int) -> None:
    """Assert that every robot is shown where it was when it was last heard of, and so near to where it is now."""
    for world in both.worlds:
        for robot_id, robot in known(world).items():
            then, now = both.paths[robot_id][robot.utime], both.now[robot_id]
            wrong = max(abs(shown - true) for shown, true in zip(robot.state[:3], then[:3], strict=True))
            assert wrong < 1e-5  # floats on the wire
            moved = math.hypot(now.x - robot.state.x, now.y - robot.state.y)
            assert moved <= TOP_SPEED * (utime - robot.utime) * 1e-6 + 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "seconds", "largest"), [(0, 20.0, None), (1, 15.0, 100)])
def test_over_a_lossy_network_no_robot_is_lost_or_doubled_and_all_are_where_their_owners_say(
    seed: int, seconds: float, largest: int | None
) -> None:
    both = shards(seed, largest)
    oldest = 0
    for utime in both.run(seconds):
        if utime // STEP % LOOK:
            continue
        assert_as_their_owners_say(both, utime)
        assert [set(world.everybody().robot_id) for world in both.worlds] == [{10, 11, 12}, {20, 21, 22}]
        if utime > EPOCH + 200_000:
            assert all(set(known(world)) == ALL for world in both.worlds)
            oldest = max(oldest, *(utime - robot.utime for world in both.worlds for robot in known(world).values()))
        assert not any(world.remote_robots.problems(utime) for world in both.worlds)
    # A period, the delay, and as many messages lost in a row as happens once in 3,000.
    assert oldest <= 4 * PUBLISH * STEP + DELAY + JITTER
    for follower, followed in ((12, 20), (22, 10)):
        here, there = both.now[follower], both.now[followed]
        assert BEHIND - CUT < math.hypot(here.x - there.x, here.y - there.y) < BEHIND + CUT + oldest * 1e-6 * SPEED


@pytest.mark.slow
def test_when_the_network_is_cut_each_keeps_its_own_and_all_is_as_before_when_it_is_back() -> None:
    both = shards()
    for _ in both.run(2.0):
        pass
    both.network.joined = False
    for utime in both.run(5.0):
        assert_as_their_owners_say(both, utime)
    assert [set(known(world)) for world in both.worlds] == [{10, 11, 12}, {20, 21, 22}]
    assert not any(len(world.remote_robots.robots(both.utime).robot_id) for world in both.worlds)
    both.network.joined = True
    began = both.utime
    for utime in both.run(5.0):
        assert_as_their_owners_say(both, utime)
        assert not any(world.remote_robots.problems(utime) for world in both.worlds)
        if utime > began + 200_000:
            assert all(set(known(world)) == ALL for world in both.worlds)


def test_two_simulators_with_the_same_robot_both_say_so_and_keep_to_their_own() -> None:
    both = Shards((world_of(standing(10), standing(11, x=1.0)), world_of(standing(10, x=3.0), standing(12))))
    for _ in both.run(1.0):
        pass
    for world, x in zip(both.worlds, (0.0, 3.0), strict=True):
        (sentence,) = world.remote_robots.problems(both.utime)
        assert "publishes robot 10, too" in sentence
        robot = world.view.robot(10)
        assert robot is not None
        assert robot.state.x == x
    both.network.joined = False
    for _ in both.run(3.0):
        pass
    assert not any(world.remote_robots.problems(both.utime) for world in both.worlds)


def test_a_simulator_alone_takes_its_own_messages_for_nobody_elses() -> None:
    both = Shards((world_of(standing(10), standing(11)), world_of()))
    for utime in both.run(2.0):
        assert not both.worlds[0].remote_robots.problems(utime)
    assert both.worlds[0].remote_robots.robots(both.utime).robot_id == ()
    assert both.worlds[1].remote_robots.robots(both.utime).robot_id == (10, 11)


def test_a_real_robot_is_estimated_by_the_simulator_that_was_told_to_and_shown_by_all() -> None:
    both = Shards((world_of(standing(10), real=(0,)), world_of(standing(20))))
    for utime in both.run(2.0):
        pose = make(pose_xyt_t, utime=utime, robot_id=0, x=1.0, y=2.0, theta=0.0)
        for world in both.worlds:
            world.handle(utime, POSE.channel(0), pose)
    assert [[robot.robot_id for robot in world.real()] for world in both.worlds] == [[0], []]
    for world in both.worlds:
        robot = world.view.robot(0)
        assert robot is not None
        assert (robot.origin, robot.state.x, robot.state.y) == (REAL, 1.0, 2.0)
        assert not world.remote_robots.problems(both.utime)


# One message after another

HERE = Robot(EPOCH, 10, VIRTUAL, RobotState.at_rest(1.0))


def message(robot: Robot) -> Any:
    (only,) = world_messages(robot.utime, [robot])
    return only


def test_a_message_that_was_overtaken_changes_nothing() -> None:
    others = RemoteRobots(())
    newest = others.handle(EPOCH, message(HERE._replace(utime=EPOCH + 1)))
    assert newest is not None
    assert others.handle(EPOCH, message(HERE._replace(state=RobotState.at_rest(7.0)))) is None
    assert others.handle(EPOCH, message(HERE._replace(utime=EPOCH + 1))) is None
    assert others.robots(EPOCH).state.x == [1.0]


def test_a_robot_not_heard_of_for_a_second_is_shown_no_more() -> None:
    others = RemoteRobots(())
    others.handle(EPOCH, message(HERE))
    assert others.robots(EPOCH + LOST).robot_id == (10,)
    assert others.robots(EPOCH + LOST + 1).robot_id == ()


@pytest.mark.parametrize(("ahead", "said"), [(3_000_000, "1 s ahead of"), (-3_000_000, "1 s behind")])
def test_another_clock_is_told_and_its_robots_are_not_shown(ahead: int, said: str) -> None:
    others = RemoteRobots(())
    assert others.handle(EPOCH, message(HERE._replace(utime=EPOCH + ahead))) is None
    assert others.robots(EPOCH).robot_id == ()
    (sentence,) = others.problems(EPOCH)
    assert said in sentence
    assert others.handle(EPOCH, message(HERE)) is not None
    assert others.problems(EPOCH + 2_000_001) == []


def test_robots_in_one_message_with_ones_own_are_shown_and_ones_own_are_not() -> None:
    others = RemoteRobots((10,))
    (both,) = world_messages(EPOCH, [HERE, HERE._replace(robot_id=11)])
    news = others.handle(EPOCH, both)
    assert news is not None
    assert news.robot_id == others.robots(EPOCH).robot_id == (11,)
    others.claim(11)
    assert others.handle(EPOCH + 1, message(HERE._replace(utime=EPOCH + 1, robot_id=11))) is None
    assert "robots 10, 11, too" in others.problems(EPOCH + 1)[0]


def test_a_simulator_that_was_held_up_catches_up_by_and_by_and_counts_what_came_late() -> None:
    world = world_of(standing(10))
    world.advance(EPOCH)
    world.advance(EPOCH + 25 * STEP)
    assert (world.utime - EPOCH, world.late_steps) == (10 * STEP, 10)
    world.advance(EPOCH + 26 * STEP)
    world.advance(EPOCH + 27 * STEP)
    assert world.utime == EPOCH + 27 * STEP
    # Due at step 11 to 20 and made at 26, at 21 to 25 and made at 27; those of 26 and 27 were in time.
    assert world.late_steps == 10 + 10 + 5
    world.advance(EPOCH + 327 * STEP)
    assert world.late_steps == 25 + 299  # left out: nobody saw them


class Turns:
    """A process whose turns come at these moments [us] and that hears nothing."""

    def __init__(self, utimes: list[int]) -> None:
        self._utimes = utimes
        self.exit_code = 0

    def __enter__(self) -> "Turns":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def loop(self, rate_hz: float) -> Iterator[int]:
        assert rate_hz == 1e6 / STEP
        yield from self._utimes

    def __getattr__(self, _name: str) -> Any:
        return lambda *_arguments, **_options: None


def test_a_simulator_that_was_held_up_tells_no_moment_twice(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    held_up = [EPOCH, EPOCH + STEP, EPOCH + 54_000, EPOCH + 57_000, EPOCH + 64_000, EPOCH + 2 * LOST]
    told: list[int] = []
    sim = importlib.import_module("cmr.commands.sim")  # the package has a function of this name
    monkeypatch.setattr(sim, "Process", lambda *_: Turns(held_up))
    monkeypatch.setattr(sim.Timer, "due", lambda _: True)
    monkeypatch.setattr(sim, "_state_messages", lambda world, _: told.append(world.utime))
    assert sim.main(["--parameters", str(tmp_path)]) == 0
    assert told == [EPOCH, EPOCH + STEP, EPOCH + 5 * STEP, EPOCH + 6 * STEP, EPOCH + 2 * LOST]


def test_a_simulator_says_that_it_is_late_while_it_is() -> None:
    lateness = Lateness()
    said = [lateness.problem(EPOCH + k * 250_000, late) for k, late in enumerate((0, 0, 9, 11, 11, 11, 11, 11))]
    assert [bool(sentence) for sentence in said] == [False, False, False, True, True, True, False, False]


def test_turns_that_come_a_little_sooner_or_later_make_one_step_each_in_time() -> None:
    world, shift = world_of(standing(10)), random.Random(1)
    for turn in range(500):
        world.advance(EPOCH + turn * STEP + shift.randint(-2_000, 2_000) * (turn > 0))
        assert world.utime == EPOCH + turn * STEP
    assert world.late_steps == 0
