"""Promises of cmr-import about CSV files: without a header, several of one recording, quaternions, values that hold."""

import gzip
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from cmr.cli.errors import CommandError
from cmr.parameters.file import parse
from cmr_tools.importing.block import MappingError
from cmr_tools.importing.mapping import load
from tests.tools.importing.import_bench import CSV_HEAD, NOMINAL, POSE, START, run, write_csv, write_mapping

TIME = CSV_HEAD["time"]
BODY_COMMAND = {"full_scale": 10.0, "v": {"column": "v", "unit": "m/s"}, "omega": {"column": "w", "unit": "rad/s"}}
HEADERLESS = CSV_HEAD | {"columns": ["t", "x", "y", "theta"], "pose": POSE}


def of_poses(heading: dict[str, Any]) -> dict[str, Any]:
    return {"x": {"column": "x", "unit": "m"}, "y": {"column": "y", "unit": "m"}, "theta": heading}


@pytest.mark.parametrize("content", ["0,100,0,0\n0.5,200,0,0\n", "t,x,y,theta\n0,100,0,0\n0.5,200,0,0\n"])
def test_a_file_without_a_header_is_read_by_the_columns_that_the_mapping_names(tmp_path: Path, content: str) -> None:
    poses = run(tmp_path, HEADERLESS, write_csv(tmp_path, content))["POSE_0"]
    assert [(pose.utime - START, pose.x) for pose in poses] == [(0, 1.0), (500_000, 2.0)]


def test_a_file_with_a_header_in_another_order_is_read_by_its_own(tmp_path: Path) -> None:
    poses = run(tmp_path, HEADERLESS, write_csv(tmp_path, "x,t,theta,y\n100,0,0,0\n200,0.5,0,0\n"))["POSE_0"]
    assert [(pose.utime - START, pose.x) for pose in poses] == [(0, 1.0), (500_000, 2.0)]


@pytest.mark.parametrize(
    "content",
    [
        "0;100;0;0\n0.5;200;0;0\n",
        "0\t100\t0\t0\n0.5\t200\t0\t0\n",
        "  0  100 0 0 \n0.5   200 0 0\n",
        "# t x y theta\n0 100 0 0\n0.5 200 0 0\n",
        "# made by hand\n# t, x, y, theta\n0,100,0,0\n0.5,200,0,0\n",
    ],
)
def test_cells_may_be_separated_otherwise_and_a_comment_may_name_the_columns(tmp_path: Path, content: str) -> None:
    poses = run(tmp_path, HEADERLESS, write_csv(tmp_path, content))["POSE_0"]
    assert [(pose.utime - START, pose.x) for pose in poses] == [(0, 1.0), (500_000, 2.0)]


def test_lines_before_the_header_can_be_skipped_and_more_columns_may_follow_those_named(tmp_path: Path) -> None:
    recording = write_csv(tmp_path, "Take,23\n\nt,x,x,x,x\n0,100,0,0,7\n0.5,200,0,0,7\n")
    poses = run(tmp_path, HEADERLESS | {"skip_lines": 3}, recording)["POSE_0"]
    assert [(pose.utime - START, pose.x) for pose in poses] == [(0, 1.0), (500_000, 2.0)]


@pytest.mark.parametrize(
    ("change", "content", "said"),
    [
        (
            {"columns": None},
            "0,1,2,3\n",
            r"no column 't': the first line has numbers, no names\. Name the 4 columns .* columns: \[t, \.\.\.\]",
        ),
        ({}, "0,1,2\n", r"the mapping names 4 columns \(t, x, y, theta\), but the first row has 3 cells"),
        ({"columns": None}, "t,x,x,y,theta\n0,1,2,3,4\n", r"2 columns are called 'x': .* columns.*skip_lines"),
        ({"columns": ["t", "x", "x", "theta"]}, "", r"columns: names 'x' more than once"),
        ({"columns": "t x"}, "", r"columns: must be a list of names, not 't x'"),
        ({"columns": ["t", "x", "theta"]}, "", r"pose: y: column: is 'y'; the file has t, x, theta"),
        ({"columns": ["x", "y", "theta"]}, "", r"time: column: is 't'; columns names x, y, theta"),
        ({"skip_lines": -1}, "", r"skip_lines: must be a whole number, 0 or more, not -1"),
        ({"time": TIME | {"unit": "min"}}, "", r"time: unit: is 'min'; allowed are s, ms, us, ns"),
    ],
)
def test_what_is_wrong_with_the_columns_is_said(
    tmp_path: Path, change: dict[str, Any], content: str, said: str
) -> None:
    with pytest.raises(CommandError, match=said):
        run(tmp_path, HEADERLESS | change, write_csv(tmp_path, content))


@pytest.mark.parametrize(("unit", "second"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_times_may_count_from_the_epoch_in_other_units(tmp_path: Path, unit: str, second: int) -> None:
    begin = START * second // 10**6
    mapping = HEADERLESS | {"time": {"column": "t", "start": "1970-01-01T00:00:00Z", "unit": unit}}
    recording = write_csv(tmp_path, f"{begin},1,0,0\n{begin + second // 2},2,0,0\n")
    poses = run(tmp_path, mapping, recording)["POSE_0"]
    assert [pose.utime - START for pose in poses] == pytest.approx([0, 500_000], abs=1)


ANGLES = [0.0, 0.5, 2.0, 3.1, -3.1, -1.0]


@pytest.mark.parametrize("members", ["wz", "wxyz"])
@pytest.mark.parametrize("length", [1.0, 3.0])
def test_a_heading_may_be_a_quaternion(tmp_path: Path, members: str, length: float) -> None:
    heading = {"quaternion": {member: f"q{member}" for member in members}, "offset": 0.25, "sign": -1}
    rows = [
        f"{k / 10},0,0,{length * math.cos(angle / 2)},0,0,{length * math.sin(angle / 2)}\n"
        for k, angle in enumerate(ANGLES)
    ]
    recording = write_csv(tmp_path, "t,x,y,qw,qx,qy,qz\n" + "".join(rows))
    poses = run(tmp_path, CSV_HEAD | {"pose": of_poses(heading)}, recording)["POSE_0"]
    assert [pose.theta for pose in poses] == pytest.approx([-(angle + 0.25) for angle in ANGLES])


def test_the_heading_of_a_tilted_robot_is_that_of_its_forward_axis(tmp_path: Path) -> None:
    # Turned by 0.7 rad about z, then by 0.2 rad about its own y axis: q = qz qy.
    cz, sz, cy, sy = math.cos(0.35), math.sin(0.35), math.cos(0.1), math.sin(0.1)
    heading = {"quaternion": {member: f"q{member}" for member in "wxyz"}}
    recording = write_csv(tmp_path, f"t,x,y,qw,qx,qy,qz\n0,0,0,{cz * cy},{-sz * sy},{cz * sy},{sz * cy}\n")
    (pose,) = run(tmp_path, CSV_HEAD | {"pose": of_poses(heading)}, recording)["POSE_0"]
    assert pose.theta == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("heading", "said"),
    [
        ({"quaternion": {"w": "qw", "x": "qx", "z": "qz"}}, "quaternion: y: must be a text, not None"),
        ({"quaternion": {"x": "qx", "y": "qy", "z": "qz"}}, "quaternion: w: must be a text, not None"),
        ({"quaternion": {"w": "a", "z": "b", "yaw": "c"}}, "quaternion: yaw: unknown key; allowed are"),
        ({"quaternion": {"w": "a", "z": "b"}, "unit": "deg"}, "theta: unit: is 'deg'; allowed are rad"),
    ],
)
def test_what_is_wrong_with_a_quaternion_is_said(tmp_path: Path, heading: dict[str, Any], said: str) -> None:
    with pytest.raises(MappingError, match=said):
        load(write_mapping(tmp_path, CSV_HEAD | {"pose": of_poses(heading)}))


def test_the_speed_of_the_body_may_be_the_feedback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = {"v": {"column": "v", "unit": "m/s"}, "omega": {"column": "w", "unit": "deg/s", "sign": -1}}
    recording = write_csv(tmp_path, "t,v,w\n0,0.5,0\n1,0.5,0\n2,0,-90\n")
    feedback = run(tmp_path, CSV_HEAD | {"motor_feedback": body}, recording)["MOTOR_FEEDBACK_0"]
    turn = math.radians(90) * NOMINAL["base_width"] / 2 / NOMINAL["wheel_radius"]
    assert [message.psi_left for message in feedback] == pytest.approx([10.0, 10.0, -turn])
    assert [message.psi_right for message in feedback] == pytest.approx([10.0, 10.0, turn])
    assert feedback[1].ticks_left / 65536 * 2 * math.pi == pytest.approx(10.0, abs=1e-3)
    assert "follow from v and omega by wheel_radius 0.05 m and base_width 0.2 m" in capsys.readouterr().out


def test_odometry_is_the_mean_since_the_row_before(tmp_path: Path) -> None:
    """A base that counts 0, 1, 3 and 3 m at 0, 1, 2 and 3 s publishes 0, 1, 2 and 0 m/s."""
    body = {"v": {"column": "v", "unit": "m/s"}, "omega": {"column": "w", "unit": "rad/s"}}
    recording = write_csv(tmp_path, "t,v,w\n0,0,0\n1,1,0\n2,2,0\n3,0,0\n")
    feedback = run(tmp_path, CSV_HEAD | {"motor_feedback": body}, recording)["MOTOR_FEEDBACK_0"]
    ways = [message.ticks_left / 65536 * 2 * math.pi * NOMINAL["wheel_radius"] for message in feedback]
    assert ways == pytest.approx([0.0, 1.0, 3.0, 3.0], abs=1e-4)


@pytest.mark.parametrize(
    ("feedback", "said"),
    [
        ({"v": {"column": "v", "unit": "m/s"}}, "or the body's v and omega"),
        (
            {"v": {"column": "v", "unit": "m/s"}}
            | {f"ticks_{side}": {"column": side, "unit": "ticks"} for side in ("left", "right")}
            | {"ticks_per_turn": 100},
            "v and omega are needed together",
        ),
        (
            {"v": {"column": "v", "unit": "m/s"}, "omega": {"column": "w", "unit": "rad/s"}}
            | {f"psi_{side}": {"column": side, "unit": "rad/s"} for side in ("left", "right")},
            "map psi_left and psi_right, or v and omega, not both",
        ),
    ],
)
def test_half_of_the_bodys_speed_or_two_kinds_of_speed_are_refused(
    tmp_path: Path, feedback: dict[str, Any], said: str
) -> None:
    with pytest.raises(MappingError, match=said):
        load(write_mapping(tmp_path, CSV_HEAD | {"motor_feedback": feedback}))


def test_a_parameter_file_may_give_the_nominal_parameters(tmp_path: Path) -> None:
    body = {"v": {"column": "v", "unit": "m/s"}, "omega": {"column": "w", "unit": "rad/s"}}
    parameters = tmp_path / "robot_0.yaml"
    parameters.write_text(
        "schema: 1\nrobot_id: 0\nwritten: 2026-01-31T12:00:00Z\nparameters:\n"
        "  wheel_radius: {value: 0.1, unit: m}\n  base_width: {value: 0.4, unit: m}\n"
    )
    recording = write_csv(tmp_path, "t,v,w\n0,0.5,1\n1,0.5,1\n")
    for nominal in (NOMINAL, None):
        mapping = CSV_HEAD | {"motor_feedback": body, "nominal": nominal}
        messages = run(tmp_path, mapping, recording, "--parameters", str(parameters))
        assert messages["MOTOR_FEEDBACK_0"][0].psi_right == pytest.approx((0.5 + 1 * 0.4 / 2) / 0.1)
        assert parse(messages["PARAMETERS_0"][0].yaml).value("base_width") == 0.4


def test_commands_that_hold_are_in_force_until_the_next_and_to_the_end(tmp_path: Path) -> None:
    mapping = CSV_HEAD | {"motor_command": BODY_COMMAND | {"holds": True}, "pose": of_poses(POSE["theta"])}
    rows = "0,,,0,0,0\n0.2,0.5,0,,,\n1.3,0.25,0,,,\n2,,,1,0,0\n"
    messages = run(tmp_path, mapping, write_csv(tmp_path, "t,v,w,x,y,theta\n" + rows))
    commands = messages["MOTOR_COMMAND_0"]
    times = [(message.utime - START) / 1e6 for message in commands]
    assert (times[0], times[-1]) == (0.2, 2.0)
    assert max(later - earlier for earlier, later in pairwise(times)) == pytest.approx(0.05)
    assert [message.left for message in commands] == [1.0 if time < 1.3 else 0.5 for time in times]
    assert len(messages["POSE_0"]) == 2


def test_commands_that_hold_end_with_their_piece(tmp_path: Path) -> None:
    mapping = CSV_HEAD | {
        "segment": {"column": "window", "gap": 5.0},
        "motor_command": BODY_COMMAND | {"holds": True},
        "pose": of_poses(POSE["theta"]),
    }
    rows = "a,0,0.5,0,0,0,0\na,1,,,0,0,0\nb,0,,,0,0,0\nb,1,,,0,0,0\n"
    commands = run(tmp_path, mapping, write_csv(tmp_path, "window,t,v,w,x,y,theta\n" + rows))["MOTOR_COMMAND_0"]
    assert (commands[0].utime - START, commands[-1].utime - START) == (0, 1_000_000)


def test_a_command_that_would_hold_for_years_is_a_damaged_time(tmp_path: Path) -> None:
    mapping = CSV_HEAD | {"motor_command": BODY_COMMAND | {"holds": True}}
    with pytest.raises(CommandError, match=r"holds: a command would hold for 4e\+09 s: a time is damaged"):
        run(tmp_path, mapping, write_csv(tmp_path, "t,v,w\n0,0,0\n4e9,0,0\n"))


FILES: dict[str, Any] = {
    "files": {
        "*_wheels.csv": {"time": TIME, "columns": ["t", "left", "right"]},
        "*_poses.csv": {"time": TIME | {"unit": "ms"}},
        "battery.csv": {"time": TIME},
    },
    "motor_feedback": {
        "file": "*_wheels.csv",
        "ticks_per_turn": 100,
        "ticks_left": {"column": "left", "unit": "ticks"},
        "ticks_right": {"column": "right", "unit": "ticks"},
        "battery_voltage": {"file": "battery.csv", "column": "volts", "unit": "V", "holds": True},
    },
    "pose": {
        "file": "*_poses.csv",
        "x": {"column": "x", "unit": "m"},
        "y": {"column": "y", "unit": "m"},
        "theta": {"column": "theta", "unit": "deg"},
    },
}
SEVERAL: dict[str, Any] = {key: value for key, value in CSV_HEAD.items() if key != "time"} | FILES


def several_files(folder: Path, name: str = "one") -> Path:
    folder.mkdir(exist_ok=True)
    write_csv(folder, "".join(f"{k / 10},{k},{2 * k}\n" for k in range(11)), f"{name}_wheels.csv")
    poses = gzip.compress(b"t,x,y,theta\n0,0,0,170\n333,1,0,180\n667,2,0,-170\n")
    (folder / f"{name}_poses.csv.gz").write_bytes(poses)
    write_csv(folder, "t,volts\n0,12\n0.55,11\n", "battery.csv")
    return folder


@pytest.mark.parametrize("named", ["", "one_wheels.csv", "one_poses.csv.gz", "battery.csv"])
def test_several_files_of_different_rates_make_one_recording(tmp_path: Path, named: str) -> None:
    messages = run(tmp_path, SEVERAL, several_files(tmp_path / "recording") / named)
    assert [message.utime - START for message in messages["POSE_0"]] == [0, 333_000, 667_000]
    feedback = messages["MOTOR_FEEDBACK_0"]
    assert [message.ticks_right for message in feedback] == list(range(2, 22, 2))
    assert [message.battery_voltage for message in feedback] == [12.0] * 5 + [11.0] * 5


def test_a_heading_from_another_file_turns_through_180_degrees(tmp_path: Path) -> None:
    mapping = SEVERAL | {
        "pose": {
            "file": "*_wheels.csv",
            "x": {"column": "left", "unit": "m"},
            "y": {"column": "right", "unit": "m"},
            "theta": {"file": "*_poses.csv", "column": "theta", "unit": "deg"},
        }
    }
    poses = run(tmp_path, mapping, several_files(tmp_path / "recording"))["POSE_0"]
    expected = [math.radians(170 + 10 * k / 3.33) for k in range(4)]
    assert [pose.theta for pose in poses][:4] == pytest.approx(expected)
    assert len(poses) == 7, "after the last heading nothing tells it"


def test_pieces_are_the_same_in_all_files(tmp_path: Path) -> None:
    recording = tmp_path / "recording"
    recording.mkdir()
    files: dict[str, Any] = {name: {"time": TIME} for name in ("wheels.csv", "poses.csv")}
    mapping = SEVERAL | {
        "files": files,
        "segment": {"column": "run", "gap": 5.0},
        "motor_feedback": {
            "file": "wheels.csv",
            **{f"psi_{side}": {"column": side, "unit": "rad/s"} for side in ("left", "right")},
        },
        "pose": SEVERAL["pose"] | {"file": "poses.csv"},
    }
    write_csv(recording, "run,t,left,right\na,10,1,1\na,11,1,1\nb,3,2,2\nb,4,2,2\n", "wheels.csv")
    write_csv(recording, "run,t,x,y,theta\na,9.5,0,0,0\na,10.5,1,0,0\nb,3.5,2,0,0\nb,4.5,3,0,0\n", "poses.csv")
    messages = run(tmp_path, mapping, recording)
    times = {name: [(one.utime - START) / 1e6 for one in messages[f"{name}_0"]] for name in ("MOTOR_FEEDBACK", "POSE")}
    assert times == {"MOTOR_FEEDBACK": [0.5, 1.5, 6.5, 7.5], "POSE": [0.0, 1.0, 7.0, 8.0]}
    pieces = parse(messages["PARAMETERS_0"][0].yaml).provenance["pieces"]
    assert pieces == [[START, "a", 9.5], [START + 6_500_000, "b", 3.0]]


def test_which_file_is_missing_or_not_to_be_told_is_said(tmp_path: Path) -> None:
    recording = several_files(tmp_path / "recording")
    several_files(recording, "two")
    with pytest.raises(
        CommandError, match=r"several files \*_poses\.csv: one_poses\.csv\.gz, two_poses\.csv\.gz\. Name one"
    ):
        run(tmp_path, SEVERAL, recording)
    (recording / "two_poses.csv.gz").unlink()
    with pytest.raises(CommandError, match=r"no file two_poses\.csv; there is battery\.csv, one_poses\.csv\.gz"):
        run(tmp_path, SEVERAL, recording / "two_wheels.csv")
    with pytest.raises(CommandError, match="absent: no such file or folder"):
        run(tmp_path, SEVERAL, tmp_path / "absent")
    with pytest.raises(CommandError, match=r"called like none of the files of the mapping: \*_poses\.csv, \*_wheels"):
        run(tmp_path, SEVERAL, write_csv(recording, "", "other.csv"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"files": {}}, "files: names no file"),
        ({"files": FILES["files"] | {"*a*.csv": {"time": TIME}}}, "must be the name of a file; one \\* in it"),
        ({"files": FILES["files"] | {"more.csv": {"time": TIME}}}, "files: more.csv: no signal is on it; leave it out"),
        ({"pose": FILES["pose"] | {"file": "poses.csv"}}, r"pose: file: is 'poses.csv'; allowed are \*_poses.csv"),
        ({"time": TIME}, "time: unknown key; allowed are about, format, files, segment"),
    ],
)
def test_what_is_wrong_with_the_files_is_said(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    with pytest.raises(MappingError, match=said):
        load(write_mapping(tmp_path, SEVERAL | change))
