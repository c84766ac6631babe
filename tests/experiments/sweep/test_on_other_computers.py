"""A worker whose computer lacks what runs need ends the sweep with a sentence; it does not go through all of them."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from distributed import Client, LocalCluster
from distributed.protocol import pickle

from cmr.commands.scenarios import HARDWARE
from cmr.experiments.sweep import experiment
from cmr.experiments.sweep.cluster import ClusterError, _unpacked_there, lookout, perform, worker_command
from cmr.experiments.sweep.planning import plan
from cmr.experiments.team.plan import BehaviourPlan
from tests.experiments.sweep.test_sweep import scenario  # noqa: F401 - a fixture


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        yield client


class LacksModule:
    """What cannot be read where it arrives: there is no such module."""

    def __reduce__(self) -> Any:
        return __import__, ("not_there",)


def double(number: int) -> int:
    return 2 * number


def without_module(number: int) -> int:
    raise ImportError(f"A worker on moon has another CMR installed {number}")


@pytest.mark.parametrize(
    ("work", "argument", "said"),
    [
        (
            double,
            LacksModule(),
            r"A worker on .* cannot do the runs: No module named 'not_there'\. Install the same CMR",
        ),
        (without_module, 1, r"A worker on moon has another CMR installed 1\. Install the same CMR on all computers"),
    ],
)
def test_a_worker_that_lacks_a_module_ends_the_sweep_and_lives(
    client: Client, work: Any, argument: Any, said: str
) -> None:
    with pytest.raises(ClusterError, match=said):
        list(perform(client, work, {f"lacks-{work.__name__}": (argument,)}))
    key = f"sound-after-{work.__name__}"
    assert list(perform(client, double, {key: (4,)})) == [(key, 8)]


def test_that_no_worker_is_left_is_told_once_and_that_the_scheduler_ended_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("cmr.experiments.sweep.cluster.LOOK", 0.02)
    told: list[int] = []
    answers = iter([{"a": 1}, {"a": 1}, {}, {}, {"b": 1}, {}, {}])
    client = SimpleNamespace(nthreads=lambda: next(answers, None) if len(told) < 2 else ended())

    def ended() -> None:
        raise OSError("closed")

    with lookout(cast(Client, client), lambda: told.append(1)):
        until = time.monotonic() + 20.0
        while len(told) < 2 and time.monotonic() < until:
            time.sleep(0.01)
    assert len(told) == 2


def test_what_a_worker_is_told_is_read_where_there_is_no_cmr() -> None:
    told = pickle.dumps(_unpacked_there()) + b"END" + pickle.dumps((double, (4,)))
    program = (
        "import pickle, sys; sys.modules['cmr'] = sys.modules['tests'] = None\n"
        "unpacked, _, packed = sys.stdin.buffer.read().partition(b'END')\n"
        "try: pickle.loads(unpacked)(packed)\n"
        "except ImportError as error: print(error)"
    )
    found = subprocess.run([sys.executable, "-c", program], input=told, capture_output=True, timeout=60, check=True)
    assert b"cannot do the runs: No module named 'tests" in found.stdout, found


def test_a_behaviour_that_is_not_on_the_workers_computer_is_told_with_its_name(scenario: Path) -> None:  # noqa: F811
    (run,) = plan(scenario, [], seeds=1, hardware=HARDWARE)
    robots = [replace(robot, behaviour=BehaviourPlan("mine:Circle")) for robot in run.experiment.scenario.robots]
    elsewhere = replace(run.experiment, scenario=replace(run.experiment.scenario, robots=tuple(robots)))
    with pytest.raises(ImportError, match=r"A worker on .* cannot do the runs: .*'mine:Circle'"):
        experiment.perform(elsewhere, run.seed)


def test_threads_of_one_worker_do_one_run_at_a_time(scenario: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    running, most = 0, 0
    guard = threading.Lock()

    def run(*_: Any) -> Any:
        nonlocal running, most
        with guard:
            running, most = running + 1, max(most, running + 1)
        time.sleep(0.05)
        with guard:
            running -= 1
        return SimpleNamespace(metrics={}, **dict.fromkeys(("time", "x", "y", "theta"), np.zeros(1)))

    monkeypatch.setattr(experiment, "run", run)
    planned = plan(scenario, [], seeds=4, hardware=HARDWARE)
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda one: experiment.perform(one.experiment, one.seed), planned))
    assert most == 1


def test_virtual_robots_alone_can_be_swept(scenario: Path) -> None:  # noqa: F811
    scenario.write_text(scenario.read_text().replace("emulated", "virtual"))
    (one,) = plan(scenario, [], seeds=1, hardware=HARDWARE)
    result = experiment.perform(one.experiment, one.seed)
    assert float(result["minimum_separation"] or 0.0) > 0.0


def test_workers_are_to_be_processes_of_one_thread() -> None:
    assert worker_command("tcp://lab:8786") == "dask worker tcp://lab:8786 --nthreads 1 --nworkers -1"
