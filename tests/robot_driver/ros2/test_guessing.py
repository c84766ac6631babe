"""What a probe writes is a profile, says what must be checked, and knows the robots that CMR has profiles of."""

import pytest

from cmr.cli.errors import CommandError
from robot_driver.ros2 import messages as ros
from robot_driver.ros2.guessing import Found, Topic, guessed
from robot_driver.ros2.profile import Profile


def topic(name: str, kind: str, *, taken: bool = False, reliable: bool = True) -> Topic:
    return Topic(name, kind, not taken, taken, reliable)


TURTLE = Found(
    "/tb3",
    (
        topic("/tb3/cmd_vel", ros.TWIST, taken=True),
        topic("/tb3/imu", ros.IMU, reliable=False),
        topic("/tb3/joint_states", ros.JOINT_STATE),
        topic("/tb3/odom", ros.ODOMETRY),
        topic("/tb3/battery_state", "sensor_msgs/msg/BatteryState"),
    ),
    {"/tb3/joint_states": ("wheel_left_joint", "wheel_right_joint")},
)


def test_a_robot_that_is_known_gets_the_numbers_of_its_profile() -> None:
    text, remarks = guessed(TURTLE)
    profile, shipped = Profile.parse(text), Profile.load("turtlebot3")
    assert profile.nominal == shipped.nominal
    assert (profile.command.topic, profile.command.type) == ("cmd_vel", ros.TWIST)
    assert profile.command.speed == shipped.command.speed
    assert profile.wheels.joints == (["wheel_left_joint"], ["wheel_right_joint"])
    assert profile.gyro is not None
    assert (profile.gyro.topic, profile.gyro.reliability) == ("imu", "best_effort")
    assert profile.wheels.reliability == "reliable"
    assert any("TurtleBot3" in remark for remark in remarks)


def test_what_no_topic_says_is_left_out_or_marked() -> None:
    text, remarks = guessed(TURTLE)
    profile = Profile.parse(text)
    assert profile.base.command_timeout is None  # so that it is not driven before somebody has found out
    assert profile.pose is None
    assert text.count("CHECK") >= 5
    assert any("stops by itself" in remark for remark in remarks)


def test_a_robot_that_nobody_knows_has_its_wheels_found_by_the_names_of_joints() -> None:
    names = ("arm_1", "front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel")
    topics = (
        topic("/cmd_vel", ros.TWIST_STAMPED, taken=True),
        topic("/joint_states", ros.JOINT_STATE),
        topic("/amcl_pose", ros.POSE_WITH_COVARIANCE),
    )
    profile = Profile.parse(guessed(Found("", topics, {"/joint_states": names}))[0])
    assert profile.wheels.joints == (
        ["front_left_wheel", "rear_left_wheel"],
        ["front_right_wheel", "rear_right_wheel"],
    )
    assert profile.command.type == ros.TWIST_STAMPED
    assert profile.pose is not None
    assert (profile.pose.topic, profile.pose.type) == ("amcl_pose", ros.POSE_WITH_COVARIANCE)


def test_a_robot_without_joints_gets_its_odometry() -> None:
    topics = tuple(one for one in TURTLE.topics if one.kind != ros.JOINT_STATE)
    profile = Profile.parse(guessed(Found("/tb3", topics, {}))[0])
    assert (profile.wheels.topic, profile.wheels.type) == ("odom", ros.ODOMETRY)
    assert profile.name in ("TurtleBot 4", "iRobot Create 3")  # with the same topics and numbers


@pytest.mark.parametrize(
    ("kinds", "said"), [((ros.TWIST,), "nothing that could be driven"), ((ros.JOINT_STATE, ros.ODOMETRY), "how the")]
)
def test_a_robot_that_cannot_be_driven_or_seen_is_none(kinds: tuple[str, ...], said: str) -> None:
    topics = tuple(one for one in TURTLE.topics if one.kind not in kinds)
    with pytest.raises(CommandError, match=said):
        guessed(Found("/tb3", topics, {}))
