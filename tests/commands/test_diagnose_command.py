"""cmr-diagnose: from logs to files; whatever goes wrong is told in a sentence."""

import json
import math
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cmr.bus.bus import Bus
from cmr.bus.messages import now_utime
from cmr.bus.streams import MOTOR_FEEDBACK, PARAMETERS, PROCESS_STATUS
from cmr.cli.command_line import guarded
from cmr.commands.diagnose import main
from cmr.commands.first_use import ESTIMATOR, compile_first
from cmr.diagnosis.job import Job, Telling, attempt
from cmr.diagnosis.result import EFFECTS_FOUND, Diagnosis
from cmr.diagnosis.summary import summary
from cmr.estimation.estimates import EstimationError
from cmr.parameters.file import ParameterFile, load
from cmr.recordings.recording import Recording
from tests.hidden_effects import hide
from tests.hidden_effects.cases import BEGINNING
from tests.support.emulated_drive import NOMINAL, messages
from tests.support.logs_of_robots import write_logs
from tests.support.made_up_diagnosis import BAD, DIAGNOSIS
from tests.support.typed_messages import all_of

PATIENCE = 60.0  # s until something that must happen is given up
WIDEST = 120  # characters of a terminal


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Compile beforehand what the command would compile: no test is about that."""
    compile_first([ESTIMATOR], lambda _text: None)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_logs(tmp_path_factory.mktemp("logs"))


@dataclass
class Engine:
    """Stands in for the engine: keeps what it was asked, and says what it is told to."""

    says: Diagnosis = DIAGNOSIS
    error: Exception | None = None
    recordings: Sequence[Recording] = ()
    nominal: ParameterFile | None = None
    asked: dict[str, Any] = field(default_factory=dict)

    def __call__(
        self, recordings: Sequence[Recording], nominal: ParameterFile | None, *, progress: Telling, **asked: Any
    ) -> Diagnosis:
        progress("Fitting the paper's model.")
        self.recordings, self.nominal, self.asked = recordings, nominal, asked
        if self.error:
            raise self.error
        return replace(self.says, robot_id=recordings[0].robot_id, sources=asked["sources"])


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Engine:
    """The engine and the report's writer that all commands of a test use."""
    stand_in = Engine()
    monkeypatch.setattr("cmr.diagnosis.diagnose.diagnose", stand_in)
    report = SimpleNamespace(write_report=lambda diagnosis, path: path.write_text(f"<p>{diagnosis.sentence}</p>"))
    monkeypatch.setitem(sys.modules, "cmr.diagnosis.report", report)
    return stand_in


def run(*arguments: object) -> int:
    """Run the command in this process, as `guarded` does: expected errors become one line on stderr."""
    return guarded(main, [str(argument) for argument in arguments])


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# One robot


@pytest.mark.slow
@pytest.mark.usefixtures("engine")
def test_one_log_gives_the_three_files_and_says_what_was_found(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "diagnosis"
    assert run(logs / "a.lcm", "--out", out) == 0
    assert files(out) == ["diagnosis.json", "report.html", "robot_0.yaml"]
    assert json.loads((out / "diagnosis.json").read_text())["verdict"] == "effects_found"
    assert (out / "report.html").read_text() == f"<p>{DIAGNOSIS.sentence}</p>"
    assert load(out / "robot_0.yaml").effects == ("coulomb_friction", "surface_change")
    said = capsys.readouterr()
    assert said.err == ""
    lines = said.out.splitlines()
    assert lines[0] == f"Robot 0: {DIAGNOSIS.sentence}"
    assert max(map(len, lines[:-1])) <= WIDEST
    assert re.search(r"1\. coulomb_friction +4\.1 +0\.1 +rad/s\^2 +311\.0 \(p = 1e-60\)", said.out)
    assert "Dry friction slows both wheels by 4.1 rad/s^2." in said.out
    assert "cannot distinguish it from quadratic_drag" in said.out
    assert "0.0930 m with the paper's model, 0.0141 m with the effects, smaller by a factor of 6.60" in " ".join(
        said.out.split()
    )
    assert "\n\nSeen, but too small to matter: gyro_bias 0.0018 rad/s.\n\n" in said.out
    assert "3 poses cannot be true: set aside." in said.out
    assert (
        "20 % of the variance of the one-step prediction errors of the yaw rate is predicted by speed, on left-out data"
        in " ".join(said.out.split())
    )
    assert said.out.count("Next: Drive straight at two speeds.") == 1
    assert lines[-1] == f"written to {out}: diagnosis.json, robot_0.yaml, report.html"


@pytest.mark.parametrize(
    ("ratio", "words"), [(1.0, "unchanged: a ratio of 1.00"), (0.8, "not smaller: a ratio of 0.80")]
)
def test_effects_that_gain_nothing_on_the_path_are_not_said_to(ratio: float, words: str) -> None:
    assert DIAGNOSIS.gain is not None
    assert words in " ".join(summary(replace(DIAGNOSIS, gain=replace(DIAGNOSIS.gain, ratio=ratio))).split())


def test_several_logs_of_one_robot_are_diagnosed_together(engine: Engine, logs: Path, tmp_path: Path) -> None:
    nominal = replace(NOMINAL, robot_id=0)
    nominal.save(tmp_path / "nominal.yaml")
    arguments = [logs / "a.lcm", logs / "b.lcm", "--held-out", logs / "c.lcm", "--out", tmp_path / "out"]
    assert run(*arguments, "--robot", 0, "--parameters", tmp_path / "nominal.yaml") == 0
    assert [len(recording.poses) for recording in engine.recordings] == [250, 250]
    assert [recording.robot_id for recording in engine.asked["held_out"]] == [0]
    assert engine.asked["sources"] == [str(logs / "a.lcm"), str(logs / "b.lcm")]
    assert engine.asked["held_out_sources"] == [str(logs / "c.lcm")]
    assert engine.nominal is not None
    assert engine.nominal.values == nominal.values
    provenance = load(tmp_path / "out" / "robot_0.yaml").provenance
    assert provenance["log"] == f"{logs / 'a.lcm'} {logs / 'b.lcm'}"
    assert provenance["held_out_log"] == str(logs / "c.lcm")
    assert re.fullmatch("[0-9a-f]{64}", str(provenance["sha256"]))


def test_the_robot_asked_for_is_the_one_that_is_diagnosed(engine: Engine, logs: Path, tmp_path: Path) -> None:
    assert run(logs / "c.lcm", "--robot", 3, "--out", tmp_path) == 0
    assert files(tmp_path) == ["diagnosis.json", "report.html", "robot_3.yaml"]
    assert [recording.robot_id for recording in engine.recordings] == [3]


@pytest.mark.usefixtures("engine")
def test_without_a_report_there_is_none(logs: Path, tmp_path: Path) -> None:
    assert run(logs / "a.lcm", "--out", tmp_path, "--no-report") == 0
    assert files(tmp_path) == ["diagnosis.json", "robot_0.yaml"]


def test_bad_data_are_a_verdict_and_not_a_failure(
    engine: Engine, logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.says = BAD
    assert run(logs / "a.lcm", "--out", tmp_path) == 0
    assert files(tmp_path) == ["diagnosis.json", "report.html"]
    said = capsys.readouterr().out
    assert "Robot 0: The robot never moved." in said
    assert "robot_0.yaml" not in said


def test_a_log_that_breaks_off_is_diagnosed_as_far_as_it_goes(engine: Engine, logs: Path, tmp_path: Path) -> None:
    whole = (logs / "a.lcm").read_bytes()
    (tmp_path / "cut.lcm").write_bytes(whole[: len(whole) // 2])
    assert run(tmp_path / "cut.lcm", "--out", tmp_path / "out") == 0
    assert 100 < len(engine.recordings[0].poses) < 150


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["none.lcm"], "none.lcm: is empty. Was lcm-logger on the robot's bus"),
        (["none.lcm", "--robot", "0"], "none.lcm: is empty."),
        (["missing.lcm"], "missing.lcm: cannot be opened: No such file or directory"),
        (["garbage.lcm"], "garbage.lcm: no MOTOR_FEEDBACK_N or POSE_N in it"),
        (["folder.lcm"], "folder.lcm: cannot be opened: Is a directory"),
        (["a.lcm", "--robot", "7"], "a.lcm: nothing measured of robot 7; it has [0]"),
        (["a.lcm", "--held-out", "d.lcm"], "d.lcm: cannot be held out: it has robots [3], none of which is diagnosed"),
        (["a.lcm", "--parameters", "missing.yaml"], "missing.yaml: cannot be read"),
    ],
)
def test_what_cannot_be_diagnosed_is_told_in_one_line(
    logs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    sentence: str,
) -> None:
    (logs / "garbage.lcm").write_bytes(bytes(range(256)) * 40)
    (logs / "folder.lcm").mkdir(exist_ok=True)
    monkeypatch.chdir(logs)
    assert run(*arguments, "--out", tmp_path) == 1
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert sentence in said.err


def test_what_the_engine_refuses_is_told_in_one_line(
    engine: Engine, logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    engine.error = EstimationError("wheel_radius is not known. Name a file with --parameters.")
    assert run(logs / "a.lcm", "--out", tmp_path) == 1
    assert capsys.readouterr().err.endswith(": wheel_radius is not known. Name a file with --parameters.\n")


def test_a_folder_that_cannot_be_written_is_told_before_the_work(
    engine: Engine, logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert run(logs / "a.lcm", "--out", tmp_path / "file") == 1
    assert re.search(
        r"file: cannot be written: it is a file, not a folder\. Choose another place with --out\.$",
        capsys.readouterr().err,
    )
    assert not engine.asked


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "name at least one event log, or --live"),
        (["a.lcm"], "--out DIR is missing"),
        (["a.lcm", "b.lcm", "./a.lcm", "--out", "o"], "a.lcm is named twice"),
        (["a.lcm", "--held-out", "./a.lcm", "--out", "o"], "a.lcm cannot be fitted and held out at once"),
        (["a.lcm", "--live"], "--live listens to the bus; it takes no logs"),
        (["a.lcm", "--out", "o", "--jobs", "0"], "'0' is not a whole number of 1 or more"),
        (["a.lcm", "--out", "o", "--robot", "-1"], "a robot id is a whole number"),
    ],
)
def test_wrong_usage_exits_with_2(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err


def test_whatever_goes_wrong_in_a_job_is_told(engine: Engine, logs: Path, tmp_path: Path) -> None:
    job = Job(logs=(logs / "a.lcm",), robot_id=None, folder=tmp_path)
    engine.error = ZeroDivisionError("float division by zero")
    failure = attempt(job, lambda _sentence: None).failure
    assert failure.startswith("unexpected ZeroDivisionError: float division by zero. Diagnose ")
    engine.error = None
    done = attempt(job, lambda _sentence: None)
    assert (done.verdict, done.effects, done.ratio) == (EFFECTS_FOUND, ("coulomb_friction", "surface_change"), 6.6)


# Live


class Listener:
    """The bus, on which a robot gives feedback, and what cmr-diagnose says there."""

    def __init__(self, url: str) -> None:
        self.bus = Bus(url)
        self.bus.subscribe(PROCESS_STATUS, every=True)
        self.heard = ""

    def until(self, words: str, *parameters: ParameterFile) -> None:
        """Give feedback and announce parameters until the words are said."""
        deadline = time.monotonic() + PATIENCE
        while words not in self.heard:
            assert time.monotonic() < deadline, f"heard: {self.heard}"
            drive = [message for channel, message in messages(seconds=0.1) if channel == "MOTOR_FEEDBACK_0"]
            drive[0].utime = drive[0].received_utime = drive[0].applied_utime = now_utime()
            self.bus.publish(MOTOR_FEEDBACK, drive[0], 0)
            for announced in parameters:
                self.bus.publish(PARAMETERS, announced.announcement(sequence=now_utime()), 0)
            statuses = all_of(PROCESS_STATUS, self.bus.receive(0.1))
            said = [status.message for status in statuses if status.process == "cmr-diagnose"]
            self.heard = said[-1] if said else self.heard


@pytest.mark.slow
def test_live_says_what_it_waits_for_and_what_is_new(url: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    script = "import sys; sys.argv[0] = 'cmr-diagnose'; from cmr.commands import run; run('cmr.commands.diagnose')"
    start = [sys.executable, "-c", script, "--live", "--lcm-url", url, "--out", str(out)]
    process = subprocess.Popen(start, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        listener = Listener(url)
        listener.until("Robot 0: its parameters are missing")
        listener.until("Robot 0: learning how it moves", NOMINAL)
        listener.until("The parameters have changed", replace(NOMINAL, provenance={"method": "by hand"}))
        assert listener.heard == "Robot 0: The parameters have changed: monitoring starts again."
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=PATIENCE)
        assert process.returncode == 130
    finally:
        process.kill()
        process.wait()
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ Robot 0: The parameters have changed: .*\n", said)
    assert (out / "live.txt").read_text() == said


# The real engine


@pytest.mark.slow
def test_friction_hidden_in_a_log_is_named_by_the_command(tmp_path: Path) -> None:
    log = hide("coulomb_friction", path=tmp_path / "run.lcm", manoeuvre=BEGINNING, seed=1)
    assert run(log.path, "--out", tmp_path / "out", "--no-report") == 0
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert (content["verdict"], content["effects"][0]["name"]) == ("effects_found", "coulomb_friction")
    found = load(tmp_path / "out" / "robot_0.yaml")
    assert "coulomb_friction" in found.effects
    found_size, true_size = found.values["coulomb_friction"], log.truth.parameters["coulomb_friction"]
    assert found_size.std is not None
    assert math.isclose(found_size.value, true_size, rel_tol=0.05, abs_tol=3.0 * found_size.std)
