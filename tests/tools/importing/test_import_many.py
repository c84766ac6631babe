"""Promises of cmr-import about many recordings in one call: all are imported, under names that can be predicted."""

from pathlib import Path
from typing import Any

import pytest

from cmr.cli.errors import CommandError
from cmr_tools.importing.import_log import main
from tests.tools.importing.import_bench import CSV_HEAD, POSE, messages_of, write_csv, write_mapping
from tests.tools.importing.test_csv import SEVERAL, several_files

MAPPING: dict[str, Any] = CSV_HEAD | {"pose": POSE}


def recordings(folder: Path, *names: str) -> list[Path]:
    """Write recordings whose x is 0, 1, 2 ... m."""
    paths = []
    for number, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        paths.append(write_csv(folder, f"t,x,y,theta\n0,{100 * number},0,0\n1,{100 * number},0,0\n", name))
    return paths


def logs(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_each_log_has_its_recordings_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = recordings(tmp_path / "in", "run_01.csv", "run_2.5.csv", "run_03.csv")
    out = tmp_path / "logs"
    assert main([write_mapping(tmp_path, MAPPING), *map(str, paths), "--out", str(out), "--robot", "4"]) == 0
    assert logs(out) == ["run_01.lcm", "run_03.lcm", "run_2.5.lcm"]
    assert messages_of(out / "run_2.5.lcm")["POSE_4"][0].x == 1.0
    said = capsys.readouterr().out.splitlines()
    assert [line for line in said if "4 messages over 1.0 s" in line] == said[:3]
    assert said[-1] == f"next: cmr-diagnose {out}/*.lcm --robot 4 --out diagnosis"


def test_logs_lie_as_their_recordings_below_the_folder_that_they_share(tmp_path: Path) -> None:
    recordings(tmp_path / "in", "circle/run.csv", "square/run.csv", "square/left/run.csv")
    assert main([write_mapping(tmp_path, MAPPING), f"{tmp_path}/in/**/*.csv", "--out", str(tmp_path / "logs")]) == 0
    assert logs(tmp_path / "logs") == ["circle/run.lcm", "square/left/run.lcm", "square/run.lcm"]


def test_a_pattern_takes_what_fits_and_each_recording_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recordings(tmp_path / "in", "run_1.csv", "run_2.csv", "notes.csv")
    mapping = write_mapping(tmp_path, MAPPING)
    monkeypatch.chdir(tmp_path)
    assert main([mapping, "in/run_[0-9].csv", "in/run_1.csv", "--out", "logs"]) == 0
    assert logs(tmp_path / "logs") == ["run_1.lcm", "run_2.lcm"]
    with pytest.raises(CommandError, match=r"in/\*\.bag: nothing fits this pattern"):
        main([mapping, "in/*.bag", "--out", "logs"])


@pytest.mark.parametrize("name", ["run[1].csv", "*.csv"])
def test_a_file_whose_name_looks_like_a_pattern_is_that_file(tmp_path: Path, name: str) -> None:
    (path,) = recordings(tmp_path / "in", name)
    assert main([write_mapping(tmp_path, MAPPING), str(path), "--out", f"{tmp_path}/logs/"]) == 0
    assert logs(tmp_path / "logs") == [name.replace(".csv", ".lcm")]


@pytest.mark.parametrize("exists", [True, False])
def test_one_recording_goes_into_a_folder_that_is_there_or_ends_in_a_slash(tmp_path: Path, exists: bool) -> None:
    (path,) = recordings(tmp_path / "in", "run.csv")
    out = tmp_path / "logs"
    if exists:
        out.mkdir()
    assert main([write_mapping(tmp_path, MAPPING), str(path), "--out", str(out) if exists else f"{out}/"]) == 0
    assert logs(out) == ["run.lcm"]


def test_what_cannot_be_imported_is_said_and_keeps_none_of_the_others_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = recordings(tmp_path / "in", "a.csv", "b.csv", "c.csv")
    paths[0].write_text("t,x\n0,0\n")
    absent = tmp_path / "in" / "absent.csv"
    with pytest.raises(CommandError, match="2 of 4 recordings could not be imported"):
        main([write_mapping(tmp_path, MAPPING), *map(str, [*paths, absent]), "--out", str(tmp_path / "logs")])
    assert logs(tmp_path / "logs") == ["b.lcm", "c.lcm"]
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert "a.csv: no column 'y'" in said[0]
    assert "absent.csv: No such file" in said[1]


def test_two_recordings_of_one_name_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    paths = recordings(tmp_path / "in", "run.csv", "run.txt")
    with pytest.raises(CommandError, match=r"run\.csv and .*run\.txt would both become .*run\.lcm; import them apart"):
        main([write_mapping(tmp_path, MAPPING), *map(str, paths), "--out", str(tmp_path / "logs")])
    assert not (tmp_path / "logs").exists()


def test_several_recordings_do_not_go_into_a_file(tmp_path: Path) -> None:
    paths = recordings(tmp_path / "in", "a.csv", "b.csv")
    (tmp_path / "run.lcm").write_text("a log")
    with pytest.raises(CommandError, match="for several recordings --out must be a folder"):
        main([write_mapping(tmp_path, MAPPING), *map(str, paths), "--out", str(tmp_path / "run.lcm")])
    assert (tmp_path / "run.lcm").read_text() == "a log"


def test_recordings_of_several_files_are_found_by_any_of_them(tmp_path: Path) -> None:
    for name in ("one", "two"):
        several_files(tmp_path / "in", name)
    mapping = write_mapping(tmp_path, SEVERAL)
    assert main([mapping, f"{tmp_path}/in/*_*", "--out", str(tmp_path / "logs")]) == 0
    assert logs(tmp_path / "logs") == ["one.lcm", "two.lcm"]


def test_a_folder_that_holds_one_recordings_files_gives_its_log_its_name(tmp_path: Path) -> None:
    folders = [str(several_files(tmp_path / name)) for name in ("monday", "tuesday")]
    assert main([write_mapping(tmp_path, SEVERAL), *folders, "--out", str(tmp_path / "logs")]) == 0
    assert logs(tmp_path / "logs") == ["monday.lcm", "tuesday.lcm"]
