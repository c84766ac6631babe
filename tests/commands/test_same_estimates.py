"""cmr-calibrate and cmr-diagnose give the same estimates for the same log: each from the log file to its numbers."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from cmr.cli.errors import CommandError
from cmr.commands.calibrate import main as calibrate
from cmr.commands.diagnose import main as diagnose
from cmr.commands.first_use import ESTIMATOR, compile_first
from cmr.estimation.estimates import EstimationError
from cmr.recordings.recording import Recording
from tests.hidden_effects.logs import write_log
from tests.hidden_effects.messy import messy
from tests.support.faulty_drive import later
from tests.support.lanes import further
from tests.support.resting import one_after_another, with_rests

pytestmark = pytest.mark.slow

SAME = 1e-9  # standard deviations, of what is estimated from the same data
CLOSE = 0.1  # of what is not: a live calibration, and so one from a log, ends after one second of rest
NAMES = ("k2_over_k3", "k1", "base_width")


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Compile beforehand what the commands would compile: no test is about that."""
    compile_first([ESTIMATOR], lambda _text: None)


def at_rest_for_long() -> Recording:
    """Return figure-eights of a robot with six imperfections, which rests for half a minute before and after."""
    return with_rests(messy(0, "two60").recording, 30.0, 25.0)


def in_motion() -> Recording:
    """Return the middle of such a drive: it begins and ends while the robot moves."""
    whole = messy(4, "two60").recording
    begin = int(whole.wheels.utime[0])
    return whole.between(begin + 8_000_000, begin + 52_000_000)


def two_drives() -> Recording:
    """Return two drives of a robot, with rests before, between and after them, as in the log of cmr-demo."""
    drives = [messy(5, "two60", drive=number).recording for number in (0, 1)]
    return one_after_another([with_rests(drives[0], 20.0, 6.0), with_rests(drives[1], 0.0, 8.0)], 0.02)


@pytest.mark.parametrize(
    ("driven", "options", "limit"),
    [*further((at_rest_for_long, (), CLOSE), (two_drives, ("--whole-log",), SAME)), (in_motion, (), SAME)],
    ids=["at rest for long", "two drives", "in motion"],
)
def test_both_commands_give_the_same_estimates(
    driven: Callable[[], Recording],
    options: Sequence[str],
    limit: float,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = write_log(tmp_path / "run.lcm", driven())
    assert calibrate([str(log), "--json", *options]) == 0
    calibrated: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert diagnose([str(log), "--no-report", "--out", str(tmp_path / "diagnosis")]) == 0
    diagnosed = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())["extended"]["parameters"]
    for name in NAMES:
        value, std = calibrated["parameters"][name], calibrated["std"][name]
        assert abs(diagnosed[name]["value"] - value) <= limit * std, name
        assert diagnosed[name]["std"] == pytest.approx(std, rel=limit), name


def test_of_two_drives_the_first_is_used_and_how_to_use_both_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds: list[float] = []

    def looked_at(recordings: Sequence[Recording], *_nominal: object, **_options: object) -> None:
        seconds.append(float(recordings[0].wheels.seconds[-1]))
        raise EstimationError("That is enough.")

    monkeypatch.setattr("cmr.commands.calibrate.calibrate", looked_at)
    log = write_log(tmp_path / "run.lcm", two_drives())
    for options in ((), ("--whole-log",)):
        with pytest.raises(CommandError, match="enough"):
            calibrate([str(log), *options])
    said = capsys.readouterr().out
    assert said.count("the first drive is used, as in a live calibration") == 1
    assert "--whole-log" in said
    assert seconds[0] < 80.0 < 150.0 < seconds[1]


def test_a_live_calibration_has_no_whole_log(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as wrong:
        calibrate(["--whole-log"])
    assert wrong.value.code == 2
    assert "--whole-log needs a log" in capsys.readouterr().err


@pytest.mark.further  # tests/recordings/test_lags.py finds such lags
def test_poses_of_a_clock_that_is_an_hour_ahead_are_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "run.lcm", later(with_rests(messy(6, "two60").recording, 4.0, 6.0), "poses", 3600.0))
    assert calibrate(["--log", str(log), "--json"]) == 0
    said = capsys.readouterr()
    assert "few poses are stamped within its first drive; all of it is used." in said.err
    assert json.loads(said.out)["path_rmse_after_m"] < 0.05
