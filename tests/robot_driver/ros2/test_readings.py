"""What a ROS 2 robot says arrives on the bus with the right numbers, signs and time stamps."""

import math
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="the extra [ros] is not installed")

from cmr.bus.streams import POSE
from cmr.msg import gyro_t, motor_feedback_t, pose_xyt_t
from robot_driver.emulator.settings import load_settings
from robot_driver.ros2 import messages as ros
from robot_driver.ros2.profile import Profile
from robot_driver.ros2.readings import Readings
from robot_driver.ros2.robot_clock import NOTICED, RobotClock
from tests.support import ros2_bench as bench

pytestmark = pytest.mark.slow
SETTINGS = load_settings(ideal=True)
TEXT = bench.example_text()
SECOND = 1_000_000  # us
BEGIN = 1_700_000_000 * SECOND


def fed(profile: Profile, take: str, kind: str, values: list[Any], fill: Any, *, every: int = 20_000) -> list[Any]:
    """Return what readings make of messages that arrive at once, of which the last ones count: the clock is known."""
    readings = Readings(0, profile, lambda: 0)
    said = []
    for number, value in enumerate(values):
        message = bench.empty(kind)
        fill(message, BEGIN + number * every, value)
        said += [outgoing for _, _, outgoing in getattr(readings, take)(message, BEGIN + number * every)]
    return said


def joints(message: Any, utime: int, values: tuple[float, float, float, float]) -> None:
    left, right, psi_left, psi_right = values
    names = ("wheel_left_joint", "wheel_right_joint", "a_caster")
    ros.write_joints(message, ros.Joints(utime, names, (left, right, 9.0), (psi_left, psi_right, 9.0)))


def test_wheels_count_from_where_they_were_first_and_keep_their_speeds() -> None:
    turned = [(100.0 + 0.02 * k, -50.0 - 0.04 * k, 1.0, -2.0) for k in range(60)]
    last = fed(Profile.parse(TEXT), "wheels", ros.JOINT_STATE, turned, joints)[-1]
    assert isinstance(last, motor_feedback_t)
    turn = 2048 / (2.0 * math.pi)
    assert (last.ticks_left, last.ticks_right) == (round(59 * 0.02 * turn), round(-59 * 0.04 * turn))
    assert (last.psi_left, last.psi_right) == (1.0, -2.0)
    assert last.utime == last.received_utime == BEGIN + 59 * 20_000
    assert all(math.isnan(value) for value in (last.applied_left, last.battery_voltage, last.temperature))


@pytest.mark.parametrize(
    ("changes", "psi"),
    [
        ((("sign: 1                      # -1: the joints", "sign: -1 #"),), (-1.0, 2.0)),
        ((("speed: rad/s", "speed: m/s"),), (1.0 / 0.04, -2.0 / 0.04)),
        ((("speed: rad/s", "speed: none"),), (0.02 / 0.02, -0.04 / 0.02)),
    ],
)
def test_units_and_signs_of_wheels(changes: tuple[tuple[str, str], ...], psi: tuple[float, float]) -> None:
    turned = [(0.02 * k, -0.04 * k, 1.0, -2.0) for k in range(60)]
    last = fed(bench.profile_of(TEXT, *changes), "wheels", ros.JOINT_STATE, turned, joints)[-1]
    assert (last.psi_left, last.psi_right) == pytest.approx(psi)


def test_several_wheels_a_side_are_their_mean() -> None:
    profile = bench.profile_of(TEXT, ("left: wheel_left_joint  ", "left: 'wheel_left_joint, a_caster' "))
    last = fed(profile, "wheels", ros.JOINT_STATE, [(0.0, 0.0, 1.0, -2.0)] * 60, joints)[-1]
    assert last.psi_left == pytest.approx(5.0)


def test_joints_of_others_on_the_same_topic_are_passed_over() -> None:
    def arm(message: Any, utime: int, _value: None) -> None:
        ros.write_joints(message, ros.Joints(utime, ("elbow",), (1.0,), (1.0,)))

    assert fed(Profile.parse(TEXT), "wheels", ros.JOINT_STATE, [None] * 60, arm) == []


def test_a_robot_without_joints_has_the_wheels_of_its_odometry() -> None:
    profile = bench.profile_of(TEXT, ("type: sensor_msgs/msg/JointState", "type: nav_msgs/msg/Odometry"))
    v, omega = 0.2, 0.5

    def moving(message: Any, utime: int, _value: None) -> None:
        ros.write_odometry(message, ros.Odometry(utime, "odom", "base_link", 0.0, 0.0, 0.0, v, omega))

    last = fed(profile, "wheels", ros.ODOMETRY, [None] * 61, moving)[-1]
    psi = (v - omega * 0.161 / 2.0) / 0.04, (v + omega * 0.161 / 2.0) / 0.04
    assert (last.psi_left, last.psi_right) == pytest.approx(psi)
    seconds, turn = 60 * 0.02, 2048 / (2.0 * math.pi)
    # The first half second is not published, but counts.
    assert (last.ticks_left, last.ticks_right) == pytest.approx([seconds * one * turn for one in psi], abs=0.51)


def test_an_imu_upside_down_turns_the_other_way() -> None:
    def turning(message: Any, utime: int, rate: float) -> None:
        ros.write_imu(message, utime, "imu_link", rate)

    profile = bench.profile_of(TEXT, ("sign: 1                      # -1: the IMU", "sign: -1 #"))
    said = fed(profile, "gyro", ros.IMU, [0.7] * 59 + [math.nan], turning)
    assert isinstance(said[-1], gyro_t)
    assert (said[-2].yaw_rate, said[-2].valid) == (-0.7, 1)
    assert math.isnan(said[-1].yaw_rate)
    assert said[-1].valid == 0


def test_a_pose_comes_from_the_chain_of_frames() -> None:
    profile = bench.profile_of(
        TEXT, ("  topic: pose\n", ""), ("  type: geometry_msgs/msg/PoseStamped", "  frames: map, odom, base_link #")
    )
    readings = Readings(0, profile, lambda: 0)
    said: list[Any] = []

    def tell(utime: int, parent: str, child: str, x: float, y: float, theta: float) -> None:
        message = bench.empty(ros.TRANSFORM)
        ros.write_transform(message, ros.Placed(utime, parent, child, x, y, theta))
        said.extend(readings.transforms([message], utime))

    for k in range(60):
        utime = BEGIN + k * 20_000
        if k % 10 == 5:
            tell(utime - 7_000, "/map", "odom", 1.0, 2.0, math.pi / 2.0)
        tell(utime, "odom", "base_link", 0.5, 0.25, math.pi)
        tell(utime, "base_link", "laser", 9.0, 9.0, 1.0)
    stream, robot_id, pose = said[-1]
    assert (stream, robot_id) == (POSE, 0)
    assert isinstance(pose, pose_xyt_t)
    # A quarter turn: x ahead is y there. Three quarters to the left are one to the right.
    assert (pose.x, pose.y, pose.theta) == pytest.approx((1.0 - 0.25, 2.0 + 0.5, -math.pi / 2.0))
    assert pose.utime == BEGIN + 59 * 20_000


def test_what_is_repeated_and_what_is_no_number_is_counted() -> None:
    readings = Readings(0, Profile.parse(TEXT), lambda: 0)
    for k in range(60):
        for _ in range(2):
            message = bench.empty(ros.JOINT_STATE)
            joints(message, BEGIN + k * 20_000, (0.0, 0.0, math.nan if k == 59 else 0.0, 0.0))
            readings.wheels(message, BEGIN + k * 20_000)
    assert readings.refused == {"wheels repeated": 60, "wheels that are not finite": 1}


@pytest.mark.parametrize("offset", [-3.0, -0.05, 0.05, 2.5, 40_000.0])
def test_a_clock_that_is_apart_is_measured_reported_and_corrected(offset: float) -> None:
    clock, latency = RobotClock(), 0.002
    for k in range(200):
        measured = BEGIN + k * 20_000
        late = 0.03 if k % 5 else 0.0  # four of five messages are held up
        here = clock.here(measured - round(offset * 1e6), measured + round((latency + late) * 1e6))
    assert clock.offset == pytest.approx(offset + latency, abs=1e-4)
    assert here is not None
    assert abs(here - measured) <= latency * 1e6 + 100  # the least that every message needs cannot be seen
    assert f"{abs(offset + latency):.3f} s {'behind' if offset > 0.0 else 'ahead of'}" in clock.remark()


def test_a_clock_that_agrees_is_left_as_it_is() -> None:
    clock = RobotClock()
    for k in range(100):
        stamp = BEGIN + k * 20_000
        here = clock.here(stamp, stamp + round(0.9 * NOTICED * 1e6))
    assert here == stamp
    assert clock.remark() == ""


def test_a_message_without_a_stamp_counts_as_of_its_arrival() -> None:
    clock = RobotClock()
    assert clock.here(0, BEGIN) == BEGIN
    assert "Messages without a time stamp, taken by their arrival: 1." in clock.remark()


def test_stamps_of_a_robot_whose_clock_is_ahead_are_those_of_this_computer() -> None:
    robot = bench.Bench(SETTINGS, ahead=3.7)
    robot.wait(3.0)
    feedback = [one for _, one in robot.heard if isinstance(one, motor_feedback_t)]
    assert len(feedback) > 100
    assert all(abs(one.utime - one.received_utime) <= 10_000 for one in feedback)  # a turn of the bench is 5 ms
    assert "3.7" in robot.bridge.remarks()
