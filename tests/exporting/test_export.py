"""What cmr-export writes, says and refuses."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from cmr.cli.errors import CommandError
from cmr.exporting import export as exporting
from cmr.exporting.c_statements import NoCounterpartError, c_lines
from cmr.exporting.carried import BY_TARGET, MJCF, SDF, TARGETS, URDF, Carry, carried, of_robot, table
from cmr.exporting.command import main
from cmr.exporting.diff_drive import Described, calibrated, described, ros2_control, turned_before
from cmr.exporting.gazebo import sdf
from cmr.exporting.proof import check_provable
from cmr.exporting.python_file import python_file
from cmr.exporting.robot import ExportedRobot
from cmr.model.body import turn
from cmr.model.catalogue import CATALOGUE, with_effects
from cmr.model.extended.program import program_of
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import VelocityController
from cmr.parameters.file import ParameterFile, Value
from tests.exporting.exported_robots import PAPER, SPEEDS, module_of, robot_with
from tests.support.documentation_blocks import DOCS


def saved(folder: Path, **effects: float) -> Path:
    """Write the parameter file of a robot with these parameters of effects, each named after its effect."""
    values = dict(zip(("wheel_radius", "k2_over_k3", "k1", "base_width"), PAPER, strict=True)) | effects
    path = folder / "robot_4.yaml"
    ParameterFile(4, {name: Value(value) for name, value in values.items()}, tuple(effects)).save(path)
    return path


@pytest.mark.parametrize("target", TARGETS)
def test_a_target_is_written_and_what_it_carries_is_said(
    target: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robot = saved(tmp_path, deadband=0.08, wheel_radius_asymmetry=0.01)
    assert main([str(robot), "--to", target]) == 0
    said = capsys.readouterr().out
    [written] = [path for path in tmp_path.iterdir() if path != robot]
    assert written.stat().st_size > 0
    assert f"written: {written.name}" in said
    assert {"deadband", "wheel_radius_asymmetry"} <= {word.strip(":") for word in said.split()}


def test_programs_read_what_is_carried(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, out = saved(tmp_path, deadband=0.08, coulomb_friction=4.0), tmp_path / "robot.xml"
    assert main([str(robot), "--to", "mjcf", "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {name: one["carried"] for name, one in said["effects"].items()} == {
        "deadband": "not",
        "coulomb_friction": "approximately",
    }
    assert said["file"] == str(out)


@pytest.mark.slow
def test_a_proof_is_a_page_beside_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, out = saved(tmp_path, coulomb_friction=4.0), tmp_path / "robot.py"
    assert main([str(robot), "--to", "python", "--out", str(out), "--prove"]) == 0
    said = capsys.readouterr().out
    assert "drives the same path" in said
    assert "Diagnosed as if it were a real robot: The robot is that of robot_4.yaml" in said
    page = (tmp_path / "robot.py.html").read_text()
    assert "coulomb_friction" in page
    assert "drives the same path" in page
    assert "nothing that departs from it" in page


@pytest.mark.slow
@pytest.mark.further  # test_mjcf.py has what is lost, and the test before this a proof
def test_what_a_target_does_not_carry_departs_from_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mujoco")
    robot, out = saved(tmp_path, turn_slip=0.15), tmp_path / "robot.xml"
    main([str(robot), "--to", "mjcf", "--out", str(out), "--prove", "--json"])
    assert json.loads(capsys.readouterr().out)["proof"]["diagnosis"]["departing"] == ["turn_slip"]
    assert "not carried" in (tmp_path / "robot.xml.html").read_text()


def test_what_cannot_be_run_is_not_proven() -> None:
    with pytest.raises(CommandError, match="python, fmu, mjcf can"):
        check_provable(URDF)


def test_without_a_compiler_the_unit_has_sources_and_the_command_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    [remark] = exporting.export(robot_with(()), "fmu", tmp_path / "robot.fmu")
    assert "apt install gcc" in remark
    assert (tmp_path / "robot.fmu").exists()


def test_every_effect_has_a_word_for_every_target() -> None:
    for target in TARGETS:
        for effect in CATALOGUE.values():
            assert carried(target, effect).why
    assert all(names <= CATALOGUE.keys() for names in (known.keys() for known in BY_TARGET.values()))


def test_readings_that_are_younger_than_their_stamps_are_not_carried() -> None:
    early = ExportedRobot(0, RobotParameters(*PAPER, effects={"gyro_latency": -0.02, "pose_latency": 0.04}))
    found = of_robot("python", early)
    assert (found["gyro_latency"].how, found["pose_latency"].how) == (Carry.NOT, Carry.EXACTLY)
    slow = ExportedRobot(0, RobotParameters(*PAPER, effects={"clock_skew": -1e-3}))
    assert of_robot("fmu", slow)["clock_skew"].how is Carry.NOT


def test_the_documentation_has_the_tables_of_what_is_carried() -> None:
    page = (DOCS / "how_to" / "take_it_home.md").read_text(encoding="utf-8")
    for target in BY_TARGET:
        assert table(target) in page, target


def test_a_program_has_the_effects_that_are_on_and_no_others() -> None:
    program = program_of(RobotParameters(*PAPER, effects={"deadband": 0.0, "backlash": 0.1}))
    assert [effect.name for effect in program.effects] == ["backlash"]
    assert program.memory == ("backlash_gap_left", "backlash_gap_right")
    assert "deadband" not in program.constants


def test_late_wheels_gyro_and_poses_show_what_was() -> None:
    robot = ExportedRobot(
        0, RobotParameters(*PAPER, effects={"wheel_speed_latency": 0.1, "gyro_latency": 0.05, "pose_latency": 0.2})
    )
    one = module_of(robot).Robot()
    one.command(0.5, 0.3)
    history = []
    for _ in range(200):
        one.step(0.01)
        history.append((one.angle_left, one.yaw_rate, one.x))
    readings = one.read()
    assert readings.angle_left == pytest.approx(history[-11][0], abs=1e-9)
    assert readings.yaw_rate == pytest.approx(history[-6][1], abs=1e-9)
    assert readings.x == pytest.approx(history[-21][2], abs=1e-9)


def test_the_python_file_needs_nothing_but_python() -> None:
    text = python_file(robot_with(("command_loss", "surface_patch", "encoder_quantisation", "pose_smoothing")))
    imported = {line.split()[1] for line in text.splitlines() if line.startswith(("import ", "from "))}
    assert imported == {"bisect", "math", "operator", "typing"}


def test_a_velocity_is_turned_into_duties_as_the_robot_does() -> None:
    controller = VelocityController(0.033, 0.16, 6.67)
    one = module_of(ExportedRobot(0, SPEEDS, controller)).Robot()
    one.command_body(0.1, 0.5)
    assert one._command == pytest.approx(controller.duties_of_body(0.1, 0.5))


def test_c_refuses_what_it_has_no_counterpart_for() -> None:
    assert c_lines(["a, b = b, a ** 2"])[1].strip() == "double to_a = b;"
    for line in ("x = unknown(1.0)", "x = [1.0]", "if a: x = 1.0", "x = a < b < c", "x = a and b"):
        with pytest.raises(NoCounterpartError):
            c_lines([line])


@pytest.mark.parametrize(("separation", "radius"), [(0.2, 0.04), (0.161, 0.05), (0.15, 0.033)])
def test_after_the_paste_a_turn_is_as_large_as_commanded(separation: float, radius: float) -> None:
    robot = ExportedRobot(0, RobotParameters(*PAPER, effects={"wheel_radius_scale": 0.02}))
    said = Described(separation, radius)
    values: Any = yaml.safe_load(ros2_control(robot, said))["diff_drive_controller"]["ros__parameters"]
    counted_separation = values["wheel_separation"] * values["wheel_separation_multiplier"]
    counted_radius = values["wheel_radius"] * values["left_wheel_radius_multiplier"]
    moved = RobotParameters(*PAPER)._replace(wheel_radius=PAPER[0] * 1.02)

    def turned(width: float, wheel_radius: float) -> float:
        difference = 2.0 * math.pi * width / wheel_radius  # by which the controller turns its right wheel further
        return math.degrees(turn(0.0, difference, moved))

    assert turned(counted_separation, counted_radius) == pytest.approx(360.0, rel=1e-4)
    assert turned(separation, radius) == pytest.approx(turned_before(robot, said))


def test_wheels_that_do_not_reach_the_commanded_speed_are_said() -> None:
    slow = SPEEDS._replace(k1=SPEEDS.k1 / 0.97)
    controller = VelocityController(0.033, 0.16, 6.67)
    said = Described(0.16, 0.033)
    assert "97.0% of the speed" in ros2_control(ExportedRobot(0, slow, controller), said)
    assert "% of the speed" not in ros2_control(ExportedRobot(0, SPEEDS, controller), said)


def test_limits_are_those_of_the_robot() -> None:
    known = calibrated(ExportedRobot(0, RobotParameters(*PAPER, effects={"saturation": 0.5, "turn_rate_limit": 2.0})))
    assert known.speed == pytest.approx(0.5 * PAPER[0] / PAPER[2])
    assert known.turn_rate == 2.0
    assert known.acceleration == pytest.approx(0.5 * PAPER[0] * PAPER[1])


def test_a_robot_that_counts_wrongly_turns_otherwise_until_its_description_is_right() -> None:
    parameters = with_effects(SPEEDS, {"wheel_separation_error": 0.1})
    robot = ExportedRobot(0, parameters, VelocityController(0.033, 0.16, 6.67))
    said = described(robot, None, None)
    assert turned_before(robot, said) == pytest.approx(360.0 * 1.1)
    # In Gazebo, where the wheels are as far apart as they really are, it does so, too.
    assert f"<wheel_separation>{0.16 * 1.1:.6g}</wheel_separation>" in sdf(robot, said)
    assert of_robot(SDF, robot)["wheel_separation_error"].how is Carry.EXACTLY


def test_a_target_with_physics_of_its_own_carries_what_its_table_says() -> None:
    found = of_robot(MJCF, robot_with(("coulomb_friction", "backlash", "quadratic_drag")))
    assert [one.how for one in found.values()] == [Carry.APPROXIMATELY, Carry.EXACTLY, Carry.NOT]
