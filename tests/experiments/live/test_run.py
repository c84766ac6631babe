"""cmr-run runs a team experiment from its file to its report, and leaves nothing running.

One real run of some seconds, with an emulated robot, on a bus of its own; the tests look at what it left.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import lcm
import pytest

from cmr.bus.messages import make, now_utime
from cmr.commands.run import where_logs_are
from cmr.commands.scenarios import load
from cmr.experiments.live.jobs import jobs_of
from cmr.experiments.live.preparing import prepare
from cmr.experiments.live.recorder import logs_in
from cmr.experiments.scenario.reading import shipped
from cmr.msg import estop_t, process_status_t, world_state_t
from cmr.recordings.events import LogReader
from tests.support.html_page import Page
from tests.support.private_bus import private_url

pytestmark = pytest.mark.waits

RUN = str(Path(sys.executable).parent / "cmr-run")
PARAMETERS = shipped()["line"].parent / "parameters/robot_0.yaml"
AT = 1.5  # m; where a robot starts that nobody sends on its way
TEXT = f"""\
about: Two robots, and one that begins by itself
duration: 60
parameters: {PARAMETERS}
ends_when: waypoints_reached
robots:
  - {{id: 10, kind: virtual, behaviour: "figure_eight,laps=0", waypoints: [[0.6, 0.0]]}}
  - {{id: 0, kind: emulated, start: [-0.6, 0.0], behaviour: "follow,leader=10,gap=0.5"}}
  - {{id: 11, kind: virtual, start: [0.0, {AT}], behaviour: "figure_eight,size=0.3,speed=0.3,start=0"}}
"""


def processes_naming(folder: Path) -> list[str]:
    """The command lines of all processes that name a folder."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = path.read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if str(folder) in command and "pytest" not in command:
            lines.append(command)
    return lines


def pid_of(folder: Path, command: str) -> int:
    """Wait for a process of a run, and return its id."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                line = path.read_bytes().decode()
            except OSError:
                continue
            if command in line and str(folder) in line and RUN not in line:
                return int(path.parent.name)
        time.sleep(0.05)
    raise AssertionError(f"there is no {command}")


def start(folder: Path, url: str) -> "subprocess.Popen[str]":
    folder.mkdir()
    (folder / "two.yaml").write_text(TEXT)
    command = [RUN, str(folder / "two.yaml"), "--out", str(folder / "out"), "--lcm-url", url]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def send_estop(url: str, *, engaged: bool) -> None:
    """Engage or release the emergency stop for half a second, and be gone."""
    bus = lcm.LCM(url)
    for _ in range(10):
        bus.publish("ESTOP", make(estop_t, utime=now_utime(), engaged=engaged, source="test", reason="try").encode())
        time.sleep(0.05)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A run whose simulation is killed while its robots drive: the folder, and what was said."""
    folder = tmp_path_factory.mktemp("run") / "two"
    url = private_url()
    process = start(folder, url)
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        if "ready." in line:
            time.sleep(1.0)
            os.kill(pid_of(folder, "cmr-sim"), signal.SIGKILL)
            send_estop(url, engaged=True)
            send_estop(url, engaged=False)
            break
    rest, _ = process.communicate(timeout=200.0)
    assert process.returncode == 0, said + rest
    return folder, said + rest


@pytest.fixture(scope="module")
def report(run: tuple[Path, str]) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((run[0] / "out/report.json").read_text())
    return content


def test_it_ends_when_the_waypoints_are_reached(report: dict[str, Any]) -> None:
    assert report["ended_by"] == "all waypoints are reached"
    follower, leader, _ = report["robots"]
    assert leader["waypoints_left"] == 0
    assert leader["path"]["x"][-1] == pytest.approx(0.6, abs=0.16)
    assert follower["kind"] == "emulated"
    assert follower["distance_m"] > 0.3


def test_a_simulation_that_died_goes_on_where_its_robots_were(report: dict[str, Any], run: tuple[Path, str]) -> None:
    assert "sim was ended by SIGKILL" in run[1]
    assert report["restarts"] >= 1
    path = report["robots"][1]["path"]
    steps = [abs(after - before) for before, after in zip(path["x"], path["x"][1:], strict=False)]
    assert max(steps) < 0.35, "it did not start again from the beginning"
    assert min(path["x"]) > -0.05


def test_an_emergency_stop_is_told(report: dict[str, Any], run: tuple[Path, str]) -> None:
    words = [event["words"] for event in report["events"]]
    assert words.index("ESTOP is engaged by test: try.") < words.index("ESTOP is released.")
    assert "ESTOP is released." in run[1]


def test_nobody_drives_before_all_are_ready(run: tuple[Path, str]) -> None:
    begun, moved = False, []
    for received in LogReader(run[0] / "out/run.lcm"):
        message = received.message
        if isinstance(message, process_status_t) and message.process == "cmr-run":
            begun = begun or message.state == process_status_t.RUNNING
        elif isinstance(message, world_state_t) and 11 in list(message.robot_id):
            y = message.y[list(message.robot_id).index(11)]
            if abs(y - AT) > 0.01:
                moved.append(begun)
    assert moved
    assert all(moved)


def test_everything_was_recorded(run: tuple[Path, str]) -> None:
    reader = LogReader(run[0] / "out/run.lcm")
    channels = {received.channel for received in reader}
    assert {
        "WORLD_STATE",
        "MOTOR_COMMAND_0",
        "MOTOR_FEEDBACK_0",
        "POSE_0",
        "WAYPOINTS_10",
        "PROCESS_STATUS",
    } <= channels
    assert not reader.rejected


def test_all_logs_are_named_where_the_recorder_was_started_again(run: tuple[Path, str], tmp_path: Path) -> None:
    assert f"the log is {run[0]}/out/run.lcm, " in run[1]
    logs = [tmp_path / "run.lcm", tmp_path / "run_2.lcm"]
    for path in logs:
        path.touch()
    assert where_logs_are(logs_in(tmp_path)) == f"the logs are {tmp_path}/run.lcm, {tmp_path}/run_2.lcm, "
    assert where_logs_are([]) == ""


def test_a_folder_that_holds_a_run_is_left_alone(run: tuple[Path, str]) -> None:
    before = {path: path.read_bytes() for path in (run[0] / "out").iterdir() if path.is_file()}
    command = [RUN, str(run[0] / "two.yaml"), "--out", str(run[0] / "out"), "--lcm-url", private_url()]
    result = subprocess.run(command, capture_output=True, text=True, timeout=30.0, check=False)
    assert result.returncode == 1
    assert result.stderr.startswith(f"cmr-run: {run[0]}/out holds a run already. Choose another with --out")
    assert {path: path.read_bytes() for path in before} == before


def test_every_process_was_asked_to_end_and_did(report: dict[str, Any], run: tuple[Path, str]) -> None:
    names = {process["name"] for process in report["processes"]}
    assert names == {"recorder", "sim", "emulator 0", "driver 0", "pilot 0"}
    assert all(process["ends"][-1] == "stopped normally" for process in report["processes"])
    assert processes_naming(run[0]) == []


def test_the_page_shows_what_happened(report: dict[str, Any], run: tuple[Path, str]) -> None:
    page = Page((run[0] / "out/report.html").read_text())
    assert "two: " in page.texts[0]
    assert "sim was ended by SIGKILL" in page.text
    assert report["minimum_separation_m"] > 0.2


def test_ctrl_c_stops_everything_and_still_writes_the_report(tmp_path: Path) -> None:
    folder = tmp_path / "two"
    process = start(folder, private_url())
    pid_of(folder, "cmr-sim")
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=30.0)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert json.loads((folder / "out/report.json").read_text())["ended_by"].startswith("somebody ended it")
    assert processes_naming(folder) == []


def test_an_emulated_robot_takes_its_emergency_stop_with_it(tmp_path: Path) -> None:
    folder, url = tmp_path / "two", private_url()
    process = start(folder, url)
    kept = folder / "out" / "state" / "estop"
    deadline = time.monotonic() + 60.0
    while not (kept.exists() and list(kept.glob("robot_0_*.json"))):
        assert time.monotonic() < deadline
        send_estop(url, engaged=True)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=30.0)
    assert "ESTOP is engaged by test: try" in said
    assert not (folder / "out" / "state").exists()


def test_drivers_of_emulated_robots_alone_keep_an_emergency_stop_in_the_folder_of_the_run(tmp_path: Path) -> None:
    for kind in ("kind: emulated", "kind: real, driver: {port: /dev/null}"):
        (tmp_path / "two.yaml").write_text(TEXT.replace("kind: emulated", kind))
        jobs = jobs_of(load(tmp_path / "two.yaml"), tmp_path / "out", "udpm://239.255.76.67:7667?ttl=0")
        (driver,) = (job for job in jobs if job.name == "driver 0")
        assert ("--state" in driver.command) == (kind == "kind: emulated")


def test_a_behaviour_of_ones_own_is_found_in_the_folder_where_the_command_is_run(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from cmr.world.behaviours import Behaviour\n"
        "class Circle(Behaviour):\n"
        "    def command(self, utime, me, world, parameters):\n"
        "        return 0.3, 0.6\n"
    )
    robot = "{id: 7, kind: virtual, behaviour: 'mine:Circle'}"
    (tmp_path / "own.yaml").write_text(f"duration: 1\nparameters: {PARAMETERS}\nrobots:\n  - {robot}\n")
    command = [RUN, "own.yaml", "--out", "out", "--lcm-url", private_url()]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100.0, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    (robot_7,) = json.loads((tmp_path / "out/report.json").read_text())["robots"]
    assert robot_7["behaviour"] == "mine:Circle"
    assert robot_7["distance_m"] > 0.1


def test_a_scenario_that_is_wrong_starts_nothing(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text(TEXT.replace("leader=10", "leader=12"))
    command = [RUN, str(tmp_path / "bad.yaml"), "--out", str(tmp_path / "out")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=30.0, check=False)
    assert result.returncode == 1
    assert result.stderr.startswith(
        f"cmr-run: {tmp_path}/bad.yaml: line 7: robots[1]: behaviour: robot 0 has the leader"
    )
    assert not (tmp_path / "out").exists()


def test_what_belongs_to_another_machine_is_said_and_not_started(tmp_path: Path) -> None:
    (tmp_path / "far.yaml").write_text(TEXT.replace("id: 0,", "id: 0, host: robot-pi,"))
    command = [RUN, str(tmp_path / "far.yaml"), "--out", str(tmp_path / "out"), "--lcm-url", private_url()]
    result = subprocess.run(command, capture_output=True, text=True, timeout=30.0, check=False)
    assert result.returncode == 1
    assert "runs on robot-pi, but the bus" in result.stderr
    assert "ttl=1" in result.stderr


def test_an_emulated_robot_with_a_velocity_controller_needs_no_driver(tmp_path: Path) -> None:
    (tmp_path / "speeds.yaml").write_text(TEXT.replace("id: 0,", "id: 0, emulator: {command: velocity},"))
    jobs = jobs_of(load(tmp_path / "speeds.yaml"), tmp_path / "out", "udpm://239.255.76.67:7667?ttl=0")
    (emulator,) = (job for job in jobs if job.name == "emulator 0")
    assert "--command velocity" in " ".join(emulator.command)
    assert "--ports" not in emulator.command
    assert "driver 0" not in [job.name for job in jobs]
    assert "pilot 0" in [job.name for job in jobs]


def test_the_files_of_a_scenario_are_never_changed_by_a_run(tmp_path: Path) -> None:
    scenario = load(shipped()["line"])
    prepared = prepare(scenario, tmp_path / "out")
    assert {robot.parameters for robot in prepared.robots} <= {None, tmp_path / "out/robot_0.yaml"}
    for job in jobs_of(prepared, tmp_path / "out", "udpm://239.255.76.67:7667?ttl=0"):
        assert not any(str(PARAMETERS.parent) in word for word in job.command), job
