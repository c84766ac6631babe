"""A command that fails leaves no empty folder behind."""

from pathlib import Path

import pytest

from cmr.cli.errors import CommandError
from cmr.commands.diagnose import main as diagnose
from cmr.experiments.sweep.journal import Journal
from cmr.files import folder_for_results
from cmr_tools.logs.main import main as log


def test_a_folder_into_which_nothing_was_written_is_taken_away(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    with pytest.raises(ZeroDivisionError), folder_for_results(tmp_path / "kept" / "a" / "b"):
        raise ZeroDivisionError
    with folder_for_results(tmp_path / "full" / "a"):
        (tmp_path / "full" / "result").touch()
    with folder_for_results(tmp_path / "kept"):
        pass
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["full", "kept", "result"]


def test_commands_that_fail_leave_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.lcm").write_bytes(b"no log")
    Path("empty.lcm").touch()
    with pytest.raises(CommandError):
        diagnose(["bad.lcm", "empty.lcm", "--each", "--jobs", "1", "--out", "diagnoses"])
    with pytest.raises(CommandError):
        log(["csv", "bad.lcm", "--out", "tables"])
    with pytest.raises(ZeroDivisionError), Journal(Path("sweep") / "runs.jsonl"):
        raise ZeroDivisionError
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.lcm", "empty.lcm"]
