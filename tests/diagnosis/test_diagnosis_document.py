"""What a diagnosis leaves behind can be read by others: the document field by field, the parameters by a process."""

import json
import math
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.bus.bus import Bus
from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.diagnosis.document import document, extended_file, write_document
from cmr.diagnosis.report import report_of
from cmr.diagnosis.result import UNEXPLAINED, Diagnosis, Fitted
from cmr.diagnosis.summary import summary
from cmr.estimation.unexplained.result import Unexplained
from cmr.model.catalogue import CATALOGUE, definition
from cmr.msg import process_status_t
from cmr.parameters.file import ParameterFileError, load, sha256_of
from cmr.recordings.faults.findings import Finding
from tests.support.made_up_diagnosis import BAD, DIAGNOSIS, REFITTED, TOO_SMALL
from tests.support.project import PROJECT

Seen = Callable[[str, Any], bool]  # channel, message

PATIENCE = 60.0  # s; a machine that is busy may have to compile the model first
# interfaces, section 5: the fields and what they hold; `...` where the content is free.
SCHEMA_1: dict[str, Any] = {
    "schema": 1,
    "robot_id": 4,
    "verdict": "effects_found",
    "baseline": {
        "parameters": {
            "k2_over_k3": {"value": 118.0, "unit": "rad/s^2", "std": 0.8},
            "k1": {"value": 0.054, "unit": "s/rad", "std": 2e-4},
            "base_width": {"value": 0.172, "unit": "m", "std": 6e-4},
        },
        "path_rmse_m": 0.081,
        "held_out_path_rmse_m": 0.093,
    },
    "effects": ...,
    "extended": {"parameters": ..., "path_rmse_m": 0.012, "held_out_path_rmse_m": 0.0141234567},
    "gain": {
        "held_out_path_rmse_ratio": 6.6,
        "ci95": [5.9, None],
        "signals": {"psi": 1.0, "pose": 6.6, "yaw_rate": None},
    },
    "unexplained": {
        "present": True,
        "signal": "yaw_rate",
        "regressors": ["speed"],
        "share_of_residual_variance": 0.2,
    },
}


def written(diagnosis: Diagnosis, folder: Path) -> dict[str, Any]:
    """Return the document as another program reads it: NaN and infinity are no JSON."""
    path = folder / "below" / "diagnosis.json"
    write_document(diagnosis, path)
    content: dict[str, Any] = json.loads(path.read_text(), parse_constant=lambda word: pytest.fail(f"{word} in JSON"))
    assert [entry.name for entry in path.parent.iterdir()] == ["diagnosis.json"]
    return content


def test_the_reference_describes_every_field() -> None:
    page = (PROJECT / "docs/reference/diagnosis_json.md").read_text(encoding="utf-8")
    described = re.findall(r"`([\w.\[\]]+)`", page)
    assert set(document(DIAGNOSIS)) - set(described) == set()


def assert_holds(content: dict[str, Any], expected: dict[str, Any]) -> None:
    for name, value in expected.items():
        if isinstance(value, dict):
            assert_holds(content[name], value)
        elif value is not ...:
            assert content[name] == value, name


def test_the_document_has_every_field_of_schema_1(tmp_path: Path) -> None:
    assert_holds(written(DIAGNOSIS, tmp_path), SCHEMA_1)


def test_effects_stand_in_their_order_with_all_that_is_known_of_them(tmp_path: Path) -> None:
    friction, surface = written(DIAGNOSIS, tmp_path)["effects"]
    assert friction == {
        "name": "coulomb_friction",
        "cause": "Dry friction slows both wheels by 4.1 rad/s^2.",
        "rank": 1,
        "parameters": {
            "coulomb_friction": {
                "value": 4.1,
                "unit": "rad/s^2",
                "std": 0.1,
                "ci95": [pytest.approx(3.904), pytest.approx(4.296)],
            }
        },
        "evidence": {"statistic": 311.0, "p_value": 1e-60, "held_out": 50.5},
        "shift": {"base_width": -0.011, "k1": None},
        "in_file": {},
        "indistinguishable_from": ["quadratic_drag"],
        "next_experiment": "Drive straight at two speeds.",
    }
    assert (surface["rank"], surface["next_experiment"], surface["evidence"]["held_out"]) == (2, None, None)
    assert surface["parameters"]["surface_change_base_width"] == {
        "value": 0.04,
        "unit": "-",
        "std": None,
        "ci95": [None, None],
    }


def test_the_extended_model_tells_what_was_given_and_not_fitted(tmp_path: Path) -> None:
    parameters = written(DIAGNOSIS, tmp_path)["extended"]["parameters"]
    assert parameters["base_width"] == {"value": 0.161, "unit": "m", "std": 5e-4}
    assert parameters["wheel_radius"] == {"value": 0.04, "unit": "m", "std": None}
    assert parameters["turn_rate_limit"]["value"] is None


def test_these_fields_and_no_others_go_beyond_schema_1(tmp_path: Path) -> None:
    content = written(DIAGNOSIS, tmp_path)
    beyond = {"sentence", "notes", "next_experiment", "candidates", "sources", "samples", "generic_term"}
    beyond |= {"command_lateness", "decisions", "nominal", "gain_over_nominal", "not_visible", "against", "laws"}
    assert set(content) - set(SCHEMA_1) - {"data_checks"} == beyond
    assert content["candidates"] == [
        {
            "name": "slope",
            "evidence": {"statistic": 2.0, "p_value": 0.8, "held_out": -1.0},
            "why_not": "Other data speak against it.",
            "parameters": {},
            "too_small_to_matter": False,
            "measure": None,
        },
        {
            "name": "gyro_bias",
            "evidence": {"statistic": 62.2, "p_value": 1e-9, "held_out": 30.5},
            "why_not": TOO_SMALL.sentence,
            "parameters": {"gyro_bias": {"value": 0.0018, "unit": "rad/s", "std": 0.0002}},
            "too_small_to_matter": True,
            "measure": {"quantity": "gyro_bias", "value": 0.0018, "limit": 0.003, "unit": "rad/s"},
        },
    ]


def test_decisions_of_the_search_stand_in_their_order_and_what_was_not_compared_is_null(tmp_path: Path) -> None:
    decisions = written(DIAGNOSIS, tmp_path)["decisions"]
    assert [decision["action"] for decision in decisions] == ["added", "replaced", "not added", "removed", "removed"]
    assert decisions[0] == {
        "step": 0,
        "action": "added",
        "effects": ["slope"],
        "statistic": 40.2,
        "threshold": 30.0,
        "reason": "It explains most.",
        "measures": [],
    }
    assert decisions[-1]["measures"] == [{"quantity": "gyro_bias", "value": 0.0018, "limit": 0.003, "unit": "rad/s"}]
    assert (decisions[1]["effects"], decisions[1]["threshold"]) == (["coulomb_friction", "surface_change"], None)
    assert written(BAD, tmp_path)["decisions"] == []


def test_data_checks_tell_what_each_counted(tmp_path: Path) -> None:
    assert [(entry["check"], entry["found"]) for entry in written(DIAGNOSIS, tmp_path)["data_checks"]] == [
        ("pose_jumps", 0),
        ("pose_outliers", 3),
    ]


def test_a_document_of_bad_data_has_the_same_fields(tmp_path: Path) -> None:
    content = written(BAD, tmp_path)
    assert content.keys() == written(DIAGNOSIS, tmp_path).keys()
    errors = {"path_rmse_m", "held_out_path_rmse_m", "held_out_path_median_m"}
    errors |= {"held_out_heading_rmse_rad", "held_out_heading_median_rad"}
    assert content["baseline"] == content["nominal"] == {"parameters": {}, **dict.fromkeys(errors)}
    assert content["gain"] == {"held_out_path_rmse_ratio": None, "ci95": [None, None], "signals": {}}
    assert content["unexplained"]["present"] is False
    assert content["unexplained"]["not_judged"] is None
    assert content["effects"] == []


def test_numbers_of_numpy_become_numbers(tmp_path: Path) -> None:
    of_numpy: Any = replace(
        DIAGNOSIS,
        samples=np.int64(7),  # type: ignore[arg-type]
        unexplained=Unexplained(present=np.bool_(True), share=np.float64(0.5)),  # type: ignore[arg-type]
        parameters={name: np.float64(value) for name, value in DIAGNOSIS.parameters.items()},
        checks=(Finding("gaps", np.int64(2), "2 gaps."),),  # type: ignore[arg-type]
    )
    content = written(of_numpy, tmp_path)
    assert (content["samples"], content["unexplained"]["present"], content["data_checks"][0]["found"]) == (7, True, 2)
    assert "numpy" not in extended_file(of_numpy, {}).to_yaml()


def test_a_document_that_cannot_be_made_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    path.write_text("old")
    unwritable = replace(DIAGNOSIS, sentence="\ud800")  # half a character, which no encoding has
    with pytest.raises(UnicodeEncodeError):
        write_document(unwritable, path)
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["diagnosis.json"]


# The extended parameters


def test_the_parameter_file_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "robot_4.yaml"
    made = extended_file(DIAGNOSIS, {"log": "circles.lcm squares.lcm", "sha256": "0" * 64})
    made.save(path)
    found = load(path)
    assert (found.robot_id, found.effects) == (4, ("coulomb_friction", "surface_change"))
    assert {name: (value.value, value.std) for name, value in found.values.items()} == {
        "wheel_radius": (0.04, None),
        "k2_over_k3": (118.0, 0.8),
        "k1": (0.054, 2e-4),
        "base_width": (0.161, 5e-4),
        "coulomb_friction": (4.1, 0.1),
        "surface_change_k1": (0.05, 0.004),
        "surface_change_base_width": (0.04, None),
        "surface_change_time": (61.0, 0.3),
    }
    assert found.provenance == {
        "log": "circles.lcm squares.lcm",
        "sha256": "0" * 64,
        "method": "diagnosis",
        "samples": 6000,
        "path_rmse_m": 0.012,
        "held_out_path_rmse_m": 0.014123,
    }
    assert found.robot_parameters.values == {name: value.value for name, value in found.values.items()}


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_effect_of_the_catalogue_can_be_written_and_read_back(name: str, tmp_path: Path) -> None:
    sizes = {parameter.name: float(parameter.typical or 0.0) for parameter in CATALOGUE[name].parameters}
    diagnosis = replace(BAD, parameters={"wheel_radius": 0.04, **sizes})
    path = tmp_path / "robot_4.yaml"
    extended_file(diagnosis, {}).save(path)
    assert load(path).effects == (name,)
    assert document(diagnosis)["extended"]["parameters"][min(sizes)]["unit"] == definition(min(sizes)).unit


def test_without_effects_the_file_is_that_of_the_papers_model() -> None:
    plain = replace(DIAGNOSIS, parameters={name: DIAGNOSIS.parameters[name] for name in ("wheel_radius", "k1")})
    made = extended_file(plain, {})
    assert (made.effects, set(made.values)) == ((), {"wheel_radius", "k1"})


def test_a_path_error_that_is_not_known_is_left_out() -> None:
    fitted = Fitted(estimates=REFITTED, path_rmse=math.nan, held_out_path_rmse=math.nan)
    assert set(extended_file(replace(DIAGNOSIS, extended=fitted), {}).provenance) == {"method", "samples"}


def test_a_size_that_no_robot_can_have_is_refused() -> None:
    impossible = replace(DIAGNOSIS, parameters={**DIAGNOSIS.parameters, "base_width": -1.0})
    with pytest.raises(ParameterFileError, match="base_width"):
        extended_file(impossible, {})


def comes_to_pass(bus: Bus, seen: Seen) -> bool:
    """Listen until `seen(channel, message)` says yes; tell whether it does in time."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if any(seen(received.channel, received.message) for received in bus.receive(0.1)):
            return True
    return False


def moves_with(sha256: str, robot_id: int) -> Seen:
    """Return a function that sees whether cmr-sim uses a file and the robot has moved by it."""
    in_use: list[str] = []

    def seen(channel: str, message: Any) -> bool:
        if channel == "PROCESS_STATUS":
            if message.process == "cmr-sim" and message.state == process_status_t.RUNNING:
                in_use[:] = [message.parameters_sha256]
            return False
        at: Iterable[int] = message.robot_id
        places = dict(zip(at, message.x, strict=True))
        return in_use == [sha256] and places.get(robot_id, 0.0) > 0.05

    return seen


@pytest.mark.slow
@pytest.mark.waits  # a real process, which must not starve
def test_cmr_sim_runs_the_extended_file_as_it_is(url: str, tmp_path: Path) -> None:
    made = extended_file(replace(DIAGNOSIS, verdict=UNEXPLAINED), {"log": "run.lcm"})
    made.save(tmp_path / "robot_4.yaml")
    bus = Bus(url)
    bus.subscribe(WORLD_STATE)
    bus.subscribe(PROCESS_STATUS, every=True)
    command = [str(Path(sys.executable).parent / "cmr-sim"), "--lcm-url", url, "--parameters", str(tmp_path)]
    command += ["--parameters-of", "4", "--virtual", "10=figure_eight,speed=0.4"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        assert comes_to_pass(bus, moves_with(sha256_of(made.to_yaml()), 10)), "robot 10 did not move by the file"
    finally:
        process.kill()
        process.wait()


def test_how_late_commands_took_effect_is_told_in_words_and_in_numbers(tmp_path: Path) -> None:
    (told,) = written(DIAGNOSIS, tmp_path)["command_lateness"]
    assert told["sentence"] == (
        "Commands take effect 11 ms after their stamp, +- 6.0 ms; of 500 that can be judged, 0.2 % never took effect."
    )
    assert (told["source"], told["mean_s"], told["spread_s"], told["lost_share"]) == (
        "circles.lcm",
        0.011,
        0.006,
        0.002,
    )
    assert told["sentence"] in " ".join(summary(DIAGNOSIS).split())
    assert told["sentence"] in report_of(DIAGNOSIS)
