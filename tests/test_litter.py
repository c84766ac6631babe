"""What processes that were killed left behind is removed by the next that starts, and nothing else."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cmr import litter
from cmr.files import write_atomically
from cmr.litter import temporary_beside, temporary_folder
from cmr.view.opening import LogFolder
from cmr_tools.writing import complete_files_or_none, complete_or_none
from robot_driver.terminals.pseudo_terminal import Ports

# Each makes a temporary file or folder in the folder that is its argument, and is then busy.
WRITES = """
import os, sys, time
from pathlib import Path
from cmr.files import write_atomically
os.fsync = lambda _descriptor: (print("there", flush=True), time.sleep(600))
write_atomically("text", Path(sys.argv[1]) / "robot_0.yaml")
"""
IMPORTS = """
import sys, time
from pathlib import Path
from cmr_tools.writing import complete_or_none, complete_files_or_none
with complete_or_none(Path(sys.argv[1]) / "run.lcm"), complete_files_or_none(Path(sys.argv[1])):
    print("there", flush=True)
    time.sleep(600)
"""
SHOWS = """
import tempfile, sys, time
tempfile.tempdir = sys.argv[1]
from cmr.view.opening import LogFolder
from robot_driver.terminals.pseudo_terminal import Ports
folder = LogFolder()
print("there", flush=True)
time.sleep(600)
"""


@pytest.fixture(autouse=True)
def _as_after_a_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(litter, "_swept", set())


def busy(source: str, folder: Path) -> "subprocess.Popen[str]":
    process = subprocess.Popen([sys.executable, "-c", source, str(folder)], stdout=subprocess.PIPE, text=True)
    assert process.stdout
    assert process.stdout.readline() == "there\n"
    return process


def kill(process: "subprocess.Popen[str]") -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate()


@pytest.mark.parametrize(("source", "count"), [(WRITES, 1), (IMPORTS, 2), (SHOWS, 1)])
def test_what_a_killed_process_left_goes_with_the_next_and_what_a_living_one_needs_stays(
    source: str, count: int, tmp_path: Path
) -> None:
    killed, living = busy(source, tmp_path), busy(source, tmp_path)
    try:
        kill(killed)
        assert len(list(tmp_path.iterdir())) == 2 * count
        write_atomically("text", tmp_path / "other.txt")
        left = {path.name for path in tmp_path.iterdir()} - {"other.txt"}
        assert len(left) == count
        assert all(f"-{living.pid}-" in name for name in left)
    finally:
        kill(living)


def test_the_number_of_a_killed_process_may_be_that_of_another_by_now(tmp_path: Path) -> None:
    ours = tmp_path / f".a.{litter._host()}-{os.getpid()}-00000000.tmp"
    before_us = tmp_path / f".b.{litter._host()}-{os.getpid()}-00000000.tmp"
    for path in (ours, before_us):
        path.touch()
    os.utime(before_us, (time.time() - 1e6, time.time() - 1e6))
    temporary_beside(tmp_path / "c")
    assert list(tmp_path.iterdir()) == [ours]


@pytest.mark.parametrize(
    "name",
    ["run.lcm", ".hidden", ".run.lcm.tmp", ".run.lcm.abcdef-1-00000000.tmp", f".x.{'0' * 6}-{2**40}-00000000.tmp"],
)
def test_files_of_others_and_of_other_computers_stay(name: str, tmp_path: Path) -> None:
    (tmp_path / name).touch()
    temporary_beside(tmp_path / "c")
    assert (tmp_path / name).exists()


def test_a_folder_is_looked_through_once(tmp_path: Path) -> None:
    temporary_beside(tmp_path / "c")
    gone = tmp_path / f".a.{litter._host()}-{2**22 + 1}-00000000.tmp"
    gone.touch()
    temporary_beside(tmp_path / "c")
    assert gone.exists()
    litter.sweep(tmp_path)
    assert not gone.exists()


def test_what_comes_to_its_end_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder = LogFolder()
    with temporary_folder("cmr-import") as temporary:
        (temporary / "bag.db3").touch()
        assert len(list(tmp_path.iterdir())) == 2
    folder.clean()
    with complete_or_none(tmp_path / "run.lcm") as temporary:
        temporary.write_text("log")
    with complete_files_or_none(tmp_path) as temporary:
        (temporary / "a.csv").write_text("1")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "run.lcm"]
    assert (tmp_path / "run.lcm").stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("theirs", [False, True])
def test_the_folder_of_an_emulator_that_was_killed_goes_with_the_next_unless_it_holds_more(
    theirs: bool, tmp_path: Path
) -> None:
    folder = tmp_path / "cmr-robot-0"
    folder.mkdir()
    (folder / "motor").symlink_to("/dev/pts/9999")
    (folder / ".gyro.4711").symlink_to("/dev/pts/9998")
    if theirs:
        (folder / "notes.txt").touch()
    with Ports(folder, ("motor", "gyro")):
        assert sorted(path.name for path in folder.iterdir() if "." not in path.name) == ["gyro", "motor"]
    assert folder.exists() == theirs
    assert not theirs or (folder / "notes.txt").exists()
