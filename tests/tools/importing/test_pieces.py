"""Promises of cmr-import about pieces: what repeats the piece before is left out, and the log tells them."""

from pathlib import Path
from typing import Any

import pytest

from cmr.commands.command_line import CommandError
from cmr.parameters.file import parse
from tests.tools.importing.import_bench import CSV_HEAD, POSE, START, run, write_csv

PIECES = {"segment": {"column": "window", "gap": 5.0}}
HEADER = "window,t,x,y,theta\n"
# The localisation tells a pose every 0.2 s; rows come every 0.1 s, and the first of a piece repeats the piece before.
STALE = HEADER + "0,0.0,0,0,0\n0,0.1,0,0,0\n0,0.2,3,0,0\n1,0.3,3,0,0\n1,0.4,5,0,0\n1,0.5,5,0,0\n1,0.6,8,0,0\n"


def times(messages: dict[str, list[Any]]) -> list[int]:
    return [(pose.utime - START) // 1000 for pose in messages["POSE_0"]]


def test_the_first_pose_of_a_piece_is_left_out_where_only_changes_are_measurements(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapping = CSV_HEAD | PIECES | {"pose": POSE | {"only_changes": True}}
    assert times(run(tmp_path, mapping, write_csv(tmp_path, STALE))) == [200, 5300, 5500]
    said = capsys.readouterr().out
    assert "POSE_0: 2 x first pose of a piece, which may be older than the piece (first_of_piece: kept" in said
    assert "POSE_0: 2 x row that repeats the pose before it" in said
    assert "in 2 pieces" in said


def test_a_mapping_may_keep_first_poses_but_those_that_repeat_the_piece_before(tmp_path: Path) -> None:
    mapping = CSV_HEAD | PIECES | {"pose": POSE | {"only_changes": True, "first_of_piece": "kept"}}
    assert times(run(tmp_path, mapping, write_csv(tmp_path, STALE))) == [0, 200, 5300, 5500]
    fresh = STALE.replace("1,0.3,3,0,0\n", "1,0.3,4,0,0\n")
    assert times(run(tmp_path, mapping, write_csv(tmp_path, fresh))) == [0, 200, 5200, 5300, 5500]


def test_a_mapping_may_leave_out_first_poses_where_every_row_is_a_measurement(tmp_path: Path) -> None:
    recording = write_csv(tmp_path, HEADER + "0,0,0,0,0\n0,0.1,1,0,0\n1,0,0,0,0\n1,0.1,2,0,0\n")
    assert times(run(tmp_path, CSV_HEAD | PIECES | {"pose": POSE}, recording)) == [0, 100, 5100, 5200]
    mapping = CSV_HEAD | PIECES | {"pose": POSE | {"first_of_piece": "left_out"}}
    assert times(run(tmp_path, mapping, recording)) == [100, 5200]


def test_a_wrong_word_for_first_poses_is_answered_with_the_right_ones(tmp_path: Path) -> None:
    mapping = CSV_HEAD | {"pose": POSE | {"first_of_piece": True}}
    with pytest.raises(CommandError, match="first_of_piece: is True; allowed are left_out, kept"):
        run(tmp_path, mapping, write_csv(tmp_path, STALE))


def test_the_log_tells_its_pieces_by_name_and_their_own_time(tmp_path: Path) -> None:
    rows = "a,7,0,0,0\na,8,1,0,0\nb,2,1,0,1\nb,2.5,1,0,2\na,1,0,0,3\n"
    messages = run(tmp_path, CSV_HEAD | PIECES | {"pose": POSE}, write_csv(tmp_path, HEADER + rows))
    told = parse(messages["PARAMETERS_0"][0].yaml).provenance["pieces"]
    assert told == [[START, "a", 7.0], [START + 6_000_000, "b", 2.0], [START + 11_500_000, "a", 1.0]]


def test_pieces_are_5_seconds_apart_where_the_mapping_says_nothing(tmp_path: Path) -> None:
    mapping = CSV_HEAD | {"segment": {"column": "window"}, "pose": POSE}
    recording = write_csv(tmp_path, HEADER + "0,0,0,0,0\n0,0.1,1,0,0\n1,0,0,0,0\n")
    assert times(run(tmp_path, mapping, recording)) == [0, 100, 5100]


def test_pieces_so_close_that_estimates_would_go_on_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapping = CSV_HEAD | {"segment": {"column": "window", "gap": 0.5}, "pose": POSE}
    run(tmp_path, mapping, write_csv(tmp_path, HEADER + "0,0,0,0,0\n0,0.1,1,0,0\n1,0,0,0,0\n"))
    assert "note: pieces 0.5 s apart are taken for one another's continuation" in capsys.readouterr().out


def test_a_recording_without_pieces_tells_none(tmp_path: Path) -> None:
    messages = run(tmp_path, CSV_HEAD | {"pose": POSE}, write_csv(tmp_path, "t,x,y,theta\n0,0,0,0\n1,0,0,0\n"))
    assert "pieces" not in parse(messages["PARAMETERS_0"][0].yaml).provenance
