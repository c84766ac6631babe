"""The library's shop window: few names, quick to import, and objects that say briefly what they are."""

import subprocess
import sys
from pathlib import Path

import pytest

import cmr
from cmr.distribution import version
from cmr.recordings.events import event_bytes
from tests.support.small_log import small_log


def log(folder: Path) -> Path:
    path = folder / "run.lcm"
    path.write_bytes(b"".join(event_bytes(event) for event in small_log()))
    return path


def test_import_loads_nothing_slow() -> None:
    script = "import sys; had = set(sys.modules); import cmr; print(*set(sys.modules) - had)"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not set(result.stdout.split()) & {"numpy", "numba", "matplotlib", "scipy", "yaml", "lcm", "typing"}


def test_every_name_that_tab_shows_is_there_and_others_are_refused() -> None:
    assert dir(cmr) == sorted(cmr.__all__)
    assert all(getattr(cmr, name) is not None for name in dir(cmr))
    assert cmr.__version__ == version()
    with pytest.raises(AttributeError, match="no_such_name"):
        cmr.no_such_name


def test_a_log_says_briefly_what_it_is(tmp_path: Path) -> None:
    run = cmr.read(log(tmp_path))
    assert run.robot == 3
    assert 0.0 < run.seconds < 1.0
    assert repr(run) == f"<RobotLog {tmp_path}/run.lcm: robot 3, {run.seconds:.1f} s>"
    assert len(repr(run.recording)) < 120
    assert "<td>gyro</td>" in run._repr_html_()


def test_each_signal_becomes_a_table_by_the_time_of_day(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    run = cmr.read(log(tmp_path))
    tables = run.to_pandas()
    assert set(tables) == set(run.recording.signals)
    poses = tables["poses"]
    assert poses["x"].to_list() == [1.5]
    assert poses.index.name == "time"
    assert poses.index[0] == pandas.Timestamp(int(run.recording.poses.utime[0]), unit="us", tz="UTC")


def test_tables_need_pandas_and_say_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = cmr.read(log(tmp_path))
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"to_pandas needs pandas\. To install it: .*pip install"):
        run.to_pandas()
