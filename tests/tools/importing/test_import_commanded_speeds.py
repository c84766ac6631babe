"""A command that was imported keeps what it was: (v, omega) and wheel speeds have channels of their own."""

from pathlib import Path
from typing import Any

import pytest

from cmr.parameters.file import parse
from cmr.recordings.recording import Recording
from cmr_tools.importing.block import MappingError
from cmr_tools.importing.mapping import load
from tests.tools.importing.import_bench import CSV_HEAD, NOMINAL, POSE, run, write_csv, write_mapping

ROWS = "t,x,y,theta,a,b\n" + "".join(f"{0.1 * k:.1f},{k},0,0,{30.0 + k},-45.0\n" for k in range(5))
VELOCITY = {"v": {"column": "a", "unit": "mm/s"}, "omega": {"column": "b", "unit": "deg/s"}}
WHEELS = {"psi_left": {"column": "a", "unit": "deg/s"}, "psi_right": {"column": "b", "unit": "deg/s", "sign": -1}}


def test_velocities_become_velocity_commands(tmp_path: Path) -> None:
    mapping = {**CSV_HEAD, "velocity_command": VELOCITY, "pose": POSE}
    messages = run(tmp_path, mapping, write_csv(tmp_path, ROWS))
    assert set(messages) == {"PARAMETERS_0", "VELOCITY_COMMAND_0", "POSE_0"}
    told = messages["VELOCITY_COMMAND_0"]
    assert [message.v for message in told] == pytest.approx([0.030, 0.031, 0.032, 0.033, 0.034])
    assert told[0].omega == pytest.approx(-0.7853981634)
    assert Recording.read(tmp_path / "run.lcm").command_kind == "velocity"


def test_wheel_speeds_become_wheel_speed_commands(tmp_path: Path) -> None:
    mapping = {**CSV_HEAD, "wheel_speed_command": WHEELS, "pose": POSE}
    told = run(tmp_path, mapping, write_csv(tmp_path, ROWS))["WHEEL_SPEED_COMMAND_0"]
    assert told[0].psi_left == pytest.approx(0.5235987756)
    assert told[0].psi_right == pytest.approx(0.7853981634)


def test_nominal_parameters_may_be_those_of_a_velocity_controller(tmp_path: Path) -> None:
    nominal = {**NOMINAL, "response_time": 0.3, "top_wheel_speed": 20.0}
    mapping = {**CSV_HEAD, "nominal": nominal, "velocity_command": VELOCITY, "pose": POSE}
    announced = run(tmp_path, mapping, write_csv(tmp_path, ROWS))["PARAMETERS_0"][0]
    assert parse(announced.yaml).has_velocity_controller


def test_a_robot_takes_one_kind_of_command(tmp_path: Path) -> None:
    both: dict[str, Any] = {**CSV_HEAD, "velocity_command": VELOCITY, "wheel_speed_command": WHEELS, "pose": POSE}
    with pytest.raises(MappingError, match="one kind of command, not wheel_speed_command and velocity_command"):
        load(write_mapping(tmp_path, both))


def test_what_a_command_of_speeds_lacks_is_named(tmp_path: Path) -> None:
    half: dict[str, Any] = {**CSV_HEAD, "velocity_command": {"v": VELOCITY["v"]}, "pose": POSE}
    with pytest.raises(MappingError, match="omega"):
        load(write_mapping(tmp_path, half))
