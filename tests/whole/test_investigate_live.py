"""cmr demo --investigate in real time: an emulated robot, driver, simulator, page and cmr-investigate on a bus."""

import json
from pathlib import Path

import pytest

from cmr.msg import investigation_status_t, process_status_t
from cmr.parameters.file import load
from cmr.recordings.events import LogReader
from tests.support.demo import demonstrated
from tests.whole.test_demo import processes_naming

# CI drives the same in simulated time (tests/investigation/test_command.py).
pytestmark = [pytest.mark.real_time, pytest.mark.further]

PATIENCE = 600.0  # s, with the diagnosis of the whole drive
HIDDEN = "wheel_radius_asymmetry"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of a demonstration, and what it said."""
    folder = tmp_path_factory.mktemp("demo") / "run"
    output = demonstrated(folder, "--investigate", "--seconds", "12", patience=PATIENCE)
    return folder, output


def test_what_is_hidden_is_named_and_written_with_its_story(run: tuple[Path, str]) -> None:
    folder, output = run
    found = folder / "found"
    story = json.loads((found / "investigation.json").read_text())
    assert story["named"] == [HIDDEN], output
    assert HIDDEN in load(found / "robot_0.yaml").effects
    assert HIDDEN in (found / "investigation.html").read_text()
    assert f"Hidden in the robot: {HIDDEN}." in output


def test_what_was_left_at_each_decision_is_on_the_bus_and_the_robot_keeps_to_its_floor(run: tuple[Path, str]) -> None:
    folder, _ = run
    messages = [received.message for received in LogReader(folder / "run.lcm")]
    reports = [message for message in messages if isinstance(message, investigation_status_t)]
    assert {report.state for report in reports} >= {investigation_status_t.OPENING, investigation_status_t.DRIVING}
    assert reports[-1].state == investigation_status_t.DONE
    assert json.loads(reports[-1].named) == [HIDDEN]
    assert any(report.members > 1 for report in reports)
    for report in reports:
        assert all(abs(place) <= 1.0 for place in (*report.x, *report.y))
    names = {message.process for message in messages if isinstance(message, process_status_t)}
    assert {"cmr-driver", "cmr-sim", "cmr-emulate", "cmr-view", "cmr-investigate"} <= names


def test_nothing_is_left_running(run: tuple[Path, str]) -> None:
    assert processes_naming(run[0]) == []
