"""The report of cmr accept: JSON, page, terminal; and the command line."""

import json
import math
from html import escape
from pathlib import Path

import pytest

from cmr.cli.errors import CommandError
from robot_driver.acceptance import command
from robot_driver.acceptance.findings import PROMISES, Finding
from robot_driver.acceptance.report import Report
from robot_driver.bringup.known import Known
from robot_driver.settings import parsed_with_settings

REPORT = Report(
    device="USB Roboclaw <2x15a>",
    controller="roboclaw",
    gyro="",
    port="/dev/ttyACM0",
    host="robot",
    kernel="Linux",
    python="3.11",
    cmr="0.1",
    utime=0,
    seconds=60.0,
    short=True,
    duty=0.1,
    figures={"answer_median_ms": 1.5},
    findings=(
        Finding(1, "none lost", True, "all there", {"share": 1.0}),
        Finding(6, "driver killed", False, "no zero came", {"zero_s": math.inf}),
        Finding(10, "by hand", None, "nobody was there"),
    ),
)


def test_the_report_says_for_each_promise_whether_it_held(tmp_path: Path) -> None:
    written = command.write(REPORT, tmp_path)
    assert [path.name for path in written] == ["acceptance.json", "acceptance.html"]
    document = json.loads(written[0].read_text())
    assert [(one["number"], one["verdict"]) for one in document["promises"]] == [
        (1, "passed"),
        (6, "failed"),
        (10, "not tried"),
    ]
    assert document["findings"][1]["values"] == {"zero_s": None}
    assert document["device"] == REPORT.device
    page = written[1].read_text()
    assert "USB Roboclaw &lt;2x15a&gt;" in page
    assert escape(PROMISES[6]) in page
    assert "What was not tried" in page
    assert REPORT.summary == "3 promises: 1 passed, 1 failed, 1 not tried; failed: 6."


def test_without_modules_for_pages_there_is_only_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "has_module", lambda _: False)
    assert [path.name for path in command.write(REPORT, tmp_path)] == ["acceptance.json"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ([], "--port is needed"),
        (["--port", "x", "--duty", "0.3"], "0.01 to 0.2"),
        (["--port", "x", "--promise", "20"], "1 to 19"),
    ],
)
def test_the_command_line_is_refused_with_what_can_be_given(
    arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        command.main(arguments)
    assert reason in capsys.readouterr().err


def test_options_that_bringup_has_written_are_taken_and_others_beside_them_count(tmp_path: Path) -> None:
    path = tmp_path / "robot_0_driver.yaml"
    known = Known({"port": "/dev/motor", "controller": "roboteq", "swap": True, "rate": 50.0}, ["ticks"], {})
    known.save(path)
    arguments = ["--settings", str(path), "--rate", "80"]
    with pytest.raises(CommandError, match="cmr bringup has still to decide ticks"):
        command.main(arguments)
    known.decide("ticks")
    known.save(path)
    options = parsed_with_settings(command.command_parser(), arguments)
    assert (options.port, options.controller, options.swap, options.rate) == ("/dev/motor", "roboteq", True, 80.0)
