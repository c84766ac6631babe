"""A run on a disk that becomes full: warned, ended in order with a report, and its log has whole events."""

import errno
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lcm
import pytest

from cmr.cli import news
from cmr.experiments.live import disk as disk_module
from cmr.experiments.live.disk import FOR_REPORT, Disk
from cmr.experiments.scenario.reading import shipped
from cmr.processes.children import Children
from cmr.processes.job import CANNOT_WRITE, RECORDER, Job
from cmr.processes.supervisor import Supervisor
from cmr.recordings.events import EventReader
from cmr.recordings.log_file import LogFile
from tests.support.full_disk import limiting, no_file_larger_than
from tests.support.private_bus import private_url

RUN = str(Path(sys.executable).parent / "cmr-run")
LARGE = bytes(50_000)  # a message that fills a log soon
TEXT = f"""\
about: One robot
duration: 120
parameters: {shipped()["line"].parent / "parameters/robot_0.yaml"}
robots:
  - {{id: 10, kind: virtual, behaviour: manoeuvre}}
"""


def test_a_log_is_what_lcm_reads_and_arrives_on_the_disk_within_a_moment(tmp_path: Path) -> None:
    log = LogFile(tmp_path / "run.lcm")
    for number in range(300):
        log.write(1000 + number, f"COUNT_{number % 3}", bytes(number))
    log.close()
    events = list(lcm.EventLog(str(tmp_path / "run.lcm"), "r"))
    assert [(event.eventnum, event.timestamp, event.channel, event.data) for event in events] == [
        (number, 1000 + number, f"COUNT_{number % 3}", bytes(number)) for number in range(300)
    ]
    log = LogFile(tmp_path / "slow.lcm")
    log.write(1, "COUNT", b"1")
    log._due = 0.0
    log.flush_if_due()
    assert len(list(EventReader(tmp_path / "slow.lcm"))) == 1
    log.close()


def test_a_log_on_a_full_disk_ends_with_a_whole_event(tmp_path: Path) -> None:
    path = tmp_path / "run.lcm"
    log, written = LogFile(path), 0
    with no_file_larger_than(1_000_000):
        while written < 1_000_000 // len(LARGE) - 2:
            log.write(written, "COUNT", LARGE)
            written += 1
        with pytest.raises(OSError, match="too large"):
            log.write(written, "COUNT", bytes(200_000))
    reader = EventReader(path)
    assert 0 < len(list(reader)) <= written
    assert reader.damaged_bytes == 0
    log.close()


@pytest.mark.waits
def test_a_recorder_that_cannot_write_ends_with_a_sentence(tmp_path: Path) -> None:
    url, path = private_url(), tmp_path / "run.lcm"
    command = [sys.executable, "-m", "cmr.experiments.live.recorder", str(path), "--lcm-url", url]
    recorder = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=limiting(1_000_000))
    bus, deadline = lcm.LCM(url), time.monotonic() + 60.0
    while recorder.poll() is None:
        assert time.monotonic() < deadline
        bus.publish("COUNT", LARGE)
        time.sleep(0.01)
    _, said = recorder.communicate()
    assert recorder.returncode == CANNOT_WRITE
    assert "Traceback" not in said
    assert said.splitlines()[-1] == f"{path}: nothing more can be recorded: File too large."
    reader = EventReader(path)
    assert list(reader)
    assert reader.damaged_bytes == 0


@pytest.mark.waits
def test_a_recorder_that_cannot_write_is_not_started_again(tmp_path: Path) -> None:
    command = [sys.executable, "-S", "-c", f"import sys; sys.exit({CANNOT_WRITE})"]
    with Children(tmp_path) as children:
        supervisor = Supervisor([Job(RECORDER, RECORDER, command)], children)
        supervisor.poll(0.0)
        deadline = time.monotonic() + 20.0
        while supervisor.is_running(RECORDER):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert not supervisor.is_unrecorded
        (sentence,) = supervisor.poll(1.0)
        assert "the run ends" in sentence
        assert supervisor.is_unrecorded
        assert supervisor.given_up() == [RECORDER]


def test_little_room_is_warned_of_once_and_no_room_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free: dict[str, Any] = {"bytes": 50e9}
    monkeypatch.setattr(disk_module, "LOOK_EVERY", 0.0)
    monkeypatch.setattr("shutil.disk_usage", lambda _folder: (100e9, 0, free["bytes"]))
    disk = Disk(tmp_path)
    said = []
    for size in (50e9, 0.99e9, 1.05e9, 0.5e9, 1.2e9, 0.9e9, 0.11e9):
        free["bytes"] = size
        said.append(disk.look())
        assert not disk.full
    assert [bool(sentence) for sentence in said] == [False, True, False, False, False, True, False]
    assert said[1] == f"Only 990 MB are left on the disk of {tmp_path}; the run ends when 100 MB are."
    assert "nearly full" in disk.shortage
    free["bytes"] = 0.09e9
    disk.look()
    assert disk.full == f"the disk of {tmp_path} is full: 90 MB are left"


def test_a_small_disk_is_full_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _folder: (200e6, 0, 50e6))
    disk = Disk(tmp_path)
    disk.look()
    assert not disk.full


def test_room_for_the_report_is_held_in_a_file_without_a_name_and_given_at_the_end(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.hold_room()
    assert disk._held is not None
    assert os.fstat(disk._held.fileno()).st_blocks * 512 >= min(FOR_REPORT, 1e6)
    assert list(tmp_path.iterdir()) == [], "nothing is left of it by a process that is killed"
    disk.give_room()
    assert disk._held.closed


def test_a_disk_without_room_for_the_report_is_no_error(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    with no_file_larger_than(1000):
        disk.hold_room()
    disk.give_room()


def test_news_that_cannot_be_written_do_not_end_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def write(_text: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys, "stderr", SimpleNamespace(write=write, flush=lambda: None))
    news.say("cmr-driver", "ready")


@pytest.mark.waits
def test_a_run_that_cannot_be_recorded_ends_in_order_with_a_report(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(TEXT)
    url, out = private_url(), tmp_path / "out"
    command = [RUN, str(tmp_path / "one.yaml"), "--out", str(out), "--lcm-url", url]
    # What the compiler keeps is smaller than this; the log is soon larger.
    run = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, preexec_fn=limiting(20_000_000)
    )
    bus, deadline = lcm.LCM(url), time.monotonic() + 240.0
    while run.poll() is None:
        assert time.monotonic() < deadline
        if (out / "sim.txt").exists():
            bus.publish("COUNT", LARGE)
        time.sleep(0.01)
    said, _ = run.communicate()
    assert run.returncode == 1, said
    assert "Traceback" not in said
    assert "run.lcm: nothing more can be recorded: File too large" in said.splitlines()[-1]
    report = json.loads((out / "report.json").read_text())
    assert report["failed"]
    assert "nothing more can be recorded" in report["ended_by"]
    ends = {process["name"]: process["ends"] for process in report["processes"]}
    assert ends == {"recorder": [f"ended with exit code {CANNOT_WRITE}"], "sim": ["stopped normally"]}
    assert [path.name for path in out.glob("*.lcm")] == ["run.lcm"]
