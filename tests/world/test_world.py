"""The world: estimates of real robots, simulated robots, and twins."""

import math
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.bus.streams import ESTOP, ESTOP_LATCH, MOTOR_COMMAND, PARAMETERS, WAYPOINTS, WORLD_STATE
from cmr.geometry.figures import figure_eight
from cmr.geometry.obstacles import Obstacles
from cmr.model.compiled import config
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import RobotParameters
from cmr.msg import estop_t, motor_command_t, waypoints_t, world_state_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour, FigureEight, Follow, make_behaviour
from cmr.world.behaviours.behaviour import BehaviourError, Commanded
from cmr.world.behaviours.waypoints import Waypoints
from cmr.world.estimator import Estimator
from cmr.world.interaction.body import body_radius
from cmr.world.view import REAL, TWIN, VIRTUAL, Robot, Robots, WorldView, world_messages
from cmr.world.world import VirtualRobot, World
from robot_driver.emulator.settings import Settings
from tests.support.emulated_drive import DEFAULT, EPOCH, TRUTH, Message, messages
from tests.support.latches import latch

TRUE = ParameterFile(0, {"wheel_radius": Value(0.04)} | {name: Value(value) for name, value in TRUTH.items()})
OTHER = ParameterFile(
    0, {"wheel_radius": Value(0.04), "k2_over_k3": Value(60.0), "k1": Value(0.07), "base_width": Value(0.25)}
)
MODEL = TRUE.robot_parameters


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot_0.yaml"
    TRUE.save(path)
    return path


def world_of(file: Path, *virtual: VirtualRobot) -> World:
    return World(list(virtual), lambda robot_id: ParameterFollower(robot_id, file if robot_id == 0 else None))


def run(world: World, seconds: float, begin: int = EPOCH) -> int:
    """Let time pass in turns of 10 ms; return the time at the end."""
    for k in range(int(seconds * 100) + 1):
        world.advance(begin + k * 10_000)
    return begin + int(seconds * 100) * 10_000


def robots(world: World) -> dict[tuple[int, int], Robot]:
    return {(robot.robot_id, robot.origin): robot for robot in world.robots()}


def command(utime: int, left: float, right: float, robot_id: int = 0) -> Any:
    return make(motor_command_t, utime=utime, robot_id=robot_id, left=left, right=right)


def test_the_estimate_of_a_real_robot_is_nearer_to_the_truth_than_its_poses() -> None:
    estimator = Estimator(0)
    estimator.parameters = MODEL
    noisy, estimated = [], []
    quiet = {
        message.utime: message
        for channel, message in messages(_without_pose_noise(), channels=["POSE"])
        if channel.startswith("POSE")
    }
    for channel, message in messages(DEFAULT):
        estimator.handle(message.utime, channel, message)
        if channel.startswith("POSE") and message.utime > EPOCH + 5_000_000:
            true = quiet[message.utime]
            noisy.append(math.hypot(message.x - true.x, message.y - true.y))
            estimated.append(math.hypot(estimator.state.x - true.x, estimator.state.y - true.y))
    assert np.mean(np.square(estimated)) < 0.5 * np.mean(np.square(noisy))


def test_without_poses_the_estimate_follows_wheels_and_gyro() -> None:
    estimator = Estimator(0)
    estimator.parameters = MODEL
    for channel, message in messages(DEFAULT, channels=["MOTOR_FEEDBACK", "GYRO"]):
        estimator.handle(message.utime, channel, message)
    last = [message for channel, message in messages(_without_pose_noise(), channels=["POSE"])][-1]
    # 30 s at 0.3 m/s with 0.3 % of turn slip and some longitudinal slip: a few centimetres.
    assert math.hypot(estimator.state.x - last.x, estimator.state.y - last.y) < 0.15
    assert not estimator.located


@pytest.mark.slow
def test_a_late_pose_is_compared_with_where_the_robot_was() -> None:
    """Poses that arrive 0.2 s late, stamped when measured, must not pull the estimate back along the path."""
    estimator = Estimator(0)
    estimator.parameters = MODEL
    drive = messages(DEFAULT)
    arriving = sorted(drive, key=lambda m: m[1].utime + (200_000 if m[0].startswith("POSE") else 0))
    truth = {m.utime: m for _c, m in messages(_without_pose_noise(), channels=["POSE"])}
    errors = []
    for channel, message in arriving:
        estimator.handle(message.utime, channel, message)
        if channel.startswith("MOTOR_FEEDBACK") and message.utime in truth and message.utime > EPOCH + 5_000_000:
            true = truth[message.utime]
            errors.append(math.hypot(estimator.state.x - true.x, estimator.state.y - true.y))
    assert np.mean(errors) < 0.015  # 0.2 s of delay at 0.3 m/s would be 0.06 m


def test_a_virtual_robot_moves_exactly_as_the_model_says(file: Path) -> None:
    behaviour = Commanded()
    world = world_of(file, VirtualRobot(7, behaviour, parameters_of=0, x=1.0, y=2.0, theta=0.5))
    world.advance(EPOCH)
    for k in range(200):
        utime = EPOCH + k * 10_000
        world.handle(utime, MOTOR_COMMAND.channel(7), command(utime, 0.3, 0.5, robot_id=7))
        world.advance(utime)
    steps = 198  # the first turn places the robot, the command is taken at the second
    path = drive([0.3] * steps, [0.5] * steps, [0.01] * steps, MODEL, RobotState.at_rest(1.0, 2.0, 0.5))
    state = robots(world)[7, VIRTUAL].state
    near = np.hypot(path.x - state.x, path.y - state.y).min()
    assert near < 1e-9
    assert state.psi_right == pytest.approx(path.psi_right[-1], rel=1e-3)


def test_new_parameters_take_effect_without_a_jump(file: Path) -> None:
    world = world_of(file, VirtualRobot(10, FigureEight(start=0.0), parameters_of=0))
    utime = run(world, 3.0)
    before = robots(world)[10, VIRTUAL].state
    world.handle(utime, PARAMETERS.channel(0), OTHER.announcement(sequence=2**62))
    after = robots(world)[10, VIRTUAL].state
    assert before == after
    world.advance(utime + 10_000)
    moved = robots(world)[10, VIRTUAL].state
    assert math.hypot(moved.x - after.x, moved.y - after.y) < 0.01
    assert moved.domega_left != before.domega_left


def test_a_broken_announcement_changes_nothing(file: Path) -> None:
    world = world_of(file, VirtualRobot(10, FigureEight(), parameters_of=0))
    announcement = OTHER.announcement(sequence=2**62)
    announcement.yaml = announcement.yaml[: len(announcement.yaml) // 2]
    sha256 = world.parameters[0].sha256
    world.handle(EPOCH, PARAMETERS.channel(0), announcement)
    assert world.parameters[0].sha256 == sha256
    assert world.parameters[0].message


def test_a_leader_drives_both_lobes_and_stops_where_it_started(file: Path) -> None:
    world = world_of(file, VirtualRobot(10, FigureEight(size=0.7, speed=0.3, start=0.0), parameters_of=0))
    visited = []
    for k in range(25):
        run(world, 1.0, EPOCH + k * 1_000_000)
        visited.append(robots(world)[10, VIRTUAL].state)
    x, y = figure_eight(0.0, 0.0, 0.0, 0.7)
    off = [min(math.hypot(s.x - u, s.y - v) for u, v in zip(x, y, strict=True)) for s in visited]
    assert max(off) < 0.05
    assert max(s.x for s in visited) > 0.5
    assert max(s.y for s in visited) > 0.3
    assert min(s.y for s in visited) < -0.3
    end = visited[-1]
    assert math.hypot(end.x, end.y) < 0.06
    assert abs(end.psi_left) + abs(end.psi_right) < 1e-3


def test_a_follower_drives_where_its_leader_drove(file: Path) -> None:
    world = world_of(
        file,
        VirtualRobot(10, FigureEight(size=0.7, speed=0.3, start=0.0), parameters_of=0, x=0.5),
        VirtualRobot(11, Follow(leader=10, gap=0.5), parameters_of=0),
    )
    x, y = figure_eight(0.5, 0.0, 0.0, 0.7)
    trail = [*zip(x, y, strict=True), *((0.01 * k, 0.0) for k in range(50))]
    for k in range(22):
        run(world, 1.0, EPOCH + k * 1_000_000)
        me = robots(world)[11, VIRTUAL].state
        assert min(math.hypot(me.x - u, me.y - v) for u, v in trail) < 0.06
    leader, me = robots(world)[10, VIRTUAL].state, robots(world)[11, VIRTUAL].state
    assert 0.3 < math.hypot(leader.x - me.x, leader.y - me.y) < 0.7


def test_waypoints_replace_the_leaders_path(file: Path) -> None:
    world = world_of(file, VirtualRobot(10, FigureEight(laps=0), parameters_of=0))
    utime = run(world, 3.0)
    assert robots(world)[10, VIRTUAL].state.x == 0.0
    waypoints = make(waypoints_t, utime=utime, robot_id=10, x=[0.0, 0.5, 1.0], y=[0.0, 0.0, 0.0])
    world.handle(utime, WAYPOINTS.channel(10), waypoints)
    utime = run(world, 6.0, utime)
    assert robots(world)[10, VIRTUAL].state.x == pytest.approx(1.0, abs=0.05)
    world.handle(utime, WAYPOINTS.channel(10), make(waypoints_t, utime=utime, robot_id=10, x=[], y=[]))
    run(world, 1.0, utime)
    assert robots(world)[10, VIRTUAL].state.psi_left == pytest.approx(0.0, abs=0.01)


def test_the_twin_starts_each_drive_at_its_robot_and_then_runs_freely(file: Path) -> None:
    world = world_of(file)
    drive_one = messages(DEFAULT, seconds=10.0)
    offset = 14_000_000
    drive_two = _continued(messages(DEFAULT, seed=9, seconds=10.0), drive_one, offset)
    gaps = []
    for channel, message in drive_one + drive_two:
        world.handle(message.utime, channel, message)
        if channel.startswith("MOTOR_FEEDBACK"):
            world.advance(message.utime)
            here = robots(world)
            if (0, TWIN) in here:
                real, twin = here[0, REAL].state, here[0, TWIN].state
                gaps.append((message.utime - EPOCH, math.hypot(real.x - twin.x, real.y - twin.y)))
    first = [gap for time, gap in gaps if time < 1_600_000]
    assert first
    assert max(first) < 0.02
    assert max(gap for time, gap in gaps if 9_000_000 < time < 11_000_000) > 1e-4  # it is not tied to the robot
    second = [gap for time, gap in gaps if offset + 1_520_000 < time < offset + 1_600_000]
    assert max(second) < 0.02


@pytest.mark.parametrize("latched", [False, True])
def test_a_twin_stands_still_during_an_emergency_stop(file: Path, latched: bool) -> None:
    world = world_of(file)
    drive_one = messages(DEFAULT, seconds=10.0)
    for channel, message in drive_one[: len(drive_one) // 2]:
        world.handle(message.utime, channel, message)
        world.advance(message.utime)
    utime = message.utime
    if latched:
        world.handle(utime, ESTOP_LATCH.channel(0), latch(0, True))
    else:
        world.handle(utime, ESTOP.name, make(estop_t, utime=utime, engaged=True, source="test", reason="test"))
    for k in range(150):
        now = utime + k * 10_000
        world.handle(now, MOTOR_COMMAND.channel(0), command(now, 0.5, 0.5))
        world.advance(now)
    assert robots(world)[0, TWIN].state.psi_left == pytest.approx(0.0, abs=0.01)


def test_one_wrong_time_stamp_does_not_freeze_a_robot(file: Path) -> None:
    world = world_of(file)
    drive_one = messages(DEFAULT, seconds=8.0)
    wrong = len(drive_one) // 2
    while not drive_one[wrong][0].startswith("MOTOR_FEEDBACK"):
        wrong += 1
    drive_one[wrong][1].utime += 3_600_000_000  # an hour ahead
    for channel, message in drive_one:
        world.handle(message.utime, channel, message)
        if message.utime < EPOCH + 60_000_000:
            world.advance(message.utime)
    real = robots(world)[0, REAL].state
    last = [message for channel, message in drive_one if channel.startswith("POSE")][-1]
    assert math.hypot(real.x - last.x, real.y - last.y) < 0.1


def test_simulated_robots_go_on_when_the_clock_is_set_back(file: Path) -> None:
    world = world_of(file, VirtualRobot(10, FigureEight(start=0.0), parameters_of=0))
    run(world, 3.0)
    before = robots(world)[10, VIRTUAL].state
    run(world, 1.0, EPOCH - 60_000_000)
    after = robots(world)[10, VIRTUAL].state
    assert math.hypot(after.x - before.x, after.y - before.y) > 0.1


def test_a_real_robot_that_fell_silent_leaves_the_world(file: Path) -> None:
    world = world_of(file)
    for channel, message in messages(DEFAULT, seconds=1.0):
        world.handle(message.utime, channel, message)
    world.advance(message.utime)
    assert (0, REAL) in robots(world)
    run(world, 2.0, message.utime)
    assert (0, REAL) not in robots(world)


@pytest.mark.parametrize(("seconds", "told", "shown"), [(0.3, False, False), (0.3, True, True), (1.0, False, True)])
def test_a_robot_is_not_shown_at_the_origin_while_its_pose_may_still_come(
    file: Path, seconds: float, told: bool, shown: bool
) -> None:
    world = world_of(file)
    end = EPOCH + int(seconds * 1e6)
    for channel, message in takewhile(lambda one: one[1].utime <= end, messages(DEFAULT, seconds=1.0)):
        if told or not channel.startswith("POSE"):
            world.handle(message.utime, channel, message)
    world.advance(end)
    assert ((0, REAL) in robots(world)) == shown


def test_a_virtual_robot_follows_a_real_one_behind_its_twin(file: Path) -> None:
    """Compiled, as users run it: the follower sees states of a fleet and of a real robot together."""
    world = world_of(file, VirtualRobot(11, Follow(leader=0, gap=0.4), parameters_of=0, x=-0.5))
    assert config.DISABLE_JIT == 0
    for channel, message in messages(DEFAULT, seconds=8.0):
        world.handle(message.utime, channel, message)
        world.advance(message.utime)
    here = robots(world)
    leader, follower = here[0, REAL].state, here[11, VIRTUAL].state
    assert math.hypot(leader.x, leader.y) > 0.5
    assert math.hypot(follower.x + 0.5, follower.y) > 0.3
    assert 0.2 < math.hypot(leader.x - follower.x, leader.y - follower.y) < 0.8


@pytest.mark.parametrize("nowhere", [(), (2,)])
def test_surroundings_are_as_compiled_functions_take_them_whoever_is_in_them(nowhere: tuple[int, ...]) -> None:
    view = WorldView()
    state = RobotState(*np.arange(35.0).reshape(5, 7).T)  # strided, as a message or a part of a fleet may be
    view.take(EPOCH, Robots(tuple(range(5)), (VIRTUAL,) * 5, state))
    view.put(Robot(EPOCH, 9, REAL, RobotState.at_rest(90.0)))
    for robot_id in nowhere:
        view.put(Robot(EPOCH, robot_id, VIRTUAL, RobotState.at_rest(math.nan)))
    around = view.surroundings()
    assert sorted(around.members.robot_id.tolist()) == sorted({0, 1, 2, 3, 4, 9} - set(nowhere))
    rows = (around.x, around.y, around.theta, around.psi_left, around.psi_right)
    assert all(row.flags.c_contiguous for row in rows)
    assert dict(zip(around.members.robot_id.tolist(), around.x, strict=True))[9] == 90.0


def test_behaviours_see_the_obstacles_of_the_world(file: Path) -> None:
    disc = Obstacles([(1.0, 0.0, 0.2)])
    virtual = VirtualRobot(11, Waypoints(points="2:0"), parameters_of=0)
    world = World([virtual], lambda robot_id: ParameterFollower(robot_id, file), obstacles=disc)
    nearest = math.inf
    for k in range(1_000):
        world.advance(EPOCH + 10_000 * k)
        state = robots(world)[11, VIRTUAL].state
        nearest = min(nearest, math.hypot(state.x - 1.0, state.y))
    assert nearest > 0.2 + float(body_radius(MODEL.base_width))  # it went round without touching it
    assert state.x == pytest.approx(2.0, abs=0.06)


def test_a_large_world_is_split_into_packets_that_hold_every_robot_once() -> None:
    everybody = [Robot(EPOCH, i, i % 2, RobotState(i, 0, 0, 0, 0, 0, 0)) for i in range(100)]
    parts = world_messages(EPOCH, everybody, largest=1400)
    assert len(parts) > 1
    assert all(len(part.encode()) <= 1400 for part in parts)
    assert [robot_id for part in parts for robot_id in part.robot_id] == list(range(100))
    view = WorldView()
    for part in parts:
        view.handle(part.utime, WORLD_STATE.name, world_state_t.decode(part.encode()))
    for i in range(100):
        robot = view.robot(i)
        assert robot is not None
        assert robot.state.x == i


class Circle(Behaviour):
    """A user's own behaviour, from outside the package."""

    def __init__(self, duty: float = 0.2) -> None:
        self.duty = duty

    def command(self, _utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        return self.duty / 2.0, self.duty


def test_users_bring_their_own_behaviour_by_name(file: Path) -> None:
    behaviour = make_behaviour("tests.world.test_world:Circle", {"duty": "0.4"})
    world = world_of(file, VirtualRobot(3, behaviour, parameters_of=0))
    run(world, 2.0)
    state = robots(world)[3, VIRTUAL].state
    assert state.psi_right == pytest.approx(0.4 / MODEL.k1, rel=1e-3)


@pytest.mark.parametrize(
    ("description", "settings", "said"),
    [
        ("fly", {}, "Shipped: figure_eight"),
        ("follow", {"lead": "3"}, "it has leader, gap, speed"),
        ("follow", {"gap": "wide"}, "gap"),
        ("figure_eight", {"speed": "-1"}, "above 0"),
        ("figure_eight", {"speed": "0.2/fast"}, "speed=0.2/0.5"),
        ("figure_eight", {"speed": "0.2/"}, "speed=0.2/0.5"),
        ("figure_eight", {"speed": "nan"}, "speed=0.2/0.5"),
        ("figure_eight", {"size": "0"}, "above 0"),
        ("cmr.world.world:World", {}, "not a class derived"),
    ],
)
def test_a_wrong_behaviour_is_named_with_what_is_allowed(description: str, settings: dict[str, str], said: str) -> None:
    with pytest.raises(BehaviourError, match=said):
        make_behaviour(description, settings)


def _continued(drive: list[Message], earlier: list[Message], offset: int) -> list[Message]:
    """Move a drive that starts at the origin to `offset` [us] later and to where the earlier one ended."""
    end = [message for channel, message in earlier if channel.startswith("POSE")][-1]
    cos, sin = math.cos(end.theta), math.sin(end.theta)
    for channel, message in drive:
        message.utime += offset
        if channel.startswith("POSE"):
            x, y = message.x, message.y
            message.x, message.y = end.x + cos * x - sin * y, end.y + sin * x + cos * y
            message.theta += end.theta
    return drive


def _without_pose_noise() -> Settings:
    quiet = replace(DEFAULT.imperfections.pose_noise, position=0.0, heading=0.0)
    return replace(DEFAULT, imperfections=replace(DEFAULT.imperfections, pose_noise=quiet))
