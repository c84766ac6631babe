"""Promises of the mapping file: what is wrong in it is named, with file, key and what is allowed."""

import copy
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from cmr_tools.importing.block import MappingError
from cmr_tools.importing.import_log import main
from cmr_tools.importing.mapping import SHIPPED, load, shipped


@pytest.mark.parametrize("name", [name for name in shipped() if name != "cmr_mcap"])
def test_shipped_mappings_load_by_name_and_say_where_their_data_comes_from(name: str) -> None:
    mapping = load(name)
    assert mapping.name == name
    assert {"wheel_radius", "base_width"} <= set(mapping.nominal)
    motors = [{"k2_over_k3", "k1"}, {"response_time", "top_wheel_speed"}]
    assert (mapping.command is not None) == any(names <= set(mapping.nominal) for names in motors)
    header = (SHIPPED / f"{name}.yaml").read_text().split("about:")[0]
    assert "github.com/" in header
    assert "licence" in header


def test_the_list_shows_a_line_for_each_shipped_mapping(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == shipped() == sorted(shipped())


BODY_SPEEDS = {
    "channel": "MBOT_WHEEL_CTRL",
    "v": {"field": "left_wanted", "unit": "m/s"},
    "omega": {"field": "right_wanted", "unit": "rad/s"},
}
BROKEN: list[tuple[str, list[str], Any, str]] = [
    ("mbot", ["format"], "rosbag", "mbot.yaml: line 13: format: is 'rosbag'; allowed are lcm_log, csv, ros_bag"),
    ("mbot", ["poses"], {}, "mbot.yaml: line 49: poses: unknown key; allowed are about, format, channels, nominal"),
    (
        "mbot",
        ["gyro", "yaw_rate", "unit"],
        "rpm",
        "mbot.yaml: line 18: gyro: yaw_rate: unit: is 'rpm'; allowed are rad/s, deg/s",
    ),
    ("mbot", ["gyro", "yaw_rate", "sign"], 2, "gyro: yaw_rate: sign: must be 1 or -1, not 2"),
    ("mbot", ["gyro", "yaw_rate", "scale"], "big", "gyro: yaw_rate: scale: must be a number, not 'big'"),
    ("mbot", ["gyro", "yaw_rate", "field"], "gyro", "yaw_rate: field: is 'gyro'; MBOT_IMU has utime, gyro[0], gyro[1]"),
    (
        "mbot",
        ["gyro", "yaw_rate", "factor"],
        2,
        "gyro: yaw_rate: factor: unknown key; allowed are channel, field, unit",
    ),
    ("mbot", ["gyro", "channel"], "IMU", "gyro: channel: is 'IMU'; allowed are MBOT_ENCODERS, MBOT_IMU"),
    ("mbot", ["channels", "MBOT_IMU", "time"], "now", "MBOT_IMU: time: is 'now'; allowed are utime, event_time"),
    ("mbot", ["channels", "MBOT_IMU", "layout"], "string s;", "MBOT_IMU: layout: 'string s' is not a type and a name"),
    ("mbot", ["channels", "MBOT_IMU", "layout"], "int64_t t;", "MBOT_IMU: time: utime needs a member utime"),
    ("mbot", ["nominal"], {"wheel_radius": 0.1}, "nominal: base_width: is missing"),
    ("mbot", ["nominal", "mass"], 1.0, "nominal: parameters: unknown name 'mass'; known are"),
    ("mbot", ["motor_feedback", "psi_left"], None, "motor_feedback: psi_left and psi_right are needed together"),
    ("mbot", ["motor_feedback", "ticks_per_turn"], 0, "ticks_per_turn: must be greater than 0"),
    ("husky_tile", ["segment", "gap"], -1, "segment: gap: must be greater than 0"),
    ("husky_tile", ["time", "start"], "noon", "time: start: must be a time such as"),
    ("husky_tile", ["time"], None, "time: must be a block of keys"),
    ("husky_tile", ["pose", "only_changes"], 3, "pose: only_changes: must be true (of the pose) or a column's name"),
    ("mbot", ["motor_command", "left", "unit"], "rad/s", "motor_command: left: unit: is 'rad/s'; allowed are duty"),
    ("mbot", ["motor_command"], BODY_SPEEDS, "motor_command: full_scale: is missing"),
    (
        "jackal",
        ["topics", "/imu/data", "time"],
        "utime",
        "/imu/data: time: is 'utime'; allowed are header, received, pub",
    ),
    ("jackal", ["topics", "/imu/data", "definition"], 3, "topics: /imu/data: definition: must be a text, not 3"),
    ("jackal", ["topics", "/odom"], {"time": "header"}, "topics: /odom: no signal is on it; leave it out"),
    ("jackal", ["topics"], {}, "topics: names no topic"),
    (
        "jackal",
        ["gyro", "topic"],
        "/imu",
        "gyro: topic: is '/imu'; allowed are /imu/data, /jackal_velocity_controller",
    ),
    (
        "jackal",
        ["gyro", "yaw_rate", "field"],
        "a..b",
        "yaw_rate: field: is 'a..b', which is no path such as twist.linear.x",
    ),
    ("jackal", ["gyro", "yaw_rate", "field"], "a[b", "yaw_rate: field: is 'a[b', which is no path"),
    ("jackal", ["gyro", "yaw_rate", "column"], "a", "yaw_rate: column: unknown key; allowed are topic, field, unit"),
    (
        "jackal",
        ["motor_feedback", "ticks_left", "unit"],
        "turns",
        "unit: is 'turns'; allowed are ticks, ticks/row, rad, deg",
    ),
]


@pytest.mark.parametrize(("name", "keys", "value", "said"), BROKEN)
def test_a_wrong_key_is_named_with_what_is_allowed(
    tmp_path: Path, name: str, keys: list[str], value: Any, said: str
) -> None:
    content = copy.deepcopy(yaml.safe_load((SHIPPED / f"{name}.yaml").read_text()))
    block = content
    for key in keys[:-1]:
        block = block[key]
    block[keys[-1]] = value
    path = tmp_path / f"{name}.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(MappingError, match=re.escape(said)):
        load(str(path))


def test_an_unknown_mapping_is_answered_with_the_shipped_ones() -> None:
    with pytest.raises(
        MappingError, match="shipped mappings are cmr_mcap, husky_tile, husky_wet_grass, jackal, maebot"
    ):
        load("turtlebot")


@pytest.mark.parametrize("text", ["a: [", "- list", "", "\x00"])
def test_a_file_that_is_no_mapping_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    with pytest.raises(MappingError, match=r"robot\.yaml: "):
        load(str(path))


@pytest.mark.parametrize("arguments", [[], ["mbot"], ["mbot", "x.log"], ["mbot", "x", "--out", "y", "--robot", "-1"]])
def test_wrong_usage_ends_with_exit_code_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2


def test_the_command_reports_a_failure_in_one_line_with_exit_code_1(tmp_path: Path) -> None:
    command: list[str | Path] = [
        Path(sys.executable).parent / "cmr-import",
        "mbot",
        tmp_path / "none.log",
        "--out",
        tmp_path / "run.lcm",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "none.log: No such file" in done.stderr
