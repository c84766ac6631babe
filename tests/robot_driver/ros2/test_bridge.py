"""What a driver promises holds for a robot that is commanded over ROS 2, as far as its bridge can see to it."""

import random
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="the extra [ros] is not installed")

from cmr.bus.messages import make
from cmr.bus.streams import MOTOR_COMMAND, VELOCITY_COMMAND
from cmr.msg import command_claim_t, estop_t, motor_command_t, motor_feedback_t
from robot_driver.command_gate import LISTENING_TIME
from robot_driver.emulator.settings import load_settings
from robot_driver.host import Host
from robot_driver.ros2.bridge import RobotBridge
from robot_driver.ros2.messages import Velocity
from robot_driver.stop_file import StopFile
from tests.support import ros2_bench as bench
from tests.support.emulated_speed_robot import TURN

pytestmark = pytest.mark.slow
Bench = bench.Bench

SETTINGS = load_settings(ideal=True)
ZERO = Velocity(0.0, 0.0)
LIFETIME = 0.5  # s
CYCLE = 1.0 / bench.EXAMPLE.command.rate  # s
LOSSES = 200


@pytest.fixture
def driving() -> bench.Bench:
    robot = Bench(SETTINGS)
    robot.start()
    robot.drive(0.3, 0.5, seconds=0.4)
    assert robot.sent[-1][1] == pytest.approx((0.3, 0.5))
    return robot


def zero_after(robot: bench.Bench, since: float) -> float:
    """Return how long [s] after a moment the robot was sent zero for good."""
    moving = [time for time, velocity in robot.sent if velocity != ZERO and time > since]
    first = next(time for time, velocity in robot.sent if velocity == ZERO and time > max([since, *moving]))
    return float(first - since)


def test_the_robot_does_what_is_commanded(driving: bench.Bench) -> None:
    driving.drive(0.3, 0.5, seconds=1.5)  # ten time constants
    plant = driving.robot.robot.plant
    radius, width = SETTINGS.robot.wheel_radius, SETTINGS.robot.base_width
    assert radius * (plant.left.velocity + plant.right.velocity) / 2.0 == pytest.approx(0.3, rel=1e-3)
    assert radius * (plant.right.velocity - plant.left.velocity) / width == pytest.approx(0.5, rel=1e-3)
    assert driving.status == 0


def test_nothing_but_zero_is_sent_before_a_stop_would_have_been_heard() -> None:
    robot = Bench(SETTINGS)
    robot.drive(0.3, seconds=LISTENING_TIME - 0.02)
    assert {velocity for _, velocity in robot.sent} == {ZERO}


def test_commands_that_end_leave_zero_within_half_a_second_and_a_cycle_200_times() -> None:
    """Losses of the commands, and of the bus with all that is on it, at any moment of the cycle."""
    chance = random.Random(0)
    robot = Bench(SETTINGS, is_deserted=True)
    robot.start()
    longest = 0.0
    for loss in range(LOSSES):
        v, omega = chance.uniform(0.05, 0.7), chance.uniform(-5.0, 5.0)
        robot.drive(v, omega, seconds=0.3)
        assert robot.sent[-1][1] != ZERO
        robot.wait(TURN * chance.randrange(4))
        robot.velocity(v, omega)  # the last that is sent
        last = robot.clock.time
        robot.turn()
        robot.is_deaf = loss % 2 == 1
        while robot.clock.time < last + 1.0:
            if robot.is_deaf:
                robot.velocity(v, omega)  # and does not arrive
            robot.turn()
        longest = max(longest, zero_after(robot, last))
        robot.sent.clear()
        robot.is_deaf = False
    assert LIFETIME - TURN <= longest <= LIFETIME + CYCLE + TURN


def test_a_command_that_was_decided_long_ago_moves_nothing(driving: bench.Bench) -> None:
    driving.wait(1.0)
    for _ in range(50):
        driving.velocity(0.3, age=0.6)
        driving.wait(0.02)
    assert {velocity for time, velocity in driving.sent if time > driving.clock.time - 1.0} == {ZERO}
    assert driving.bridge.gate.rejected["old"] == 50


@pytest.mark.parametrize("v", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_moves_nothing(driving: bench.Bench, v: float) -> None:
    driving.wait(1.0)
    driving.velocity(v)
    driving.velocity(0.0, v)
    driving.turn()
    assert driving.sent[-1][1] == ZERO
    assert driving.bridge.gate.rejected["not_finite"] == 2


def test_too_fast_is_as_fast_as_the_profile_allows(driving: bench.Bench) -> None:
    driving.drive(50.0, -50.0, seconds=0.5)
    command = bench.EXAMPLE.command
    assert driving.sent[-1][1] == pytest.approx((command.speed, -command.turn_rate))


def test_an_emergency_stop_is_zero_at_once_and_latched(driving: bench.Bench) -> None:
    driving.estop(True)
    driving.velocity(0.3)
    begin = driving.clock.time
    driving.turn()
    assert driving.sent[-1][0] == pytest.approx(begin + TURN)
    assert driving.sent[-1][1] == ZERO
    driving.drive(0.3, seconds=1.0)
    assert {velocity for time, velocity in driving.sent if time > begin} == {ZERO}
    assert driving.status & motor_feedback_t.STATUS_ESTOP
    assert "EMERGENCY STOP engaged by test" in driving.bridge.remarks()


def test_after_a_release_zero_must_be_commanded_first(driving: bench.Bench) -> None:
    driving.estop(True)
    driving.wait(0.1)
    driving.estop(False)
    driving.drive(0.3, seconds=0.3)
    assert driving.sent[-1][1] == ZERO
    driving.drive(0.0, seconds=0.1)
    driving.drive(0.3, seconds=0.3)
    assert driving.sent[-1][1].v == pytest.approx(0.3)


def test_a_release_without_a_reason_is_none(driving: bench.Bench) -> None:
    driving.estop(True)
    driving.wait(0.1)
    driving.estop(False, reason="")
    driving.wait(0.1)
    driving.drive(0.0, seconds=0.1)
    driving.drive(0.3, seconds=0.3)
    assert driving.sent[-1][1] == ZERO


def test_an_emergency_stop_outlives_the_bridge(tmp_path: Path) -> None:
    file = StopFile(tmp_path, 0, "udpm://239.255.76.67:7667?ttl=0")
    with RobotBridge(0, bench.EXAMPLE, stop_file=file) as bridge:
        stop = make(estop_t, utime=Host().utime(), engaged=True, source="test", reason="a test")
        bridge.handle(stop.utime, "ESTOP", stop)
    with RobotBridge(0, bench.EXAMPLE, stop_file=file) as bridge:
        assert "EMERGENCY STOP engaged by test: a test" in bridge.remarks()
        assert bridge.velocity() == ZERO


def test_at_the_end_zero_is_sent_and_not_the_command_in_force(driving: bench.Bench) -> None:
    driving.velocity(0.3)
    driving.turn()
    assert driving.bridge.velocity() != ZERO
    assert driving.bridge.stop() == ZERO


def test_a_speed_grows_and_shrinks_on_the_ramp_of_the_profile() -> None:
    command = replace(bench.EXAMPLE.command, speeding_up=2.0, slowing_down=4.0)
    robot = Bench(SETTINGS, replace(bench.EXAMPLE, command=command))
    robot.start()
    robot.drive(command.speed, seconds=1.0)
    robot.drive(0.0, seconds=1.0)
    previous = robot.sent[0]
    for time, velocity in robot.sent[1:]:
        step = (velocity.v - previous[1].v) / command.speed
        seconds = time - previous[0]
        assert -4.0 * seconds - 1e-9 <= step <= 2.0 * seconds + 1e-9
        previous = (time, velocity)
    rising = [time for time, velocity in robot.sent if 0.0 < velocity.v < command.speed * (1.0 - 1e-9)]
    assert len(rising) >= 30  # half a second up and a quarter down, every 20 ms


def test_commands_of_one_owner_alone_are_taken(driving: bench.Bench) -> None:
    driving.wait(1.0)
    driving.claim(7)
    driving.turn()
    for _ in range(20):
        driving.velocity(0.3, sender=7)
        driving.velocity(-0.3, sender=8)
        driving.wait(0.02)
    assert driving.sent[-1][1].v == pytest.approx(0.3)
    assert all(velocity.v >= 0.0 for time, velocity in driving.sent if time > driving.clock.time - 0.3)
    assert "More than one process commands this robot" in driving.bridge.problems()
    driving.claim(8, command_claim_t.TAKE_OVER)
    driving.turn()
    for _ in range(20):
        driving.velocity(-0.3, sender=8)
        driving.wait(0.02)
    assert driving.sent[-1][1].v == pytest.approx(-0.3)


def test_two_who_claim_nothing_are_told_apart(driving: bench.Bench) -> None:
    for _ in range(30):
        driving.velocity(0.3)
        driving.wait(0.02)
        driving.velocity(-0.3)
        driving.wait(0.02)
    assert "More than one process commands this robot" in driving.bridge.problems()


def test_commands_of_another_robot_and_of_another_kind_move_nothing(driving: bench.Bench) -> None:
    driving.wait(1.0)
    utime = driving.clock.utime()
    driving.send(MOTOR_COMMAND.channel(0), make(motor_command_t, utime=utime, robot_id=0, left=0.5, right=0.5))
    driving.velocity(0.3)
    channel, message, sender = driving._waiting.pop()
    assert channel == VELOCITY_COMMAND.channel(0)
    message.robot_id = 1
    driving.send(VELOCITY_COMMAND.channel(1), message, sender)
    driving.wait(0.1)
    assert driving.sent[-1][1] == ZERO


def test_after_a_pause_of_the_process_the_commands_that_waited_move_nothing(driving: bench.Bench) -> None:
    driving.wait(1.0)
    driving.velocity(0.3)
    driving.clock.time += 0.4  # the process was held up; the command is still fresh
    driving.turn()
    assert driving.sent[-1][1] == ZERO
    assert driving.bridge.gate.rejected["held_up"] == 1


def test_topics_that_are_silent_are_named(driving: bench.Bench) -> None:
    assert driving.bridge.problems() == ""
    driving.clock.time += 1.5
    assert driving.bridge.problems() == "Nothing is heard on joint_states, imu, pose."


def test_what_comes_over_ros_neither_commands_a_robot_nor_releases_a_stop(driving: bench.Bench) -> None:
    driving.estop(True)
    driving.turn()
    driving.heard.clear()
    driving.wait(3.0)  # in which the robot says all that it can
    assert {channel for channel, _ in driving.heard} == {"MOTOR_FEEDBACK_0", "GYRO_0", "POSE_0"}
    assert driving.bridge.velocity() == ZERO
    assert "EMERGENCY STOP engaged" in driving.bridge.remarks()
