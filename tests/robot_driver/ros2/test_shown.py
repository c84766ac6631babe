"""Virtual robots appear in ROS 2 as they are in the world, and are driven from there; real ones are not."""

import math
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.claiming import NOBODY
from cmr.bus.messages import make
from cmr.bus.streams import COMMAND_CLAIM, COMMAND_OWNER, MOTOR_COMMAND, VELOCITY_COMMAND
from cmr.bus.world_state import WorldState
from cmr.msg import command_claim_t, command_owner_t, robot_state_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from robot_driver.ros2.messages import Velocity
from robot_driver.ros2.shown import ShownRobot

RADIUS, WIDTH, K1 = 0.04, 0.16, 0.05
MOTORS = {"wheel_radius": RADIUS, "base_width": WIDTH, "k2_over_k3": 118.0, "k1": K1}
CONTROLLED = {
    **{"wheel_radius": RADIUS, "base_width": WIDTH, "command_base_width": WIDTH},
    **{"response_time": 0.2, "top_wheel_speed": 20.0},
}
NOW = 1_700_000_000_000_000  # us
REAL, VIRTUAL, TWIN = robot_state_t.REAL, robot_state_t.VIRTUAL, robot_state_t.TWIN


def robot(folder: Path, values: dict[str, float] = MOTORS, *, is_commanded: bool = True) -> ShownRobot:
    path = folder / "robot_10.yaml"
    ParameterFile(10, {name: Value(value) for name, value in values.items()}).save(path)
    return ShownRobot(10, ParameterFollower(10, path), lambda: 77, is_commanded=is_commanded)


def world(utime: int, *robots: tuple[int, int, tuple[float, float, float, float, float]]) -> WorldState:
    columns = [[values[k] for _, _, values in robots] for k in range(5)]
    nothing = [0.0] * len(robots)
    return WorldState(utime, [one for one, _, _ in robots], [one for _, one, _ in robots], *columns, nothing, nothing)


HERE = (1.0, 2.0, 0.5, 5.0, 7.0)  # x, y, theta, psi left and right


def test_a_robot_is_shown_where_it_is_and_as_fast_as_its_wheels_turn(tmp_path: Path) -> None:
    shown = robot(tmp_path)
    shown.state(world(NOW, (10, VIRTUAL, HERE)), NOW)
    state = shown.state(world(NOW + 50_000, (9, VIRTUAL, (0.0,) * 5), (10, VIRTUAL, HERE)), NOW + 50_000)
    assert state is not None
    odometry = state.odometry
    assert (odometry.utime, odometry.parent, odometry.child) == (NOW + 50_000, "robot_10/odom", "robot_10/base_link")
    assert (odometry.x, odometry.y, odometry.theta) == (1.0, 2.0, 0.5)
    assert odometry.v == pytest.approx(RADIUS * 6.0)
    assert odometry.omega == pytest.approx(RADIUS * 2.0 / WIDTH)
    assert state.joints.velocities == (5.0, 7.0)
    assert state.joints.positions == pytest.approx((0.25, 0.35))
    assert state.transform[1:] == ("robot_10/odom", "robot_10/base_link", 1.0, 2.0, 0.5)
    assert shown.anchor[1:] == ("map", "robot_10/odom", 0.0, 0.0, 0.0)


def test_the_twin_of_a_real_robot_is_not_it(tmp_path: Path) -> None:
    shown = robot(tmp_path, is_commanded=False)
    state = shown.state(world(NOW, (10, TWIN, (0.0,) * 5), (10, REAL, HERE)), NOW)
    assert state is not None
    assert state.odometry.x == 1.0


def test_a_state_that_is_no_number_is_not_shown(tmp_path: Path) -> None:
    shown = robot(tmp_path)
    assert shown.state(world(NOW, (10, VIRTUAL, (math.nan, *HERE[1:]))), NOW) is None
    assert shown.refused["states that are not finite"] == 1


def sent(outgoing: list[Any], stream: Any) -> list[Any]:
    return [message for one, robot_id, message in outgoing if one is stream and robot_id == 10]


def test_a_velocity_becomes_the_duties_that_it_takes_and_a_claim(tmp_path: Path) -> None:
    shown = robot(tmp_path)
    shown.state(world(NOW, (10, VIRTUAL, HERE)), NOW)
    outgoing = shown.drive(Velocity(0.2, 1.0), NOW)
    (command,) = sent(outgoing, MOTOR_COMMAND)
    assert command.left == pytest.approx(K1 * (0.2 - 0.08) / RADIUS)
    assert command.right == pytest.approx(K1 * (0.2 + 0.08) / RADIUS)
    assert command.utime == NOW
    (claim,) = sent(outgoing, COMMAND_CLAIM)
    assert claim.action == command_claim_t.CLAIM


def test_a_robot_with_a_velocity_controller_is_told_the_velocity(tmp_path: Path) -> None:
    shown = robot(tmp_path, CONTROLLED)
    shown.state(world(NOW, (10, VIRTUAL, HERE)), NOW)
    (command,) = sent(shown.drive(Velocity(0.2, 1.0), NOW), VELOCITY_COMMAND)
    assert (command.v, command.omega) == pytest.approx((0.2, 1.0))


def test_the_claim_ends_when_velocities_end(tmp_path: Path) -> None:
    shown = robot(tmp_path)
    shown.state(world(NOW, (10, VIRTUAL, HERE)), NOW)
    shown.drive(Velocity(0.2, 0.0), NOW)
    shown.state(world(NOW, (10, VIRTUAL, HERE)), NOW + 900_000)
    assert [one.action for one in sent(shown.turn(NOW + 900_000), COMMAND_CLAIM)] == [command_claim_t.CLAIM]
    ended = shown.turn(NOW + 1_100_000)
    assert [one.action for one in sent(ended, COMMAND_CLAIM)] == [command_claim_t.END]
    assert [(one.left, one.right) for one in sent(ended, MOTOR_COMMAND)] == [(0.0, 0.0)]
    assert shown.turn(NOW + 1_200_000) == []


@pytest.mark.parametrize(
    ("origin", "seen", "is_commanded", "why"),
    [
        (REAL, NOW, True, "is real: ROS 2 commands virtual ones"),
        (VIRTUAL, NOW - 1_500_000, True, "is not in the world"),
        (None, NOW, True, "is not in the world"),
        (VIRTUAL, NOW, False, "is only shown"),
    ],
)
def test_what_is_not_a_virtual_robot_of_the_world_is_not_driven_from_ros(
    tmp_path: Path, origin: int | None, seen: int, is_commanded: bool, why: str
) -> None:
    shown = robot(tmp_path, is_commanded=is_commanded)
    if origin is not None:
        shown.state(world(seen, (10, origin, HERE)), seen)
    assert shown.drive(Velocity(0.2, 0.0), NOW) == []
    assert shown.turn(NOW) == []
    assert shown.refused["velocities that do not move it"] == 1
    assert why in shown.problem(NOW)


def test_whom_another_process_commands_is_not_driven_from_ros(tmp_path: Path) -> None:
    shown = robot(tmp_path)
    shown.state(world(NOW, (10, VIRTUAL, HERE)), NOW)
    about = {"utime": NOW, "robot_id": 10, "since_utime": NOW}
    owner = make(command_owner_t, **about, sender=5, owner="cmr-teleop")
    shown.handle(NOW, COMMAND_OWNER.channel(10), owner)
    assert shown.drive(Velocity(0.2, 0.0), NOW) == []
    assert "is commanded by cmr-teleop" in shown.problem(NOW)
    nobody = make(command_owner_t, **about, sender=NOBODY, owner="")
    shown.handle(NOW, COMMAND_OWNER.channel(10), nobody)
    assert sent(shown.drive(Velocity(0.2, 0.0), NOW), MOTOR_COMMAND)


@pytest.mark.parametrize("velocity", [Velocity(math.nan, 0.0), Velocity(0.0, math.inf)])
def test_a_velocity_that_is_no_number_moves_nothing(tmp_path: Path, velocity: Velocity) -> None:
    shown = robot(tmp_path)
    shown.state(world(NOW, (10, VIRTUAL, HERE)), NOW)
    assert shown.drive(velocity, NOW) == []
    assert shown.refused["velocities that are not finite"] == 1


def test_what_ros_asks_of_a_virtual_robot_reaches_no_other_one_and_no_stop(tmp_path: Path) -> None:
    shown = robot(tmp_path)
    shown.state(world(NOW, (10, VIRTUAL, HERE), (0, REAL, HERE)), NOW)
    outgoing = [*shown.drive(Velocity(0.2, 0.0), NOW), *shown.turn(NOW + 300_000), *shown.end(NOW + 400_000)]
    assert {robot_id for _, robot_id, _ in outgoing} == {10}
    assert {stream for stream, _, _ in outgoing} == {MOTOR_COMMAND, COMMAND_CLAIM}
