"""An agent runs a robot for cmr-run on another host: what dies is started again, and all ends with the run."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from cmr.bus.keys import write_new_key
from cmr.experiments.scenario.reading import shipped
from tests.support.driver_bench import wait_for
from tests.support.hosts import SHARED_BUS, Host, two_hosts

pytestmark = pytest.mark.waits

PATIENCE = 120.0  # s, for a busy computer
SCENARIO = """\
duration: 60
parameters: {parameters}
robots:
  - {{id: 10, kind: virtual, behaviour: waypoints, waypoints: [[9.0, 0.0]]}}
  - {{id: 0, kind: emulated, host: robot-pi, start: [-1, 0], behaviour: "follow,leader=10"}}
"""
UMBRELLA = "import sys; from cmr.commands import umbrella; sys.exit(umbrella())"


@pytest.fixture
def hosts() -> Iterator[tuple[Host, Host]]:
    with two_hosts("lab-pc", "robot-pi") as both:
        yield both


def running(program: str, folder: Path) -> list[int]:
    """Return the processes of a program that work in a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = path.read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        if any(Path(part).name == program for part in command) and any(str(folder) in part for part in command):
            found.append(int(path.parent.name))
    return found


def test_a_robot_on_another_host_is_run_by_its_agent(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    lab, robot = hosts
    write_new_key(tmp_path / "key")
    environment = {"LCM_DEFAULT_URL": SHARED_BUS, "CMR_KEY": str(tmp_path / "key")}
    scenario = tmp_path / "far.yaml"
    scenario.write_text(SCENARIO.format(parameters=shipped()["line"].parent / "parameters/robot_0.yaml"))
    there, out = tmp_path / "there", tmp_path / "out"
    agent = robot.start(sys.executable, "-c", UMBRELLA, "agent", "--out", str(there), environment=environment)
    run = lab.start(sys.executable, "-c", UMBRELLA, "run", str(scenario), "--out", str(out), environment=environment)
    try:
        wait_for(lambda: running("cmr-driver", there), PATIENCE)
        assert not running("cmr-driver", out)
        [driver] = running("cmr-driver", there)
        os.kill(driver, signal.SIGKILL)
        wait_for(lambda: running("cmr-driver", there) not in ([], [driver]), PATIENCE)
        wait_for(lambda: running("cmr-pilot", there), PATIENCE)
        run.kill()  # nsenter was replaced by what it started
        wait_for(lambda: not any(running(name, there) for name in ("cmr-driver", "cmr-pilot", "cmr-emulate")), PATIENCE)
        assert agent.poll() is None
        agent.terminate()
        assert agent.wait(20.0) == 130
    finally:
        for process in (run, agent):
            process.kill()
            process.wait()
