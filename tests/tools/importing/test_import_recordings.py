"""Promises of cmr-import, on recordings made here: what goes in comes out, in our units, at the right time."""

import gzip
import math
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import lcm
import pytest

from cmr.cli.errors import CommandError
from cmr.parameters.file import parse
from cmr_tools.importing.import_log import main
from tests.tools.importing.import_bench import CSV_HEAD, NOMINAL, POSE, START, run, write_csv, write_mapping

FINGERPRINT = b"anything"


def write_foreign_log(folder: Path, events: list[tuple[int, str, bytes]]) -> Path:
    path = folder / "foreign.log"
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for timestamp, channel, data in events:
        log.write_event(timestamp, channel, data)
    log.close()
    return path


def encoders(utime: int, left: int, right: int) -> bytes:
    return FINGERPRINT + struct.pack(">qii", utime, left, right)


def encoder_mapping(clock: str = "utime", **more: Any) -> dict[str, Any]:
    return {
        "about": "made in a test",
        "format": "lcm_log",
        "channels": {"ENCODERS": {"layout": "int64_t utime; int32_t left, right;", "time": clock}},
        "nominal": NOMINAL,
        "motor_feedback": {
            "channel": "ENCODERS",
            "ticks_per_turn": 100,
            "ticks_left": {"field": "left", "unit": "ticks"},
            "ticks_right": {"field": "right", "unit": "ticks", "sign": -1},
        },
        **more,
    }


def test_units_signs_scale_and_offset_turn_into_ours(tmp_path: Path) -> None:
    recording = write_csv(tmp_path, "t,x,y,theta\n0,100,1,0\n0.5,150,2,40\n")
    poses = run(tmp_path, CSV_HEAD | {"pose": POSE}, recording, "--robot", "7")["POSE_7"]
    assert [pose.utime for pose in poses] == [START, START + 500_000]
    assert [pose.robot_id for pose in poses] == [7, 7]
    assert [pose.x for pose in poses] == pytest.approx([1.0, 1.5])
    assert [pose.y for pose in poses] == pytest.approx([-1.0, -2.0])
    assert [pose.theta for pose in poses] == pytest.approx([math.radians(10), math.radians(90)])


def test_ticks_count_from_the_first_sample_and_speed_is_over_measured_time(tmp_path: Path) -> None:
    samples = [(0, 1000, -7), (20_000, 1010, -8), (70_000, 1060, 12)]
    recording = write_foreign_log(
        tmp_path, [(1_000_000 + t, "ENCODERS", encoders(t + 5, *ticks)) for t, *ticks in samples]
    )
    feedback = run(tmp_path, encoder_mapping(), recording)["MOTOR_FEEDBACK_0"]
    assert [message.utime for message in feedback] == [20_005, 70_005]
    assert [message.received_utime for message in feedback] == [1_020_000, 1_070_000]
    assert [(message.ticks_left, message.ticks_right) for message in feedback] == [(10, 1), (60, -19)]
    assert feedback[0].psi_left == pytest.approx(10 / 100 * 2 * math.pi / 0.020)
    assert feedback[1].psi_right == pytest.approx(-20 / 100 * 2 * math.pi / 0.050)


def test_what_was_not_recorded_stays_unknown(tmp_path: Path) -> None:
    recording = write_foreign_log(tmp_path, [(t, "ENCODERS", encoders(t, 0, 0)) for t in (1000, 2000)])
    (message,) = run(tmp_path, encoder_mapping(), recording)["MOTOR_FEEDBACK_0"]
    unknown = ("applied_left", "applied_right", "current_left", "current_right", "battery_voltage", "temperature")
    assert all(math.isnan(getattr(message, name)) for name in unknown)


def test_a_counter_of_32_bits_may_wrap_around(tmp_path: Path) -> None:
    samples = [(1000, 2**31 - 3), (2000, -(2**31) + 4)]
    recording = write_foreign_log(tmp_path, [(t, "ENCODERS", encoders(t, ticks, 0)) for t, ticks in samples])
    assert run(tmp_path, encoder_mapping(), recording)["MOTOR_FEEDBACK_0"][0].ticks_left == 7


def test_a_broken_utime_is_refused_and_the_event_time_takes_its_place(tmp_path: Path) -> None:
    recording = write_foreign_log(tmp_path, [(t, "ENCODERS", encoders(42, 0, 0)) for t in (1000, 2000, 3000)])
    with pytest.raises(CommandError, match=r"ENCODERS stands still.*event_time"):
        run(tmp_path, encoder_mapping(), recording)
    feedback = run(tmp_path, encoder_mapping("event_time"), recording)["MOTOR_FEEDBACK_0"]
    assert [message.utime for message in feedback] == [2000, 3000]


def test_a_clock_set_wrong_is_shifted_as_a_whole_by_the_smallest_delay(tmp_path: Path) -> None:
    mapping = encoder_mapping("shifted_utime", gyro={"channel": "GYRO", "yaw_rate": {"field": "w", "unit": "rad/s"}})
    mapping["channels"]["GYRO"] = {"layout": "int64_t utime; double w;", "time": "shifted_utime"}
    stamped = [(100, 50), (200, 3), (300, 90)]  # utime and delay; the smallest over both channels is 2
    events = [(9_000_000 + utime + delay, "ENCODERS", encoders(utime, 0, 0)) for utime, delay in stamped]
    events += [(9_000_000 + 150 + 2, "GYRO", FINGERPRINT + struct.pack(">qd", 150, 0.5))]
    messages = run(tmp_path, mapping, write_foreign_log(tmp_path, events))
    assert [message.utime for message in messages["MOTOR_FEEDBACK_0"]] == [9_000_202, 9_000_302]
    assert [message.utime for message in messages["GYRO_0"]] == [9_000_152]


def test_speeds_recorded_on_another_channel_are_taken_at_the_encoders_times(tmp_path: Path) -> None:
    mapping = encoder_mapping()
    mapping["channels"]["SPEEDS"] = {"layout": "int64_t utime; float v[2];", "time": "utime"}
    for index, side in enumerate(("left", "right")):
        mapping["motor_feedback"][f"psi_{side}"] = {"channel": "SPEEDS", "field": f"v[{index}]", "unit": "m/s"}
    events = [(t, "ENCODERS", encoders(t, 0, 0)) for t in (1000, 1500, 2000)]
    events += [(t, "SPEEDS", FINGERPRINT + struct.pack(">qff", t, v, -v)) for t, v in ((1000, 0.5), (2000, 1.0))]
    feedback = run(tmp_path, mapping, write_foreign_log(tmp_path, events))["MOTOR_FEEDBACK_0"]
    assert [message.psi_left for message in feedback] == pytest.approx([10.0, 15.0, 20.0])
    assert [message.psi_right for message in feedback] == pytest.approx([-10.0, -15.0, -20.0])


def test_messages_of_another_length_are_counted_and_skipped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    events = [(t, "ENCODERS", encoders(t, 0, 0)) for t in (1000, 2000)] + [(3000, "ENCODERS", b"short")]
    assert len(run(tmp_path, encoder_mapping(), write_foreign_log(tmp_path, events))["MOTOR_FEEDBACK_0"]) == 1
    assert "skipped, ENCODERS: 1 x message of another length" in capsys.readouterr().out


def test_a_truncated_log_gives_its_intact_events_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = write_foreign_log(tmp_path, [(t, "ENCODERS", encoders(t, 0, 0)) for t in (1000, 2000, 3000)])
    run(tmp_path, encoder_mapping(), recording)
    assert "truncated or damaged" not in capsys.readouterr().out
    recording.write_bytes(recording.read_bytes()[:-5])
    assert len(run(tmp_path, encoder_mapping(), recording)["MOTOR_FEEDBACK_0"]) == 1
    assert "truncated or damaged" in capsys.readouterr().out


def test_damage_inside_a_log_costs_only_the_damaged_events(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    events = [(t, "ENCODERS", encoders(t, 0, 0)) for t in (1000, 2000, 3000, 4000, 5000, 6000, -5)]
    content = bytearray(write_foreign_log(tmp_path, events).read_bytes())
    event_bytes = len(content) // len(events)
    content[event_bytes + 28] = 0xFF  # the second event's channel name, behind a header of 28 bytes
    content[3 * event_bytes] ^= 0xFF  # the fourth event's sync word
    recording = tmp_path / "foreign.log"
    recording.write_bytes(content)
    feedback = run(tmp_path, encoder_mapping(), recording)["MOTOR_FEEDBACK_0"]
    assert [message.utime for message in feedback] == [3000, 5000, 6000]
    said = capsys.readouterr().out
    assert "truncated or damaged" in said
    assert "ENCODERS: 1 x message of an impossible time" in said


def test_a_truncated_gzip_gives_its_intact_rows_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"{i / 20},{i * 7919 % 1009},{i * i % 997},{i}\n" for i in range(20_000))
    recording = tmp_path / "recording.csv.gz"
    recording.write_bytes(gzip.compress(("t,x,y,theta\n" + rows).encode())[:-1000])
    assert 1000 < len(run(tmp_path, CSV_HEAD | {"pose": POSE}, recording)["POSE_0"]) < 20_000
    assert "truncated or damaged" in capsys.readouterr().out


def test_a_missing_column_is_named_with_those_present(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="no column 'theta'; columns present: t, x, y"):
        run(tmp_path, CSV_HEAD | {"pose": POSE}, write_csv(tmp_path, "t,x,y\n0,0,0\n"))


def test_of_a_file_that_is_no_csv_nothing_is_shown(tmp_path: Path) -> None:
    recording = tmp_path / "data.csv"
    recording.write_bytes(bytes(range(14, 256)))
    with pytest.raises(CommandError, match=r"columns present: none that can be read; is it a CSV file\?"):
        run(tmp_path, CSV_HEAD | {"pose": POSE}, recording)


def test_a_missing_channel_is_named_with_those_present(tmp_path: Path) -> None:
    recording = write_foreign_log(tmp_path, [(1000, "LASER", b"")])
    with pytest.raises(CommandError, match="ENCODERS: no such channel; channels present: LASER"):
        run(tmp_path, encoder_mapping(), recording)


def test_rows_with_cells_that_hold_no_number_are_skipped_for_that_signal_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapping = CSV_HEAD | {"pose": POSE, "gyro": {"yaw_rate": {"column": "w", "unit": "deg/s"}}}
    recording = write_csv(
        tmp_path, "t,x,y,theta,w\n0,0,,0,1\n0.1,nan,0,0,2\n0.2,1,1,1,\n0.3,1,1,1,3\n,1,1,1,1\n0.4,1\n"
    )
    messages = run(tmp_path, mapping, recording)
    assert [message.utime - START for message in messages["POSE_0"]] == [200_000, 300_000]
    assert [message.yaw_rate for message in messages["GYRO_0"]] == pytest.approx([math.radians(w) for w in (1, 2, 3)])
    said = capsys.readouterr().out
    assert "POSE_0: 2 x row without a number" in said
    assert "GYRO_0: 1 x row without a number" in said
    assert "the file: 1 x row without a time in t" in said
    assert "the file: 1 x row with another number of cells" in said


def test_segments_follow_each_other_with_the_gap(tmp_path: Path) -> None:
    mapping = CSV_HEAD | {"segment": {"column": "window", "gap": 5.0}, "pose": POSE}
    rows = "0,0.0,0,0,0\n0,0.2,3,0,0\n1,0.5,4,0,0\n1,0.7,3,0,1\n"
    poses = run(tmp_path, mapping, write_csv(tmp_path, "window,t,x,y,theta\n" + rows))["POSE_0"]
    assert [pose.utime - START for pose in poses] == [0, 200_000, 5_200_000, 5_400_000]


def test_poses_may_be_taken_where_a_counter_changes(tmp_path: Path) -> None:
    mapping = CSV_HEAD | {"pose": POSE | {"only_changes": "index", "first_of_piece": "kept"}}
    recording = write_csv(tmp_path, "t,index,x,y,theta\n0,1,0,0,0\n0.1,1,0,0,0\n0.2,2,0,0,0\n")
    assert [pose.utime - START for pose in run(tmp_path, mapping, recording)["POSE_0"]] == [0, 200_000]


def test_ticks_that_were_not_recorded_are_the_integral_of_the_speeds_within_segments(tmp_path: Path) -> None:
    speed = {f"psi_{side}": {"column": f"v_{side}", "unit": "rpm"} for side in ("left", "right")}
    mapping = CSV_HEAD | {
        "segment": {"column": "window", "gap": 5.0},
        "motor_feedback": speed | {"ticks_per_turn": 65536},
    }
    rows = "0,0,60,-60\n0,1,60,-60\n1,0,60,-120\n1,0.5,60,-120\n"
    feedback = run(tmp_path, mapping, write_csv(tmp_path, "window,t,v_left,v_right\n" + rows))["MOTOR_FEEDBACK_0"]
    assert [message.ticks_left / 65536 for message in feedback] == [0, 1, 1, 1.5]
    assert [message.ticks_right / 65536 for message in feedback] == [0, -1, -1, -2]
    assert feedback[0].psi_left == pytest.approx(2 * math.pi)


def test_ticks_of_each_row_are_added_up_from_the_second_on(tmp_path: Path) -> None:
    ticks = {f"ticks_{side}": {"column": side, "unit": "ticks/row"} for side in ("left", "right")}
    mapping = CSV_HEAD | {"motor_feedback": ticks | {"ticks_per_turn": 100}}
    recording = write_csv(tmp_path, "t,left,right\n0,9,9\n0.05,5,-5\n0.1,10,0\n")
    feedback = run(tmp_path, mapping, recording)["MOTOR_FEEDBACK_0"]
    assert [(message.ticks_left, message.ticks_right) for message in feedback] == [(5, -5), (15, -5)]
    assert feedback[1].psi_left == pytest.approx(10 / 100 * 2 * math.pi / 0.05)


def test_commands_of_the_body_become_duties_by_geometry_and_full_scale(tmp_path: Path) -> None:
    command = {
        "full_scale": 10.0,
        "v": {"column": "v", "unit": "m/s"},
        "omega": {"column": "w", "unit": "rad/s"},
    }
    recording = write_csv(tmp_path, "t,v,w\n0,0.25,0\n0.1,0,1\n")
    commands = run(tmp_path, CSV_HEAD | {"motor_command": command}, recording)["MOTOR_COMMAND_0"]
    assert [message.left for message in commands] == pytest.approx([0.5, -0.2])
    assert [message.right for message in commands] == pytest.approx([0.5, 0.2])


def test_a_command_beyond_full_drive_is_an_error_not_a_clipped_value(tmp_path: Path) -> None:
    command = {"left": {"column": "l", "unit": "duty"}, "right": {"column": "r", "unit": "duty"}}
    with pytest.raises(CommandError, match=r"largest drive is 1\.5 of full drive"):
        run(tmp_path, CSV_HEAD | {"motor_command": command}, write_csv(tmp_path, "t,l,r\n0,0,-1.5\n"))


def test_the_log_begins_with_the_nominal_parameters(tmp_path: Path) -> None:
    recording = write_csv(tmp_path, "t,x,y,theta\n0,0,0,0\n")
    messages = run(tmp_path, CSV_HEAD | {"pose": POSE}, recording, "--robot", "3")
    assert next(iter(messages)) == "PARAMETERS_3"
    (message,) = messages["PARAMETERS_3"]
    assert message.utime == message.sequence == START
    assert {name: value.value for name, value in parse(message.yaml).values.items()} == NOMINAL
    assert parse(message.yaml).provenance["log"] == "recording.csv"


def test_the_parameters_are_repeated_each_second_so_that_any_piece_of_the_log_has_them(tmp_path: Path) -> None:
    recording = write_csv(tmp_path, "t,x,y,theta\n0,0,0,0\n2.5,1,0,0\n")
    announced = run(tmp_path, CSV_HEAD | {"pose": POSE}, recording)["PARAMETERS_0"]
    assert [message.utime - START for message in announced] == [0, 2_000_000]
    assert len({(message.sequence, message.yaml, message.sha256) for message in announced}) == 1, "one version"


def test_a_stamp_of_another_age_brings_one_announcement_more(tmp_path: Path) -> None:
    century = 3_000_000_000  # s; each second of it would be 3 billion announcements
    recording = write_csv(tmp_path, f"t,x,y,theta\n0,0,0,0\n0.5,1,0,0\n{century},2,0,0\n")
    announced = run(tmp_path, CSV_HEAD | {"pose": POSE}, recording)["PARAMETERS_0"]
    assert [message.utime - START for message in announced] == [0, century * 1_000_000]


def test_a_command_of_the_body_tells_by_which_width_its_turns_are_counted(tmp_path: Path) -> None:
    body = {"v": {"column": "v", "unit": "m/s"}, "omega": {"column": "w", "unit": "rad/s"}, "full_scale": 20.0}
    recording = write_csv(tmp_path, "t,v,w\n0,0.1,0\n")
    (message,) = run(tmp_path, CSV_HEAD | {"motor_command": body}, recording)["PARAMETERS_0"]
    assert parse(message.yaml).value("turn_rate_limit_base_width") == NOMINAL["base_width"]


def test_a_failed_import_leaves_the_old_log_and_no_other_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.lcm").write_text("the old one")
    recording = write_csv(tmp_path, "t,x,y,theta\n0,0,0,0\n")
    mapping = CSV_HEAD | {"pose": POSE}

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cmr.bus.streams.Stream.channel", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, mapping, recording)
    assert (tmp_path / "run.lcm").read_text() == "the old one"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording.csv", "robot.yaml", "run.lcm"]


def test_a_long_recording_takes_little_more_memory_than_its_numbers(tmp_path: Path) -> None:
    rows = 12_000
    recording = write_csv(tmp_path, "t,x,y,theta\n" + "".join(f"{k / 100},{k},{-k},{k % 90}\n" for k in range(rows)))
    mapping = write_mapping(tmp_path, CSV_HEAD | {"pose": POSE})
    tracemalloc.start()
    try:
        assert main([mapping, str(recording), "--out", str(tmp_path / "run.lcm")]) == 0
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # Two dozen numbers of 8 bytes, some of them for a moment. As cells and messages a row took 490 bytes.
    assert peak < 300 * rows


def test_the_recording_itself_is_never_overwritten(tmp_path: Path) -> None:
    recording = write_csv(tmp_path, "t,x,y,theta\n0,0,0,0\n")
    with pytest.raises(CommandError, match="is the recording itself"):
        main([write_mapping(tmp_path, CSV_HEAD | {"pose": POSE}), str(recording), "--out", str(recording)])


@pytest.mark.parametrize(("recording", "out"), [("absent.csv", "run.lcm"), ("robot.yaml", "absent/run.lcm")])
def test_files_that_cannot_be_used_are_one_sentence(tmp_path: Path, recording: str, out: str) -> None:
    mapping = write_mapping(tmp_path, CSV_HEAD | {"pose": POSE})
    with pytest.raises(CommandError) as error:
        main([mapping, str(tmp_path / recording), "--out", str(tmp_path / out)])
    assert "\n" not in str(error.value)
