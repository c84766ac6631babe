"""A sweep does every run once, whoever dies meanwhile, and the same seed gives the same result to the last bit."""

import json
import math
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from distributed import Client, KilledWorker, LocalCluster

from cmr.commands.scenarios import HARDWARE
from cmr.experiments.sweep import experiment
from cmr.experiments.sweep.cluster import ClusterError, perform, workers
from cmr.experiments.sweep.journal import Journal, JournalError, Result
from cmr.experiments.sweep.planning import plan
from cmr.experiments.sweep.settings import SettingError, setting_of
from cmr.experiments.sweep.table import medians, write_parquet, write_tables
from cmr.parameters.file import ParameterFile, Value
from tests.support.bus_bench import our_command

pytestmark = pytest.mark.slow

LONGEST_END = 2.0  # s
PATIENCE = 240.0  # s for a compiler that nobody has run before, on a busy machine
PAPER = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
SCENARIO = """
duration: 1
seed: 5
parameters: robot_0.yaml
robots:
  - id: 10
    kind: virtual
    behaviour: figure_eight,start=0,speed=0.4
  - id: 0
    kind: emulated
    start: [-0.5, 0.0]
    behaviour: follow,leader=10,gap=0.4
  - count: 2
    first_id: 12
    kind: virtual
    start: {rule: line, x: -1.0, spacing: 0.5}
    behaviour: follow,leader=previous,gap=0.4
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A short scenario with its parameter file."""
    ParameterFile(0, {name: Value(value) for name, value in PAPER.items()}).save(tmp_path / "robot_0.yaml")
    path = tmp_path / "short.yaml"
    path.write_text(SCENARIO.replace("previous", "10"))
    return path


# What is varied


def test_values_reach_robots_by_their_ids_and_behaviours_by_their_settings(scenario: Path) -> None:
    settings = [setting_of("robots.0.behaviour.gap=0.2,0.6"), setting_of("robots.12.start.spacing=0.7")]
    runs = plan(scenario, settings, seeds=2, hardware=HARDWARE)
    gaps = [run.experiment.scenario.robot(0).behaviour.settings["gap"] for run in runs]  # type: ignore[union-attr]
    assert gaps == ["0.2", "0.2", "0.6", "0.6"]
    places = [robot.start for run in runs if (robot := run.experiment.scenario.robot(13))]
    assert {round(abs(place.x + 1.0), 9) for place in places if place is not None} == {0.7}
    assert [run.seed for run in runs] == [5, 6, 5, 6]
    assert len({run.key for run in runs}) == 4
    assert [run.key for run in plan(scenario, settings, seeds=2, hardware=HARDWARE)] == [run.key for run in runs]


def test_a_sweep_knows_its_runs_by_the_content_of_their_files_too(scenario: Path) -> None:
    (before,) = plan(scenario, [], seeds=1, hardware=HARDWARE)
    values = {name: Value(1.01 * value) for name, value in PAPER.items()}
    ParameterFile(0, values).save(scenario.parent / "robot_0.yaml")
    (after,) = plan(scenario, [], seeds=1, hardware=HARDWARE)
    assert before.key != after.key


BEHAVIOUR = """
from cmr.world.behaviours import FigureEight


class Mine(FigureEight):
    pass
"""


def test_a_sweep_knows_its_runs_by_the_source_of_a_users_behaviour_too(
    scenario: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = scenario.parent / "behaviour_of_a_user.py"
    module.write_text(BEHAVIOUR)
    monkeypatch.syspath_prepend(str(scenario.parent))
    scenario.write_text(scenario.read_text().replace("figure_eight,", "behaviour_of_a_user:Mine,"))
    (before,) = plan(scenario, [], seeds=1, hardware=HARDWARE)
    module.write_text(f"{BEHAVIOUR}# changed")
    (after,) = plan(scenario, [], seeds=1, hardware=HARDWARE)
    assert before.key != after.key


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("robots.11.kind=virtual", r"robots.11.kind: there is no '11' in robots; there are 10, 0, 12"),
        ("robots.10.start.x.y=1", r"robots.10.start.x.y: there is no 'start' in robots.10"),
        ("duration.long=1", r"duration.long: there is no 'long' in duration; it holds nothing"),
        ("robots.0.behaviour.gapp=1", r"gapp"),
        ("durations=1", r"durations"),
        ("duration=-1", r"duration"),
    ],
)
def test_a_key_that_is_not_there_is_named(scenario: Path, setting: str, said: str) -> None:
    with pytest.raises(SettingError, match=said):
        plan(scenario, [setting_of(setting)], seeds=1, hardware=HARDWARE)


# What is done


def test_a_result_lands_once_and_is_there_after_a_crash_in_mid_line(tmp_path: Path) -> None:
    path = tmp_path / "out" / "runs.jsonl"
    numbers: Result = {"a": 0.1 + 0.2, "b": math.nan, "c": "text"}
    with Journal(path) as journal:
        journal.add("first", numbers)
        journal.add("first", {"a": 7.0})
        journal.add("second", {"a": 2.0})
    whole = path.read_bytes()
    for length in range(len(whole.splitlines(keepends=True)[0]), len(whole)):
        path.write_bytes(whole[:length])
        with Journal(path) as journal:
            assert list(journal.results) == ["first"]
            assert repr(journal.results["first"]) == repr(numbers)
            journal.add("second", {"a": 2.0})
        assert path.read_bytes() == whole


def test_two_sweeps_cannot_write_to_one_journal(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    with Journal(path), pytest.raises(JournalError, match="in use by another"):
        Journal(path).__enter__()
    with Journal(path):
        pass


@pytest.mark.parametrize("line", ["nonsense", "[]", '{"key": 1}', '{"key": "a", "result": 3}'])
def test_a_file_that_is_no_journal_is_named_and_left_alone(tmp_path: Path, line: str) -> None:
    path = tmp_path / "runs.jsonl"
    path.write_text(f"{line}\n")
    with pytest.raises(JournalError, match="line 1"):
        Journal(path).__enter__()
    assert path.read_text() == f"{line}\n"


# Who does it


def work(seed: int, seconds: float) -> dict[str, Any]:
    """Numbers that differ in their last bits if they are computed in any other order."""
    time.sleep(seconds)
    if seed == 3:
        raise ValueError("three is not possible")
    return {"sum": float(np.sum(np.random.default_rng(seed).standard_normal(10_001))), "pid": os.getpid()}


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with workers(count=2) as client:
        yield client


def test_a_killed_worker_costs_no_run_and_every_result_comes_once(client: Client) -> None:
    client.wait_for_workers(2, timeout=60.0)  # one of another test's victims may still be starting again
    jobs = {f"kill-{seed}": (seed, 0.05) for seed in range(10, 50)}
    found: dict[str, Any] = {}
    for key, result in perform(client, work, jobs):
        assert key not in found
        found[key] = result
        if len(found) == 4:
            assert isinstance(result, dict)
            os.kill(result["pid"], signal.SIGKILL)  # one that is at work, on a busy machine, too
    assert set(found) == set(jobs)
    assert {key: result["sum"] for key, result in found.items()} == {
        key: work(seed, 0.0)["sum"] for key, (seed, _) in jobs.items()
    }
    assert len({result["pid"] for result in found.values()}) >= 2


def test_a_run_that_fails_is_told_and_costs_no_other(client: Client) -> None:
    found = dict(perform(client, work, {f"fail-{seed}": (seed, 0.0) for seed in range(6)}))
    assert len(found) == 6
    assert repr(found.pop("fail-3")) == "ValueError('three is not possible')"
    assert all(isinstance(result, dict) for result in found.values())


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.further  # a killed worker costs no run
def test_a_run_that_kills_every_worker_is_given_up_in_the_end(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    cluster = client.cluster
    assert isinstance(cluster, LocalCluster)
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 1)
    ((_key, result),) = perform(client, die, {"die": ()})
    assert isinstance(result, KilledWorker)


def test_a_scheduler_that_is_not_there_is_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cmr.experiments.sweep.cluster.PATIENCE", 0.5)
    with pytest.raises(ClusterError, match="dask scheduler"), workers("tcp://127.0.0.1:1"):
        pass


def test_a_scheduler_that_ends_is_told_with_what_to_do() -> None:
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        found = perform(client, work, {f"end-{seed}": (seed, 0.1) for seed in range(10, 30)})
        next(found)
        cluster.close()
        with pytest.raises(ClusterError, match="the same command goes on from here"):
            list(found)


def test_a_run_is_done_by_no_other_version_of_cmr_than_that_which_planned_it(scenario: Path) -> None:
    (run,) = plan(scenario, [], seeds=1, hardware=HARDWARE)
    with pytest.raises(ImportError, match="has another CMR installed"):
        experiment.perform(replace(run.experiment, sources="of last year"), run.seed)


@pytest.mark.parametrize(
    ("key", "wrong", "said"),
    [
        ("    behaviour: figure_eight,start=0,speed=0.4", "", "robot 10 has no behaviour"),
        (
            "duration: 1",
            "duration: 1\nends_when: {metric: minimum_separation, below: 0.1}",
            "only cmr-run ends a run by minimum_separation",
        ),
    ],
)
def test_a_scenario_that_cannot_be_swept_is_told_before_anything_is_done(
    scenario: Path, key: str, wrong: str, said: str
) -> None:
    text = scenario.read_text()
    assert key in text
    scenario.write_text(text.replace(key, wrong))
    with pytest.raises(experiment.ExperimentError, match=said):
        plan(scenario, [], seeds=1, hardware=HARDWARE)


# All together


COUNT = 12  # runs


def sweep(scenario: Path, out: Path, *options: str) -> "subprocess.Popen[str]":
    """Start a sweep of 6 seeds of two settings in a process group of its own, as a shell does."""
    command = [our_command("cmr-sweep"), str(scenario), "--out", str(out), "--seeds", "6", *options]
    return subprocess.Popen(
        [*command, "--set", "robots.0.behaviour.gap=0.3,0.5"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def done(out: Path) -> int:
    """Return how many results have landed."""
    journal = out / "runs.jsonl"
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def wait_until_more_are_done(process: "subprocess.Popen[str]", out: Path, than: int) -> None:
    deadline = time.monotonic() + PATIENCE
    while done(out) <= than:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def living(group: int) -> list[int]:
    """Return the processes of a group that have not ended."""
    found = subprocess.run(["ps", "-A", "-o", "pid=,pgid=,stat="], capture_output=True, text=True, check=True).stdout
    processes = (line.split() for line in found.splitlines())
    return [int(pid) for pid, other, state in processes if int(other) == group and not state.startswith("Z")]


def rows_done_here(scenario: Path) -> list[dict[str, Any]]:
    """Return the rows of the sweep, done one after another in this process."""
    runs = plan(scenario, [setting_of("robots.0.behaviour.gap=0.3,0.5")], seeds=6, hardware=HARDWARE)
    return [{"seed": run.seed, **run.values, **experiment.perform(run.experiment, run.seed)} for run in runs]


def test_a_sweep_that_is_interrupted_ends_at_once_and_quietly_with_all_its_processes(
    scenario: Path, tmp_path: Path
) -> None:
    with sweep(scenario, tmp_path / "out", "--workers", "1") as interrupted:
        wait_until_more_are_done(interrupted, tmp_path / "out", than=0)
        began = time.monotonic()
        os.killpg(interrupted.pid, signal.SIGINT)  # as Ctrl-C does
        said = interrupted.communicate(timeout=PATIENCE)  # all that wrote to these have closed them
    while living(interrupted.pid) and time.monotonic() - began < LONGEST_END:
        time.sleep(0.01)  # until the system has taken them away
    assert time.monotonic() - began < LONGEST_END
    assert interrupted.returncode == 130
    assert said[0] == ""
    assert said[1].endswith("cmr-sweep: stopped; the same command goes on from here.\n")
    assert "Traceback" not in said[1]
    assert not living(interrupted.pid)


def test_a_killed_sweep_goes_on_and_ends_as_if_done_in_one_process_to_the_last_bit(
    scenario: Path, tmp_path: Path, client: Client
) -> None:
    cluster = client.cluster
    assert isinstance(cluster, LocalCluster)
    out, scheduler = tmp_path / "out", ("--scheduler", str(cluster.scheduler_address))
    with sweep(scenario, out, *scheduler) as killed:
        wait_until_more_are_done(killed, out, than=0)
        killed.kill()
    before = done(out)
    with sweep(scenario, out, *scheduler) as resumed:
        said, told = resumed.communicate(timeout=PATIENCE)
    assert resumed.returncode == 0, told
    assert f"{before} of {COUNT} runs are there already" in told
    keys = [json.loads(line)["key"] for line in (out / "runs.jsonl").read_text().splitlines()]
    assert len(keys) == len(set(keys)) == COUNT
    rows = pq.read_table(out / "runs.parquet").to_pylist()
    assert list(map(repr, rows)) == list(map(repr, rows_done_here(scenario)))  # no number differs in its last bit
    assert [(row["seed"], row["robots.0.behaviour.gap"]) for row in rows] == [
        (seed, gap) for gap in (0.3, 0.5) for seed in range(5, 11)
    ]
    assert len({row["paths_sha256"] for row in rows}) == COUNT
    assert all(row["formation_error"] > 0.0 and row["simulated_time"] == pytest.approx(1.0, abs=0.05) for row in rows)
    assert "robots.0.behaviour.gap=0.3: formation_error" in said
    assert (out / "summary.png").stat().st_size > 10_000


def test_a_table_holds_settings_of_any_kind(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = [{"seed": 1, "gap": 0.5, "error": math.nan}, {"seed": 2, "gap": "wide", "error": 2.0}]
    write_parquet(rows, tmp_path / "runs.parquet")
    table = pq.read_table(tmp_path / "runs.parquet").to_pylist()
    assert [row["gap"] for row in table] == ["0.5", "wide"]
    assert medians(rows, ["gap"], ["error"])[0] == "gap=0.5: nothing could be measured (median of 1 runs)"
    starts: list[dict[str, Any]] = [
        {"start": value, "time_to_goal": float(k)} for k, value in enumerate(([0, 1], [0, 2], [0, 1], None))
    ]
    assert [line.partition(":")[0] for line in medians(starts, ["start"], ["time_to_goal"])] == [
        *("start=[0, 1]", "start=[0, 2]", "start=None")
    ]
    away = [{**row, "waypoints_reached": row["time_to_goal"] < 2.0} for row in starts]
    (said,) = medians(away, [], ["time_to_goal"])
    assert said.startswith(
        "all seeds: time_to_goal 1.5 s, waypoints not reached in 2, whose time to goal is that of the"
    )
    assert write_tables(starts, ["start"], ["time_to_goal"], tmp_path, "starts")[0].endswith("1 s (median of 2 runs)")
