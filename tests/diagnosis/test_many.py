"""Many diagnoses at once: which logs belong together, and processes of which none is left behind."""

import os
import pty
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cmr import threads
from cmr.cli.command_line import guarded
from cmr.commands.diagnose import main
from cmr.diagnosis.job import Job, Outcome, Telling
from cmr.diagnosis.many import Pool, distinct_names, jobs_of
from cmr.diagnosis.result import EFFECTS_FOUND
from cmr.recordings.recording import RecordingError
from tests.support.lanes import further
from tests.support.logs_of_robots import write_logs
from tests.support.project import PROJECT
from tests.support.terminals import plain, read_all

pytestmark = pytest.mark.slow

PATIENCE = 60.0  # s until something that must happen is given up
WIDEST = 120  # characters of a terminal


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_logs(tmp_path_factory.mktemp("logs"))


# Which logs belong together


def groups(logs: Path, names: str, **options: Any) -> dict[str, tuple[str, int | None, str]]:
    """Return for each folder below `out` the logs (their names in a row), the robot and the held-out logs."""
    held_out = tuple(logs / f"{name}.lcm" for name in options.pop("held_out", ""))
    pattern = Job(logs=(), robot_id=options.pop("robot_id", None), folder=Path("out"), held_out=held_out)
    jobs = jobs_of([logs / f"{name}.lcm" for name in names.split()], pattern, **options)
    return {
        str(job.folder): (
            "".join(log.stem for log in job.logs),
            job.robot_id,
            "".join(log.stem for log in job.held_out),
        )
        for job in jobs
    }


def test_logs_of_one_robot_are_one_job(logs: Path) -> None:
    assert groups(logs, "a b") == {"out": ("ab", 0, "")}
    assert groups(logs, "a c", robot_id=0) == {"out": ("ac", 0, "")}


def test_logs_of_several_robots_are_a_job_for_each(logs: Path) -> None:
    assert groups(logs, "a b c d") == {"out/robot_0": ("abc", 0, ""), "out/robot_3": ("cd", 3, "")}
    assert groups(logs, "a c", held_out="bd") == {"out/robot_0": ("ac", 0, "b"), "out/robot_3": ("c", 3, "d")}


def test_each_makes_a_job_of_every_log_and_robot(logs: Path) -> None:
    assert groups(logs, "a c", each=True) == {
        "out/a_robot_0": ("a", 0, ""),
        "out/c_robot_0": ("c", 0, ""),
        "out/c_robot_3": ("c", 3, ""),
    }
    assert groups(logs, "c", each=True, robot_id=3) == {"out/c_robot_3": ("c", 3, "")}


def test_each_keeps_the_results_of_logs_with_the_same_name_apart(logs: Path, tmp_path: Path) -> None:
    (tmp_path / "a.lcm").write_bytes((logs / "a.lcm").read_bytes())
    jobs = jobs_of([logs / "a.lcm", tmp_path / "a.lcm"], Job(logs=(), robot_id=None, folder=Path("out")), each=True)
    assert [job.folder.name for job in jobs] == [f"{logs.name}_a_robot_0", f"{tmp_path.name}_a_robot_0"]


def test_names_of_logs_are_never_those_of_others(tmp_path: Path) -> None:
    assert distinct_names([Path("a.lcm"), Path("b.lcm")]) == ["a", "b"]
    assert distinct_names([Path("/x/1/a.lcm"), Path("/y/1/a.lcm"), Path("b.lcm")]) == ["x_1_a", "y_1_a", "b"]
    assert distinct_names([Path("a.lcm"), Path("a.log")]) == ["a", "a"]  # which get numbers
    tricky = ["a.lcm", "1/a.lcm", "2/a.lcm", "1_a.lcm", "1_a.log", "1_a_2.lcm"]
    jobs = jobs_of([tmp_path / name for name in tricky], Job(logs=(), robot_id=0, folder=tmp_path), each=True)
    assert len({job.folder for job in jobs}) == len(tricky)


def test_a_log_of_no_use_stops_a_common_diagnosis_but_not_the_others_of_each(logs: Path) -> None:
    with pytest.raises(RecordingError, match=r"none\.lcm: is empty"):
        groups(logs, "a none")
    assert groups(logs, "a none", each=True) == {"out/a_robot_0": ("a", 0, ""), "out/none": ("none", None, "")}


# Many side by side: what the processes do, by name, because they look it up again


def pretend(job: Job, tell: Telling) -> Outcome:
    """Do what the name of the job's folder says."""
    tell(f"{job.folder.name} began.")
    what = job.folder.name.partition("_")[0]
    if what == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "sleep":
        (job.folder.parent / f"{job.folder.name}.pid").write_text(str(os.getpid()))
        time.sleep(PATIENCE)
    if what == "fail":
        return Outcome(folder=job.folder, failure="It cannot be done.")
    told = tuple(sorted({os.environ.get(name, "as many as there are") for name in threads.ALL}))
    return Outcome(folder=job.folder, verdict=EFFECTS_FOUND, effects=(str(os.getpid()), *told), ratio=2.0)


def jobs_named(folder: Path, *names: str) -> list[Job]:
    return [Job(logs=(folder / f"{name}.lcm",), robot_id=0, folder=folder / name) for name in names]


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    """What came of jobs of all kinds, two at a time."""
    names = ["work_1", "fail", "work_2", "die", "work_3", "work_4"]
    told: list[str] = []
    with Pool(2, pretend) as pool:
        done = {found.folder.name: found for found in pool.perform(jobs_named(Path("out"), *names), told.append)}
    assert sorted(done) == sorted(names)
    assert sorted(told) == sorted(f"{name} began." for name in names)
    return done


def test_jobs_run_in_processes_of_their_own_with_one_thread_of_linear_algebra(outcomes: dict[str, Outcome]) -> None:
    worked = [outcomes[f"work_{number}"].effects for number in (1, 2, 3, 4)]
    processes = {int(effects[0]) for effects in worked}
    assert os.getpid() not in processes
    assert len(processes) <= 3, "two at a time, and one in place of the one that died"
    assert {effects[1:] for effects in worked} == {("1",)}


def test_a_job_that_fails_or_dies_does_not_stop_the_others(outcomes: dict[str, Outcome]) -> None:
    assert outcomes["fail"].failure == "It cannot be done."
    assert "was killed by signal 9" in outcomes["die"].failure
    assert not any(outcomes[f"work_{number}"].failure for number in (1, 2, 3, 4))


def test_the_processes_are_gone_when_the_pool_is_left(tmp_path: Path) -> None:
    with Pool(2, pretend) as pool:
        pool_of = iter(pool.perform(jobs_named(tmp_path, "work_1", "sleep_1", "work_2"), lambda _sentence: None))
        assert next(pool_of).folder.name == "work_1"
        wait_until(lambda: (tmp_path / "sleep_1.pid").exists())
        sleeping = int((tmp_path / "sleep_1.pid").read_text() or 0)
    assert sleeping
    assert not exists(sleeping)


def test_robots_that_fail_are_named_in_a_table_and_the_exit_code_is_1(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.modules[main.__module__], "attempt", pretend)
    for name in ("work", "fail"):
        (tmp_path / f"{name}.lcm").write_bytes((logs / "a.lcm").read_bytes())
    arguments = [tmp_path / "fail.lcm", tmp_path / "work.lcm", "--each", "--out", tmp_path / "out"]
    assert guarded(main, [str(argument) for argument in arguments]) == 1
    said = capsys.readouterr()
    assert said.err.endswith(": 1 of 2 diagnoses failed; the table says why.\n")
    assert re.findall(r"^\[\d/\d\]", said.err, re.MULTILINE) == ["[1/2]", "[2/2]"]
    lines = said.out.splitlines()
    assert lines[0].split() == ["diagnosis", "verdict", "gain", "effects"]
    assert re.fullmatch("fail_robot_0 +failed +- +-", lines[1])
    assert re.fullmatch(r"work_robot_0 +effects_found +2\.00 +\d+, 1", lines[2])
    assert lines[3] == "fail_robot_0: failed. It cannot be done."
    assert lines[4] == f"written to the folders of these names below {tmp_path / 'out'}"
    assert max(map(len, lines[:4])) <= WIDEST


def test_no_folders_are_named_where_every_diagnosis_failed(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.modules[main.__module__], "attempt", pretend)
    for name in ("fail_1", "fail_2"):
        (tmp_path / f"{name}.lcm").write_bytes((logs / "a.lcm").read_bytes())
    arguments = [tmp_path / "fail_1.lcm", tmp_path / "fail_2.lcm", "--each", "--out", tmp_path / "out"]
    assert guarded(main, [str(argument) for argument in arguments]) == 1
    said = capsys.readouterr()
    assert said.err.endswith(": 2 of 2 diagnoses failed; the table says why.\n")
    assert "written" not in said.out


# Real processes

SCRIPT = """
import sys
import cmr.commands.diagnose as command
from cmr.commands import run
from tests.diagnosis import test_many
command.attempt = test_many.pretend
sys.argv[0] = "cmr-diagnose"
run("cmr.commands.diagnose")
"""


def started(logs: Path, folder: Path, *names: str, **options: Any) -> "subprocess.Popen[bytes]":
    """Start the command with a job for each name, in a session of its own."""
    for name in names:
        (folder / f"{name}.lcm").write_bytes((logs / "a.lcm").read_bytes())
    arguments = [*(str(folder / f"{name}.lcm") for name in names), "--each", "--out", str(folder), "--jobs", "2"]
    start = [sys.executable, "-c", SCRIPT, *arguments]
    return subprocess.Popen(start, cwd=PROJECT, stdout=subprocess.PIPE, start_new_session=True, **options)


@pytest.fixture
def sleepers(logs: Path, tmp_path: Path) -> Iterator["Sleepers"]:
    found = Sleepers(logs, tmp_path)
    yield found
    found.end()


class Sleepers:
    """The command with two jobs that go on and on, and the processes that do them."""

    def __init__(self, logs: Path, folder: Path) -> None:
        self.command = started(logs, folder, "sleep_1", "sleep_2", "sleep_3", stderr=subprocess.PIPE)
        notes = [folder / f"sleep_{number}_robot_0.pid" for number in (1, 2)]
        wait_until(lambda: all(note.exists() and note.read_text() for note in notes))
        self.workers = [int(note.read_text()) for note in notes]

    def end(self) -> None:
        self.command.kill()
        self.command.communicate()


def exists(process: int) -> bool:
    """Tell whether a process runs; one that has ended and waits to be noticed does not."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "what was waited for did not come"
        time.sleep(0.02)


@pytest.mark.parametrize("number", [signal.SIGTERM, *further(signal.SIGINT, signal.SIGHUP)])
def test_a_signal_ends_everything_at_once_with_130(sleepers: Sleepers, number: signal.Signals) -> None:
    sleepers.command.send_signal(number)
    said, errors = sleepers.command.communicate(timeout=PATIENCE)
    assert (sleepers.command.returncode, said, errors) == (130, b"", b"")
    assert not any(map(exists, sleepers.workers))


def test_ctrl_c_of_a_terminal_which_all_processes_get_leaves_no_traceback(sleepers: Sleepers) -> None:
    os.killpg(sleepers.command.pid, signal.SIGINT)
    said, errors = sleepers.command.communicate(timeout=PATIENCE)
    assert (sleepers.command.returncode, said, errors) == (130, b"", b"")
    assert not any(map(exists, sleepers.workers))


def test_a_command_that_is_killed_leaves_no_process_behind(sleepers: Sleepers) -> None:
    assert all(map(exists, sleepers.workers))
    sleepers.command.kill()
    sleepers.command.communicate(timeout=PATIENCE)
    wait_until(lambda: not any(map(exists, sleepers.workers)))
    assert not any(map(exists, sleepers.workers))


def test_a_terminal_shows_a_bar_that_is_gone_in_the_end(logs: Path, tmp_path: Path) -> None:
    terminal, errors = pty.openpty()
    process = started(logs, tmp_path, "work_1", "work_2", "work_3", stderr=errors)
    os.close(errors)
    shown = read_all(terminal)
    said = process.communicate(timeout=PATIENCE)[0].decode()
    assert process.returncode == 0
    assert {"0/3 diagnoses", "3/3 diagnoses"} <= set(re.findall(r"\d/3 diagnoses", plain(shown)))
    assert "work_" in plain(shown)
    assert shown.endswith("\x1b[2K"), "the bar does not stay"
    assert "[1/3]" not in said
    assert len(said.splitlines()) == 5
