"""A robot that is compared with its parameter file: what departs from the file is named, and nothing else."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from cmr.cli.errors import CommandError
from cmr.commands.diagnose import main
from cmr.diagnosis.against_file import LEAST_SHARE
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import document, extended_file
from cmr.diagnosis.job import Job, JobError, perform
from cmr.diagnosis.report import report_of
from cmr.diagnosis.result import EFFECTS_FOUND, NO_EFFECT, PARAMETERS_DIFFER, Against, Diagnosis
from cmr.diagnosis.summary import summary
from cmr.model.catalogue import effects_on
from cmr.parameters.file import ParameterFile, Value, sha256_of
from tests.hidden_effects.hiding import HiddenRecording, hidden_recording
from tests.hidden_effects.logs import write_log

AGAINST = Against(source="robots/robot_0.yaml", sha256="0123456789ab" + "0" * 52)


@cache
def robot() -> HiddenRecording:
    """Return the recording of a robot with two effects, and what they are."""
    return hidden_recording("coulomb_friction", "gyro_scale", seed=3)


def file_with(**others: float) -> ParameterFile:
    """Return the robot's own file, in which some values are others."""
    truth = robot().truth
    values = {**truth.robot, **truth.parameters, **others}
    effects = tuple(effect.name for effect in effects_on({name: values[name] for name in truth.parameters}))
    return ParameterFile(0, {name: Value(value) for name, value in values.items()}, effects)


@cache
def compared(**others: float) -> Diagnosis:
    return diagnose(robot().recording, file_with(**others), against=AGAINST)


@pytest.mark.slow
@pytest.mark.further  # test_export.py proves an exported robot so
def test_the_robot_of_the_file_departs_in_nothing_and_is_delivered_as_the_file_has_it() -> None:
    found = compared()
    assert found.verdict == NO_EFFECT
    assert found.gain is not None
    assert found.gain.ratio == 1.0
    assert found.extended == found.baseline
    written = extended_file(found, {})
    assert {name: one.value for name, one in written.values.items()} == {
        name: one.value for name, one in file_with().values.items()
    }
    assert set(written.effects) == {"coulomb_friction", "gyro_scale"}


@pytest.mark.further  # one that the file lacks is named
@pytest.mark.slow
def test_an_effect_of_the_file_that_has_another_size_is_named_with_both() -> None:
    true = robot().truth.parameters["coulomb_friction"]
    found = compared(coulomb_friction=1.8 * true)
    assert (found.verdict, [effect.name for effect in found.effects]) == (EFFECTS_FOUND, ["coulomb_friction"])
    (friction,) = found.effects
    estimate = friction.estimates["coulomb_friction"]
    assert abs(estimate.value - true) < 4.0 * estimate.std
    assert friction.given == {"coulomb_friction": 1.8 * true}
    assert f"in the file {1.8 * true:.2g}" in friction.cause
    assert found.gain is not None
    assert found.gain.ratio > 1.2
    content = document(found)
    assert content["effects"][0]["in_file"] == {"coulomb_friction": 1.8 * true}
    assert content["against"]["sha256"] == AGAINST.sha256
    assert content["against"]["effects"] == ["coulomb_friction", "gyro_scale"]
    for text in (summary(found), report_of(found)):
        assert "robot_0.yaml" in text
        assert "paper's model, fitted" not in text
    assert AGAINST.sha256 in report_of(found)


@pytest.mark.slow
def test_an_effect_that_the_file_lacks_is_named_alone() -> None:
    truth = robot().truth
    values = {name: Value(value) for name, value in {**truth.robot, **truth.parameters}.items() if name != "gyro_scale"}
    found = diagnose(robot().recording, ParameterFile(0, values, ("coulomb_friction",)), against=AGAINST)
    assert [effect.name for effect in found.effects] == ["gyro_scale"]
    assert found.effects[0].given == {}
    assert document(found)["effects"][0]["in_file"] == {}


@pytest.mark.further  # an effect that departs is said in the same way
@pytest.mark.slow
def test_a_parameter_of_the_paper_that_is_another_is_said() -> None:
    true = robot().truth.robot["base_width"]
    found = compared(base_width=(1.0 + 3.0 * LEAST_SHARE) * true)
    assert (found.verdict, found.effects) == (PARAMETERS_DIFFER, ())
    assert found.against is not None
    (departure,) = found.against.departures
    assert departure.name == "base_width"
    assert departure.estimate.value == pytest.approx(true, rel=0.5 * LEAST_SHARE)
    assert "base_width" in found.sentence
    (written,) = document(found)["against"]["departures"]
    assert written["in_file"] == departure.given


def test_the_file_of_another_robot_is_refused(tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.lcm", robot().recording)
    other = replace(file_with(), robot_id=3)
    job = Job(logs=(log,), robot_id=None, folder=tmp_path / "out", nominal=other, against=AGAINST)
    with pytest.raises(JobError, match="is of robot 3, the log of robot 0"):
        perform(job, lambda _sentence: None)


def test_files_that_say_too_little_or_what_nobody_knows_are_refused(tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.lcm", robot().recording)
    given = [str(log), "--out", str(tmp_path / "out"), "--against"]
    with pytest.raises(CommandError, match=r"missing\.yaml"):
        main([*given, str(tmp_path / "missing.yaml")])
    path = tmp_path / "robot_0.yaml"
    path.write_text(file_with().to_yaml().replace("[coulomb_friction", "[levitation, coulomb_friction"))
    with pytest.raises(CommandError, match=r"unknown effect .*levitation"):
        main([*given, str(path)])
    ParameterFile(0, {"wheel_radius": Value(0.04)}).save(path)
    with pytest.raises(CommandError, match="is missing"):
        main([*given, str(path)])


def test_a_file_goes_with_no_other_parameters_and_with_no_live_drive(capsys: pytest.CaptureFixture[str]) -> None:
    for options in (["run.lcm", "--out", "out", "--parameters", "robot_0.yaml"], ["--live"]):
        with pytest.raises(SystemExit):
            main([*options, "--against", "robot_0.yaml"])
        assert "--against" in capsys.readouterr().err


def test_the_digest_is_that_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"
    file_with().save(path)
    assert sha256_of(path.read_text()) == sha256_of(file_with().to_yaml())
