"""A run whose processes are partly on other machines waits for them, tells them where to drive, and can be copied."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import now_utime
from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.cli.progress import Progress
from cmr.commands.scenarios import load
from cmr.experiments.live.elsewhere import Elsewhere
from cmr.experiments.live.jobs import jobs_of
from cmr.experiments.live.live_run import LiveRun, Outcome
from cmr.experiments.live.preparing import prepare, write_emulators
from cmr.experiments.scenario.reading import shipped
from cmr.experiments.team.plan import Scenario
from cmr.geometry.places import Pose
from cmr.model.motion import RobotState
from cmr.msg import process_status_t
from cmr.processes.children import Children
from cmr.world.view import VIRTUAL, Robot, world_messages
from robot_driver.emulator.settings import load_settings
from tests.support.small_log import process_status

pytestmark = pytest.mark.waits

URL = "udpm://239.255.76.67:7667?ttl=1"
PARAMETERS = shipped()["line"].parent / "parameters/robot_0.yaml"
SCENARIO = f"""\
duration: 0.3
host: lab-pc
parameters: {PARAMETERS}
population: [{PARAMETERS}, other.yaml]
robots:
  - {{id: 10, kind: virtual, behaviour: waypoints, waypoints: [[0.6, 0.0]]}}
  - {{id: 0, kind: real, host: robot-pi, driver: {{port: /dev/motor}}, start: [-1, 0], behaviour: "follow,leader=10"}}
  - {{id: 1, kind: real, host: robot-pi, driver: {{port: /dev/b}}, start: [1, 0], behaviour: waypoints,
     waypoints: [[2, 0]]}}
"""
PROGRAMS = (("cmr-run recorder", 1), ("cmr-sim", 1), ("cmr-driver", 2), ("cmr-pilot", 2))


def prepared(folder: Path) -> Scenario:
    """The scenario, with the files of a run in `folder`/out."""
    (folder / "other.yaml").write_text(PARAMETERS.read_text().replace("118.0", "110.0"))
    (folder / "far.yaml").write_text(SCENARIO)
    return prepare(load(folder / "far.yaml"), folder / "out")


def status(process: str, pid: int, state: int = process_status_t.RUNNING, message: str = "") -> process_status_t:
    return process_status(now_utime(), process=process, host="robot-pi", pid=pid, state=state, message=message)


def all_statuses() -> list[Any]:
    return [status(name, 100 * place + k) for place, (name, count) in enumerate(PROGRAMS) for k in range(count)]


class Bus:
    """A process on a bus on which the robots are, and on which the processes of other machines tell of themselves."""

    def __init__(self, statuses: list[Any], later: list[Any]) -> None:
        self.statuses = statuses
        self.later = later  # what they say 0.2 s later
        self.turns = 0
        self.published: list[tuple[str, int | None]] = []

    def subscribe(self, *_: Any, **__: Any) -> None:
        """Nothing to do."""

    def loop(self, _rate: float) -> Iterator[int]:
        for _ in range(1000):
            time.sleep(0.01)
            yield now_utime()

    def dispatch(self, handle: Callable[[int, str, Any], None]) -> None:
        utime = now_utime()
        robots = [Robot(utime, k, VIRTUAL, RobotState(float(k), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)) for k in (0, 1, 10)]
        for message in world_messages(utime, robots):
            handle(utime, WORLD_STATE.name, message)
        for message in self.statuses:
            handle(utime, PROCESS_STATUS.name, message)
        self.turns += 1
        if self.turns == 20:
            self.statuses = self.later

    def publish_status(self) -> None:
        self.published.append((PROCESS_STATUS.name, None))

    def publish(self, stream: Any, _message: Any, robot_id: int | None = None) -> None:
        self.published.append((stream.name, robot_id))


def live_run(folder: Path, statuses: list[Any], later: list[Any]) -> tuple[LiveRun, Outcome, Bus]:
    scenario, bus = prepared(folder), Bus(statuses, later)
    others = jobs_of(scenario, folder / "out", URL)
    run = LiveRun(scenario, folder / "out", bus, [], Children(folder), Progress(), others)  # type: ignore[arg-type]
    return run, run.run(), bus


def test_it_begins_when_all_processes_of_other_machines_are_there_and_sends_robots_on_their_way(tmp_path: Path) -> None:
    _, outcome, bus = live_run(tmp_path, all_statuses(), all_statuses())
    assert outcome.ended_by == "its time is over"
    assert sorted(robot_id for _, robot_id in bus.published if robot_id is not None) == [1, 10]


def test_a_doubt_that_is_told_a_moment_after_the_first_word_keeps_the_run_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cmr.experiments.live.live_run.GRACE", 2.0)
    doubt = status("cmr-sim", 100, process_status_t.DEGRADED, "The robot model is still being compiled.")
    run, outcome, _ = live_run(tmp_path, all_statuses(), [*all_statuses(), doubt])
    assert outcome.ended_by == "its time is over"
    assert not any("ready" in words for _, words in run.events)
    (doubted,) = [
        at
        for at, words in run.events
        if words.endswith("cmr-sim on robot-pi: The robot model is still being compiled.")
    ]
    assert doubted > 2.0


def test_robots_that_somebody_else_moves_on_this_bus_are_left_to_them(tmp_path: Path) -> None:
    scenario = prepared(tmp_path)
    jobs = jobs_of(scenario, tmp_path / "out", URL)
    run = LiveRun(scenario, tmp_path, Bus([], []), jobs, Children(tmp_path), Progress())  # type: ignore[arg-type]
    outcome = run.run()
    assert outcome.failed
    assert outcome.ended_by.startswith(
        "on this bus somebody moves robots 0, 1, 10 already: end that cmr-run or cmr-sim"
    )
    assert not any(state.starts for state in run.supervisor.states.values())


@pytest.mark.parametrize("lacking", range(6))
def test_it_waits_for_each_process_of_other_machines(tmp_path: Path, lacking: int) -> None:
    statuses = all_statuses()
    ended = status(statuses[lacking].process, statuses[lacking].pid, process_status_t.STOPPING)
    found = {(one.host, one.pid): one for one in (*statuses, ended)}
    elsewhere = Elsewhere(jobs_of(prepared(tmp_path), tmp_path, URL), found)
    assert elsewhere.silent() == f"{ended.process} on other machines"
    found[ended.host, ended.pid] = status(ended.process, ended.pid, process_status_t.DEGRADED, "Waiting for something.")
    assert elsewhere.silent() == ""
    assert elsewhere.doubt() == f"{ended.process} on robot-pi: Waiting for something."


def test_a_process_that_moves_robots_is_new_once_and_again_when_it_was_started_again(tmp_path: Path) -> None:
    found = {(one.host, one.pid): one for one in all_statuses()}
    elsewhere = Elsewhere(jobs_of(prepared(tmp_path), tmp_path, URL), found)
    assert [elsewhere.newcomers(), elsewhere.newcomers()] == [True, False]
    found["robot-pi", 999] = status("cmr-driver", 999)
    assert not elsewhere.newcomers()
    found["robot-pi", 998] = status("cmr-pilot", 998)
    assert elsewhere.newcomers()


def test_a_process_that_died_without_a_word_is_not_there(tmp_path: Path) -> None:
    found, now = {(one.host, one.pid): one for one in all_statuses()}, [0.0]
    elsewhere = Elsewhere(jobs_of(prepared(tmp_path), tmp_path, URL), found, lambda: now[0])
    dead, *living = found
    for now[0] in (1.0, 4.0, 7.0):
        found |= {key: status(found[key].process, found[key].pid) for key in living}
        assert elsewhere.silent() == ("" if now[0] < 5.0 else f"{found[dead].process} on other machines")
    found[dead] = status(found[dead].process, found[dead].pid)
    assert elsewhere.silent() == ""


def test_the_folder_of_a_run_can_be_copied_to_another_machine(tmp_path: Path) -> None:
    scenario = prepared(tmp_path)
    (tmp_path / "other.yaml").unlink()
    (tmp_path / "out").rename(tmp_path / "moved")
    moved = load(tmp_path / "moved/sim.yaml")
    assert [robot.robot_id for robot in moved.robots] == [robot.robot_id for robot in scenario.robots]
    files = [*moved.population, *(robot.parameters for robot in moved.robots if robot.parameters)]
    assert {path.parent for path in files} == {tmp_path / "moved"}


def test_an_emulated_robot_that_is_started_again_stands_where_it_was(tmp_path: Path) -> None:
    scenario = prepare(load(shipped()["line"]), tmp_path)
    write_emulators(scenario, tmp_path, {0: Pose(1.5, 0.5, 2.0)})
    robot = load_settings(tmp_path / "emulator_0.yaml").robot
    assert (robot.x, robot.y, robot.theta) == (1.5, 0.5, 2.0)
