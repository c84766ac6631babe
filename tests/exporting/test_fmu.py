"""The FMU is valid, runs in an importer that others wrote, and moves as CMR does."""

import importlib.util
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.exporting.carried import of_robot
from cmr.exporting.fmu import fmu
from cmr.exporting.robot import ExportedRobot
from cmr.model.velocity_controller import VelocityController
from tests.exporting.exported_robots import COMPILER, ROBOTS, SPEEDS, driven_by_cmr, driven_in_python, robot_with
from tests.support.lanes import further

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(COMPILER is None, reason="no C compiler"),
]
needs_fmpy = pytest.mark.skipif(importlib.util.find_spec("fmpy") is None, reason="fmpy is not installed")
STEP, SECONDS = 0.01, 60.0
TIME = np.arange(0.0, SECONDS, STEP)
LEFT, RIGHT = 0.5 + 0.3 * np.sin(0.7 * TIME), 0.4 + 0.4 * np.sin(0.4 * TIME + 1.0)


def written(robot: ExportedRobot, folder: Path) -> Path:
    path = folder / "robot.fmu"
    path.write_bytes(fmu(robot).content)
    return path


def simulated(path: Path, names: tuple[str, str], first: np.ndarray, second: np.ndarray) -> Any:
    """Return what FMPy records: each command holds from its time on, for one step."""
    import fmpy

    kinds = [("time", float), (names[0], float), (names[1], float)]
    inputs = np.array(list(zip(TIME, first, second, strict=True)), dtype=kinds)
    return fmpy.simulate_fmu(
        str(path), stop_time=SECONDS, step_size=STEP, output_interval=STEP, input=inputs, start_values={"seed": 5}
    )


@needs_fmpy
def test_an_importer_of_others_finds_nothing_wrong(tmp_path: Path) -> None:
    import fmpy.validation

    path = written(robot_with(ROBOTS[0]), tmp_path)
    assert fmpy.validation.validate_fmu(str(path)) == []


@needs_fmpy
# Other robots, of both formats: test_same_motion.py.
@pytest.mark.parametrize("effects", [*further(((),), *((effects,) for effects in ROBOTS[1:])), ROBOTS[0]], ids="+".join)
def test_the_unit_drives_the_path_of_cmr(effects: tuple[str, ...], tmp_path: Path) -> None:
    robot = robot_with(effects)
    path = written(robot, tmp_path)
    result = simulated(path, ("duty_left", "duty_right"), LEFT, RIGHT)
    spans = LEFT, RIGHT, np.full(len(TIME), STEP)
    expected = driven_by_cmr(robot, spans, seed=5)
    assert np.max(np.abs(result["x"][1:] - expected[:, 0])) < 1e-6  # m
    assert np.max(np.abs(result["y"][1:] - expected[:, 1])) < 1e-6  # m
    _, readings = driven_in_python(robot, spans, seed=5)
    for number, name in enumerate(("encoder_left", "encoder_right", "gyro_yaw_rate", "tracked_x", "tracked_y")):
        np.testing.assert_allclose(result[name][1:], readings[:, number], atol=1e-9)


@needs_fmpy
def test_a_robot_with_a_velocity_controller_takes_velocities(tmp_path: Path) -> None:
    controller = VelocityController(0.033, 0.16, 6.67)
    path = written(ExportedRobot(3, SPEEDS, controller), tmp_path)
    v, omega = 0.1 + 0.05 * np.sin(TIME), 0.5 * np.cos(0.5 * TIME)
    result = simulated(path, ("v", "omega"), v, omega)
    left, right = controller.duties_of_body(v, omega)
    expected = driven_by_cmr(ExportedRobot(3, SPEEDS), (left, right, np.full(len(TIME), STEP)))
    assert np.max(np.abs(result["x"][1:] - expected[:, 0])) < 1e-6  # m
    assert np.max(np.abs(result["y"][1:] - expected[:, 1])) < 1e-6  # m


@needs_fmpy
def test_the_unit_starts_where_it_is_told(tmp_path: Path) -> None:
    import fmpy

    start = {"start_x": 1.0, "start_y": -2.0, "start_theta": 0.5, "duty_left": 0.5, "duty_right": 0.5}
    found = fmpy.simulate_fmu(str(written(robot_with(()), tmp_path)), stop_time=1.0, step_size=STEP, start_values=start)
    assert [found[name][0] for name in ("x", "y", "theta")] == [1.0, -2.0, 0.5]
    assert np.arctan2(found["y"][-1] + 2.0, found["x"][-1] - 1.0) == pytest.approx(0.5)


def test_the_unit_holds_its_sources_and_a_binary(tmp_path: Path) -> None:
    unit = fmu(robot_with(ROBOTS[0]))
    (tmp_path / "robot.fmu").write_bytes(unit.content)
    archive = zipfile.ZipFile(tmp_path / "robot.fmu")
    names = archive.namelist()
    assert {"modelDescription.xml", "sources/cmr_robot.c", "sources/buildDescription.xml"} <= {*names}
    page = archive.read("documentation/index.html").decode()
    assert all(name in page for name in of_robot("fmu", robot_with(ROBOTS[0])))
    assert unit.has_binary == any(name.startswith("binaries/") for name in names)
    assert fmu(robot_with(ROBOTS[0])).content == unit.content
