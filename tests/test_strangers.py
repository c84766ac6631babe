"""Strangers who send as any number of channels, robots or processes are counted, and cost a bounded amount."""

import csv
import importlib
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet
import pytest

from cmr.bus.channel_statistics import MOST_CHANNELS
from cmr.bus.estop import MOST_NAMED, EmergencyStop
from cmr.bus.messages import make
from cmr.bus.process import Process
from cmr.bus.rejections import OTHERS
from cmr.bus.senders import MOST_SENDERS
from cmr.diagnosis.live.watcher import MOST_WATCHED, Watcher
from cmr.msg import estop_latch_t, estop_t, motor_feedback_t, pose_xyt_t, process_status_t, waypoints_t
from cmr.parameters.following import ParameterFollower
from cmr.recordings.events import Event, LogReader, event_bytes
from cmr.view.data.state import MOST_ROBOTS, ViewState
from cmr.world.world import MOST_STRANGERS, World
from cmr_tools.logs.main import main as log_command
from cmr_tools.spy.statistics import Statistics

pytestmark = pytest.mark.slow

EPOCH = 1_800_000_000_000_000  # us
MANY = 20_000
CAMERA = importlib.import_module("cmr.commands.camera")
SIM = importlib.import_module("cmr.commands.sim")  # the package has a function of this name


def poses(robot_ids: Iterable[int]) -> Iterable[Any]:
    for robot_id in robot_ids:
        yield make(pose_xyt_t, utime=EPOCH, robot_id=robot_id, x=0.0, y=0.0, theta=0.0)


def world_of(folder: Path, estimates: Any = lambda _robot_id: True) -> World:
    follow = lambda robot_id: ParameterFollower(robot_id, folder / f"robot_{robot_id}.yaml")  # noqa: E731
    return World([], follow, estimates=estimates)


def test_a_simulator_takes_in_a_thousand_robots_and_reports_in_short(tmp_path: Path) -> None:
    world = world_of(tmp_path)
    for message in poses(range(MOST_STRANGERS + 500)):
        world.handle(EPOCH, f"POSE_{message.robot_id}", message)
    assert len(world.parameters) == len(world.real_robots) == MOST_STRANGERS
    with Process("cmr-sim", "memq://") as process:
        SIM._announce(world, SIM.Loader([]), process, SIM.Lateness(), SIM.Owners(()))
        assert process.message.startswith(SIM.CROWDED)
        assert len(process.message) < 3_000
        assert f"{MOST_STRANGERS - SIM.MOST_TOLD} more robots" in process.message


def test_strangers_who_fell_silent_keep_no_robot_out(tmp_path: Path) -> None:
    world = world_of(tmp_path)
    for message in poses(range(MOST_STRANGERS)):
        world.handle(EPOCH, f"POSE_{message.robot_id}", message)
    for utime in range(EPOCH + 20_000, EPOCH + 2_000_000, 20_000):
        world.advance(utime)
        for [message] in map(poses, ([7], [MOST_STRANGERS + 7])):
            message.utime = utime
            world.handle(utime, f"POSE_{message.robot_id}", message)
    assert world.real_robots == list(world.parameters) == [7, MOST_STRANGERS + 7]
    assert not world.crowded


def test_a_simulator_of_named_robots_follows_no_other(tmp_path: Path) -> None:
    world = world_of(tmp_path, lambda robot_id: robot_id == 7)
    for message in poses(range(100)):
        world.handle(EPOCH, f"POSE_{message.robot_id}", message)
    assert list(world.parameters) == [7]
    assert not world.crowded


def test_of_robots_that_are_held_so_many_are_known_and_few_are_named() -> None:
    stop, latch = EmergencyStop(), {"engaged": True, "stored": True, "since_utime": EPOCH, "source": "a", "reason": "b"}
    for robot_id in range(MANY):
        message: Any = make(estop_latch_t, utime=EPOCH, robot_id=robot_id, **latch)
        stop.handle(EPOCH, f"ESTOP_LATCH_{robot_id}", message)
    assert len(stop.latched) == MOST_SENDERS
    assert stop.holds(MANY - 1)
    assert f"and {MOST_SENDERS - MOST_NAMED} more" in stop.reason
    assert len(stop.reason) < 500


def test_a_camera_draws_the_ways_of_so_many_robots() -> None:
    showing: Any = SimpleNamespace(_waypoints={}, _make_waypoints=lambda x, y: (x, y))
    for robot_id in range(MANY):
        way = make(waypoints_t, utime=EPOCH, robot_id=robot_id, x=[1.0], y=[2.0])
        CAMERA._Showing.handle(showing, EPOCH, f"WAYPOINTS_{robot_id}", way)
    assert len(showing._waypoints) == MOST_SENDERS


def test_channels_are_counted_together_from_a_certain_number_on() -> None:
    statistics = Statistics()
    for k in range(MOST_CHANNELS + 500):
        statistics.handle(EPOCH + k, f"JUNK_{k}", bytes(8))
    lines = statistics.lines(EPOCH + MOST_CHANNELS)
    assert len(lines) == MOST_CHANNELS + 1
    assert next(line.messages for line in lines if line.channel == OTHERS) == 500
    statistics.handle(EPOCH, "POSE_77", bytes(8))
    assert next(line.errors for line in statistics.lines(EPOCH) if line.channel == OTHERS) == 1


def test_the_page_keeps_so_many_robots_and_processes() -> None:
    state = ViewState()
    for message in poses(range(MOST_ROBOTS + 100)):
        state.handle(EPOCH, f"POSE_{message.robot_id}", message)
    assert len(state.latest["POSE"]) == MOST_ROBOTS
    for pid in range(MOST_SENDERS + 100):
        said = process_status_t()
        said.pid = pid
        state.handle(EPOCH, "PROCESS_STATUS", said)
    assert len(state.processes) == MOST_SENDERS
    assert ("", "", MOST_SENDERS + 99) in state.processes


def test_live_diagnosis_watches_so_many_robots() -> None:
    made: list[int] = []
    watcher = Watcher(lambda robot_id: made.append(robot_id) or ParameterFollower(robot_id))  # type: ignore[func-returns-value]
    for robot_id in range(MOST_WATCHED + 100):
        message = motor_feedback_t()
        message.robot_id, message.utime = robot_id, EPOCH
        watcher.handle(EPOCH, f"MOTOR_FEEDBACK_{robot_id}", message)
    assert len(made) == MOST_WATCHED


def test_channels_of_a_log_that_are_nobodys_are_counted_together(tmp_path: Path) -> None:
    log = tmp_path / "run.lcm"
    log.write_bytes(b"".join(event_bytes(Event(k, EPOCH + k, f"JUNK_{k}", b"x")) for k in range(MANY)))
    reader = LogReader(log)
    assert not list(reader)
    assert reader.rejected.total() == MANY
    assert len(reader.rejected) < 50


@pytest.mark.parametrize("reason", ["=1+1", "@SUM(A1)", "released", "-5"])
def test_a_table_of_a_log_has_no_formulas(reason: str, tmp_path: Path) -> None:
    stop = make(estop_t, utime=EPOCH, engaged=True, source="page", reason=reason)
    log, folder = tmp_path / "run.lcm", tmp_path / "tables"
    log.write_bytes(event_bytes(Event(0, EPOCH, "ESTOP", stop.encode())))
    assert log_command(["csv", str(log), "--out", str(folder)]) == 0
    with (folder / "ESTOP.csv").open(newline="") as stream:
        row = next(csv.DictReader(stream))
    assert row["reason"] == (reason if reason == "released" else f"'{reason}")
    assert row["source"] == "page"
    assert log_command(["parquet", str(log), "--out", str(folder)]) == 0
    assert pyarrow.parquet.read_table(folder / "ESTOP.parquet")["reason"][0].as_py() == reason
