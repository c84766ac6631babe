"""Promises of importing bags: what a robot's topics say comes out in our units, from ROS 1, ROS 2 and MCAP alike."""

import math
import shutil
import sqlite3
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.cli.errors import CommandError
from cmr.parameters.file import parse
from cmr_tools.importing.import_log import main
from cmr_tools.importing.ros_messages import decoder
from tests.support.ros_bags import (
    COUNT,
    COUNTER,
    DELAY,
    GYRO,
    KINDS,
    START,
    STEP,
    WHOLE,
    Sent,
    command_at,
    drive,
    header,
    mapping_of,
    pose_at,
    run,
    wheels,
    write_bag,
)


def check_whole(messages: dict[str, list[Any]]) -> None:
    """Require what WHOLE makes of `drive`."""
    stamps = [(START + i * STEP) // 1000 for i in range(COUNT)]
    feedback, commands = messages["MOTOR_FEEDBACK_0"], messages["MOTOR_COMMAND_0"]
    gyro, poses = messages["GYRO_0"], messages["POSE_0"]
    assert [one.utime for one in feedback] == [one.utime for one in gyro] == [one.utime for one in poses] == stamps
    assert [one.utime for one in commands] == [stamp + DELAY // 1000 for stamp in stamps]
    assert [one.received_utime for one in gyro] == [stamp + DELAY // 1000 for stamp in stamps]
    turns = [round(0.1 * i / (2 * math.pi) * 1000) for i in range(COUNT)]
    assert [one.ticks_left for one in feedback] == turns
    assert [one.ticks_right for one in feedback] == [round(-0.2 * i / (2 * math.pi) * 1000) for i in range(COUNT)]
    assert [one.psi_left for one in feedback] == [2.0 + i for i in range(COUNT)]
    assert {one.psi_right for one in feedback} == {-4.0}
    assert [one.yaw_rate for one in gyro] == [0.7 * i for i in range(COUNT)]
    assert [(one.x, one.y) for one in poses] == [(0.01 * i, -0.02 * i) for i in range(COUNT)]
    assert [math.remainder(one.theta - 0.3 * i, math.tau) for i, one in enumerate(poses)] == pytest.approx(
        [0.0] * COUNT
    )
    v, omega = (np.array([a + b * i for i in range(COUNT)]) for a, b in ((0.25, 0.001), (0.5, -0.01)))
    assert [one.left for one in commands] == pytest.approx((v - omega * 0.1) / 0.05 / 20.0)
    assert [one.right for one in commands] == pytest.approx((v + omega * 0.1) / 0.05 / 20.0)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_bag_gives_the_numbers_that_were_written(
    tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    check_whole(run(tmp_path, WHOLE, write_bag(tmp_path, kind, drive())))
    said = capsys.readouterr().out
    assert "skipped" not in said
    assert "note" not in said


@pytest.mark.parametrize(("kind", "suffix"), [("sqlite", "db3"), ("mcap", "mcap")])
def test_the_file_of_a_bag_may_be_given_without_its_folder(tmp_path: Path, kind: str, suffix: str) -> None:
    (file,) = write_bag(tmp_path, kind, drive()).glob(f"*.{suffix}")
    check_whole(run(tmp_path, WHOLE, file.rename(tmp_path / f"alone.{suffix}")))


def test_a_folder_of_split_bags_is_one_recording(tmp_path: Path) -> None:
    sent = drive()
    for part, begin in enumerate((0, 100)):
        (tmp_path / f"{part}").mkdir()
        path = write_bag(tmp_path / f"{part}", "ros1", sent[begin : begin + 100] if part == 0 else sent[begin:])
        (tmp_path / "split").mkdir(exist_ok=True)
        path.rename(tmp_path / "split" / f"run_{part}.bag")
    check_whole(run(tmp_path, WHOLE, tmp_path / "split"))


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
@pytest.mark.parametrize(("topic", "path"), [("/odom", "pose.pose."), ("/mocap", "pose."), ("/amcl", "pose.pose.")])
def test_poses_of_all_kinds_are_read_alike(tmp_path: Path, kind: str, topic: str, path: str) -> None:
    bag = write_bag(tmp_path, kind, [one for one in drive() if one[0] == topic])
    poses = run(tmp_path, mapping_of({topic: "header"}, pose=pose_at(topic, path)), bag)["POSE_0"]
    assert [(one.x, one.y) for one in poses] == [(0.01 * i, -0.02 * i) for i in range(COUNT)]


@pytest.mark.parametrize("kind", ["ros1", "sqlite"])
def test_a_pair_of_frames_is_chosen_from_tf_with_its_own_stamp(tmp_path: Path, kind: str) -> None:
    base = "transforms[odom>base].transform"
    pose = {
        "topic": "/tf",
        "x": {"field": f"{base}.translation.x", "unit": "m"},
        "y": {"field": f"{base}.translation.y", "unit": "m"},
        "theta": {"field": f"{base}.rotation.yaw", "unit": "rad"},
    }
    poses = run(tmp_path, mapping_of({"/tf": "header"}, pose=pose), write_bag(tmp_path, kind, drive()))["POSE_0"]
    assert [one.utime for one in poses] == [(START + i * STEP) // 1000 for i in range(COUNT)]
    assert [one.x for one in poses] == [0.5 * i for i in range(COUNT)]
    assert [one.theta for one in poses] == pytest.approx([-0.1 * i for i in range(COUNT)])


def test_commands_with_a_header_count_from_when_they_were_sent(tmp_path: Path) -> None:
    mapping = mapping_of({"/cmd_stamped": "header"}, motor_command=command_at("/cmd_stamped", "twist."))
    commands = run(tmp_path, mapping, write_bag(tmp_path, "mcap", drive()))["MOTOR_COMMAND_0"]
    assert [one.utime for one in commands] == [(START + i * STEP) // 1000 for i in range(COUNT)]


def test_a_header_clock_that_was_set_wrong_is_shifted_by_the_smallest_delay(tmp_path: Path) -> None:
    wrong = 7 * 10**9
    sent = [("/imu", "sensor_msgs/msg/Imu", START + i * STEP, {"header": header(wrong + i * STEP)}) for i in range(5)]
    gyro = run(tmp_path, mapping_of({"/imu": "shifted_header"}, gyro=GYRO), write_bag(tmp_path, "ros1", sent))["GYRO_0"]
    assert [one.utime for one in gyro] == [(START + DELAY + i * STEP) // 1000 for i in range(5)]


@pytest.mark.parametrize(("wrong", "noted"), [(-1000.0, True), (3.7, True), (0.4, False)])
def test_clocks_that_differ_by_the_arrival_of_their_messages_are_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: float, noted: bool
) -> None:
    mapping = mapping_of({"/imu": "header", "/cmd_vel": "received"}, gyro=GYRO, motor_command=command_at("/cmd_vel"))
    stamps = [START + i * STEP for i in range(5)]
    sent: list[Sent] = [
        ("/imu", "sensor_msgs/msg/Imu", at, {"header": header(at + round(wrong * 1e9))}) for at in stamps
    ]
    sent += [("/cmd_vel", "geometry_msgs/msg/Twist", at, {}) for at in stamps]
    run(tmp_path, mapping, write_bag(tmp_path, "mcap", sent))
    ahead, behind = ("/imu", "/cmd_vel") if wrong > 0.0 else ("/cmd_vel", "/imu")
    sentence = f"{ahead} is stamped by a clock that is {abs(wrong):.1f} s ahead of that of {behind}"
    assert (sentence in capsys.readouterr().out) == noted


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_counters_of_a_makers_own_type_may_wrap_around(tmp_path: Path, kind: str) -> None:
    ticks = {f"ticks_{side}": {"field": side, "unit": "ticks"} for side in ("left", "right")}
    mapping = mapping_of({"/ticks": "header"}, motor_feedback={"topic": "/ticks", "ticks_per_turn": 100, **ticks})
    counts = [(2**31 - 3, 2), (-(2**31) + 4, 2**16 - 1)]
    sent: list[Sent] = [
        ("/ticks", "maker/msg/Ticks", START + i * STEP, {"header": header(START + i * STEP), "left": a, "right": b})
        for i, (a, b) in enumerate(counts)
    ]
    bag = write_bag(tmp_path, kind, sent)
    (feedback,) = run(tmp_path, mapping, bag)["MOTOR_FEEDBACK_0"]
    assert (feedback.ticks_left, feedback.ticks_right) == (7, -3)


def without_definitions(bag: Path) -> Path:
    """Make the bag one as ROS 2 Humble wrote them, which defines no types."""
    (file,) = bag.glob("*.db3")
    connection = sqlite3.connect(file)
    connection.execute("DROP TABLE message_definitions")
    connection.commit()
    connection.close()
    return bag


def test_bags_before_iron_define_no_types_and_are_read_by_those_that_every_ros_knows(tmp_path: Path) -> None:
    check_whole(run(tmp_path, WHOLE, without_definitions(write_bag(tmp_path, "sqlite", drive()))))


def test_a_type_that_nobody_defines_is_asked_for_and_taken_from_the_mapping(tmp_path: Path) -> None:
    ticks = {f"ticks_{side}": {"field": side, "unit": "ticks"} for side in ("left", "right")}
    feedback = {"topic": "/ticks", "ticks_per_turn": 100, **ticks}
    sent: list[Sent] = [("/ticks", "maker/msg/Ticks", START + i * STEP, {"left": 5 * i}) for i in range(3)]
    bag = without_definitions(write_bag(tmp_path, "sqlite", sent))
    with pytest.raises(CommandError, match=r"/ticks \(maker/msg/Ticks\) .* neither the bag nor rosbags .*definition"):
        run(tmp_path, mapping_of({"/ticks": "received"}, motor_feedback=feedback), bag)
    defined = {"/ticks": {"time": "received", "definition": COUNTER}}
    messages = run(tmp_path, mapping_of(defined, motor_feedback=feedback), bag)["MOTOR_FEEDBACK_0"]
    assert [one.ticks_left for one in messages] == [5, 10]


def test_a_message_without_a_wheels_joint_is_left_out_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sent = [one for one in drive() if one[0] == "/joint_states"]
    for _, _, _, content in sent[::2]:
        content |= {"name": ["arm"], "position": [1.0], "velocity": []}
    bag = write_bag(tmp_path, "sqlite", sent)
    messages = run(tmp_path, mapping_of({"/joint_states": "header"}, motor_feedback=wheels()), bag)
    assert len(messages["MOTOR_FEEDBACK_0"]) == COUNT / 2
    assert "/joint_states: 15 x message with no position[left]" in capsys.readouterr().out


WRONG: list[tuple[dict[str, Any], str]] = [
    (
        mapping_of({"/scan": "header"}, pose=pose_at("/scan", "")),
        r"/scan: no such topic; topics present: /amcl \(geometry_msgs/msg/PoseWithCovarianceStamped\), /cmd_stamped",
    ),
    (
        mapping_of({"/odom": "header"}, pose=pose_at("/odom", "pose.")),
        r"/odom \(nav_msgs/msg/Odometry\) has no 'pose.position.x': geometry_msgs/msg/PoseWithCovariance has pose, cov",
    ),
    (
        mapping_of({"/cmd_vel": "header"}, motor_command=command_at("/cmd_vel")),
        r"/cmd_vel \(geometry_msgs/msg/Twist\) has no header; map time: received",
    ),
    (
        mapping_of(
            {"/imu": "header"}, gyro={"topic": "/imu", "yaw_rate": {"field": "angular_velocity", "unit": "rad/s"}}
        ),
        r"'angular_velocity' is no number but a geometry_msgs/msg/Vector3 of x, y, z",
    ),
    (
        mapping_of({"/imu": "header"}, gyro={"topic": "/imu", "yaw_rate": {"field": "orientation", "unit": "rad/s"}}),
        r"'orientation' is no number but a geometry_msgs/msg/Quaternion of x, y, z, w, yaw",
    ),
    (
        mapping_of(
            {"/imu": "header"}, gyro={"topic": "/imu", "yaw_rate": {"field": "header.frame_id", "unit": "rad/s"}}
        ),
        "'header.frame_id' is a string, no number",
    ),
    (
        mapping_of(
            {"/joint_states": "header"},
            gyro={"topic": "/joint_states", "yaw_rate": {"field": "velocity", "unit": "rad/s"}},
        ),
        r"velocity is an array; choose one of it: velocity\[NAME\]",
    ),
    (
        mapping_of(
            {"/joint_states": "header"},
            gyro={"topic": "/joint_states", "yaw_rate": {"field": "velocity[wheel]", "unit": "rad/s"}},
        ),
        r"/joint_states: no message has all mapped fields: no velocity\[wheel\]; names there are arm, left, right",
    ),
    (
        mapping_of(
            {"/joint_states": "header"},
            gyro={"topic": "/joint_states", "yaw_rate": {"field": "effort[0]", "unit": "rad/s"}},
        ),
        r"no effort\[0\]; effort has 0 elements",
    ),
    (
        mapping_of(
            {"/tf": "header"},
            gyro={"topic": "/tf", "yaw_rate": {"field": "transforms[a>b].transform.rotation.yaw", "unit": "rad/s"}},
        ),
        r"no transforms\[a>b\]; transforms there are map>odom, odom>base",
    ),
    (
        mapping_of(
            {"/tf": "header"},
            gyro={"topic": "/tf", "yaw_rate": {"field": "transforms[base].transform.rotation.yaw", "unit": "rad/s"}},
        ),
        r"choose one of transforms by transforms\[PARENT_FRAME>CHILD_FRAME\]",
    ),
    (
        mapping_of({"/imu": "published"}, gyro=GYRO),
        "/imu: only MCAP files record times of publication; map time: header",
    ),
]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("whole"), "sqlite", drive())


@pytest.mark.parametrize(("mapping", "said"), WRONG)
def test_what_does_not_fit_is_named_with_what_there_is(
    tmp_path: Path, bag: Path, mapping: dict[str, Any], said: str
) -> None:
    with pytest.raises(CommandError, match=said) as error:
        run(tmp_path, mapping, bag)
    assert "\n" not in str(error.value)


def test_a_header_without_a_stamp_is_no_time(tmp_path: Path) -> None:
    sent: list[Sent] = [("/imu", "sensor_msgs/msg/Imu", START + i * STEP, {}) for i in range(3)]
    recording = write_bag(tmp_path, "ros1", sent)
    with pytest.raises(CommandError, match=r"3 x message without a time that is possible; .*map time: received"):
        run(tmp_path, mapping_of({"/imu": "header"}, gyro=GYRO), recording)
    assert len(run(tmp_path, mapping_of({"/imu": "received"}, gyro=GYRO), recording)["GYRO_0"]) == 3


def test_a_quaternion_of_zeros_is_no_pose(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sent = [one for one in drive() if one[0] == "/mocap"]
    sent[3][3]["pose"]["orientation"] = {"w": 0.0}
    recording = write_bag(tmp_path, "mcap", sent)
    poses = run(tmp_path, mapping_of({"/mocap": "header"}, pose=pose_at("/mocap", "pose.")), recording)["POSE_0"]
    assert len(poses) == COUNT - 1
    assert "POSE_0: 1 x row without a number" in capsys.readouterr().out


def test_a_folder_without_a_bag_is_said(tmp_path: Path) -> None:
    (tmp_path / "photos" / "bag").mkdir(parents=True)
    (tmp_path / "photos" / "a.jpg").touch()
    with pytest.raises(
        CommandError, match=r"photos: has no file that ends in .bag, .mcap or .db3; there is a.jpg, bag/"
    ):
        run(tmp_path, WHOLE, tmp_path / "photos")


def test_without_rosbags_it_is_said_what_to_install(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoder.cache_clear()
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(CommandError, match=r"rosbags.* is missing.* install .*\[ros\]'"):
        run(tmp_path, WHOLE, bag)


def test_a_bag_that_is_only_read_is_left_as_it_was(tmp_path: Path, bag: Path) -> None:
    copy = shutil.copytree(bag, tmp_path / "bag")
    before = {path.name: path.read_bytes() for path in copy.iterdir()}
    messages = run(tmp_path, WHOLE, copy)
    assert {path.name: path.read_bytes() for path in copy.iterdir()} == before
    assert parse(messages["PARAMETERS_0"][0].yaml).provenance["log"] == "bag"
    with pytest.raises(CommandError, match="is the recording itself"):
        main([str(tmp_path / "robot.yaml"), str(copy), "--out", str(next(copy.glob("*.db3")))])
