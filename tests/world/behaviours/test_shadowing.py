"""A shadow does as its leader does, in a place of its own."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cmr.bus.streams import PARAMETERS
from cmr.manoeuvres import in_sequence
from cmr.model.body import wrap
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours.manoeuvring import DriveManoeuvre
from cmr.world.behaviours.shadowing import Shadow
from cmr.world.view import VIRTUAL
from cmr.world.world import VirtualRobot, World
from tests.world.behaviours.team_bench import EPOCH, MODEL, STEP, STEPS, Bench

REACTION = 1.0 / (MODEL.k1 * MODEL.k2_over_k3) + STEPS * STEP  # s until a robot follows what its leader does
ROBOT = ParameterFile(0, {name: Value(value) for name, value in MODEL.values.items()})
START = (1.0, 2.0, 2.5)  # of the shadow; the leader starts at the origin
DRIVES = {
    "spins": [(-0.2, 0.2), (0.3, -0.3), (-0.1, 0.1)],
    "straight, there and back": [(0.5, 0.5), (-0.5, -0.5)],
    "circles": [(0.25, 0.5), (0.5, 0.25), (-0.25, -0.5)],
}


def as_seen_from(pose: tuple[float, float, float], x: float, y: float, theta: float) -> tuple[float, float, float]:
    """Return a pose as it is seen from another one."""
    dx, dy = x - pose[0], y - pose[1]
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return cosine * dx + sine * dy, cosine * dy - sine * dx, float(wrap(theta - pose[2]))


def pose_of(bench: Bench, index: int) -> tuple[float, float, float]:
    robot = bench.world.robot(index)
    assert robot is not None
    return robot.state.x, robot.state.y, robot.state.theta


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
def test_a_shadow_does_what_its_leader_does(drive: str) -> None:
    bench = Bench([(0.0, 0.0, 0.0), START], [(Shadow(leader=0), [1])])
    for duties in [*DRIVES[drive], (0.0, 0.0)]:
        change = np.array(duties) - bench.duties[0]
        speed = abs(change.sum()) / 2.0 / MODEL.k1 * MODEL.wheel_radius
        turning = abs(change[1] - change[0]) / MODEL.k1 * MODEL.wheel_radius / MODEL.base_width
        bench.duties[0] = duties
        for _ in bench.run(4.0):
            leader, shadow = pose_of(bench, 0), as_seen_from(START, *pose_of(bench, 1))
            # Whatever changes, it is behind by no more than what the change makes within its reaction.
            assert math.dist(leader[:2], shadow[:2]) < 0.05 + 2.0 * speed * REACTION
            assert abs(wrap(leader[2] - shadow[2])) < 0.1 + 2.0 * turning * REACTION
    leader, shadow = pose_of(bench, 0), as_seen_from(START, *pose_of(bench, 1))
    assert math.dist(leader[:2], shadow[:2]) < 0.05
    assert abs(wrap(leader[2] - shadow[2])) < 0.04
    assert not bench.duties[1].any()


def test_without_its_leader_it_stands() -> None:
    bench = Bench([(0.0, 0.0, 0.0), START], [(Shadow(leader=99), [1])], fixed={0: (0.4, 0.4)})
    for _ in bench.run(1.0):
        assert not bench.duties[1].any()


def test_a_leader_that_is_put_elsewhere_is_not_run_after() -> None:
    bench = Bench([(0.0, 0.0, 0.0), START, (9.0, 9.0, 1.0)], [(shadow := Shadow(leader=0), [1])])
    for _ in bench.run(0.5):
        pass
    shadow.adopt(1, {"leader": 2})
    for _ in bench.run(2.0):
        assert not bench.duties[1].any()
    assert pose_of(bench, 1) == pytest.approx(START)


def test_what_the_leader_did_while_the_shadow_was_stopped_is_not_made_up() -> None:
    """As after an emergency stop, or while poses were missing."""
    bench = Bench([(0.0, 0.0, 0.0), START], [(Shadow(leader=0), [1])])
    for _ in bench.run(0.5):
        pass
    teams, bench.teams = bench.teams, []
    for bench.duties[0] in ((-0.2, 0.2), (0.2, 0.2), (0.0, 0.0)):
        for _ in bench.run(1.0):
            pass
    bench.teams = teams
    for _ in bench.run(1.0):
        assert not bench.duties[1].any()


def test_nobody_is_a_shadow_of_its_own() -> None:
    bench = Bench([START, (0.0, 0.0, 0.0)], [], fixed={1: (0.5, 0.5)})
    for _ in bench.run(1.0):
        pass
    bench.teams = [(Shadow(leader=1), np.array([1]))]
    for _ in bench.run(0.1):
        assert not bench.duties[1].any()


def test_each_has_a_leader_of_its_own() -> None:
    shadow = Shadow()
    shadow.adopt(2, {"leader": 0})
    shadow.adopt(3, {"leader": 1})
    poses = [(0.0, 0.0, 0.0), (0.0, 2.0, 0.0), (3.0, 0.0, 0.0), (3.0, 2.0, 0.0)]
    bench = Bench(poses, [(shadow, [3, 2])], fixed={0: (-0.2, 0.2), 1: (0.4, 0.4)})
    for _ in bench.run(2.0):
        pass
    assert bench.x[2] == pytest.approx(3.0, abs=0.02)
    assert bench.x[3] - 3.0 == pytest.approx(bench.x[1], abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spins", "circles"])
def test_a_robot_of_another_kind_drives_the_manoeuvre_of_a_virtual_leader(name: str) -> None:
    """As a real robot does that a virtual leader is to take through what a diagnosis asks for."""
    leader, other = 10, replace(MODEL, k1=1.2 * MODEL.k1, base_width=1.1 * MODEL.base_width)
    virtual = [
        VirtualRobot(leader, DriveManoeuvre(name, speed=0.5), 0),
        VirtualRobot(11, Shadow(leader=leader), 0, *START),
    ]
    world = World(virtual, ParameterFollower, own_parameters={11: other})
    world.handle(EPOCH, PARAMETERS.channel(0), ROBOT.announcement(1))
    turned = {leader: 0.0, 11: 0.0}
    before = dict.fromkeys(turned, 0.0)
    for step in range(round(in_sequence(name).duties(MODEL, 0.5).duration * 100.0) + 300):
        world.advance(EPOCH + 10_000 * step)
        for robot in world.robots():
            assert robot.origin == VIRTUAL
            if step:
                turned[robot.robot_id] += abs(float(wrap(robot.state.theta - before[robot.robot_id])))
            before[robot.robot_id] = robot.state.theta
    assert turned[leader] > 2.0 * np.pi
    assert turned[11] == pytest.approx(turned[leader], rel=0.15)
