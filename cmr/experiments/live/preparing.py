"""Write the files of a run: robots' parameters, emulators' settings, and the scenario for cmr-sim."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import yaml

from cmr.documents.document import DocumentError, read_file
from cmr.experiments.live.jobs import SIM_SCENARIO
from cmr.experiments.scenario.writing import to_yaml
from cmr.experiments.team.plan import EmulatorPlan, RobotPlan, Scenario
from cmr.files import read_text, write_atomically
from cmr.geometry.places import Pose
from cmr.parameters.file import load as load_parameters


def prepare(scenario: Scenario, folder: Path) -> Scenario:
    """Write the files of a run into `folder`; return the scenario that names them.

    Each robot with parameters of its own gets `robot_<id>.yaml`, which a calibration may replace: the scenario's own
    files are never changed. Virtual robots with the same file share that of the first. Raises OSError when the folder
    cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    first_with: dict[Path, int] = {}
    robots = tuple(_prepared(robot, folder, first_with) for robot in scenario.robots)
    population = tuple(_copied(path, folder / f"population_{k}.yaml") for k, path in enumerate(scenario.population))
    result = replace(scenario, robots=robots, population=population)
    write_emulators(result, folder, {})
    write_sim_scenario(result, folder, {})
    return result


def write_sim_scenario(scenario: Scenario, folder: Path, poses: Mapping[int, Pose]) -> None:
    """Write the scenario that cmr-sim reads at its start: robots seen before start at their last pose.

    It has no waypoints: the remaining ones are sent when all robots are ready. It refers only to files in its own
    folder, so that the folder can be copied to another machine.
    """
    robots = tuple(_for_sim(robot, poses.get(robot.robot_id, robot.start)) for robot in scenario.robots)
    population = tuple(Path(path.name) for path in scenario.population)
    text = to_yaml(replace(scenario, robots=robots, population=population, ends_when=type(scenario.ends_when)()))
    write_atomically(text, folder / SIM_SCENARIO)


def _for_sim(robot: RobotPlan, start: Pose | None) -> RobotPlan:
    parameters = Path(robot.parameters.name) if robot.parameters is not None else None
    emulator = replace(robot.emulator, settings=None) if robot.emulator is not None else None
    return replace(robot, start=start, waypoints=(), parameters=parameters, emulator=emulator, ros2=None)


def write_emulators(scenario: Scenario, folder: Path, poses: Mapping[int, Pose]) -> None:
    """Write the settings that emulators read at their start: robots seen before start at their last pose."""
    for robot in scenario.robots:
        if robot.emulator is not None:
            start = poses.get(robot.robot_id, robot.start) or Pose(0.0, 0.0)
            _write_emulator(robot.robot_id, robot.emulator, start, folder)


def _prepared(robot: RobotPlan, folder: Path, first_with: dict[Path, int]) -> RobotPlan:
    if robot.parameters is None:
        return robot
    first = first_with.setdefault(robot.parameters, robot.robot_id) if robot.kind == "virtual" else robot.robot_id
    if first != robot.robot_id:
        return replace(robot, parameters=None, parameters_of=first)
    path = (folder / f"robot_{robot.robot_id}.yaml").absolute()
    replace(load_parameters(robot.parameters), robot_id=robot.robot_id).save(path)
    bridge = robot.ros2.kept_in(path.with_name(f"profile_{robot.robot_id}.yaml")) if robot.ros2 is not None else None
    return replace(robot, parameters=path, ros2=bridge)


def _copied(path: Path, copy: Path) -> Path:
    write_atomically(read_text(path, DocumentError.bounds.size), copy)
    return copy


def _write_emulator(robot_id: int, emulator: EmulatorPlan, start: Pose, folder: Path) -> None:
    """Write the settings of an emulated robot that stands at `start`."""
    read = read_file(emulator.settings, DocumentError, may_be_empty=True).value if emulator.settings else {}
    settings = dict(read) if isinstance(read, dict) else {}
    settings["robot"] = {**settings.get("robot", {}), **start._asdict()}
    write_atomically(yaml.safe_dump(settings, sort_keys=False), folder / f"emulator_{robot_id}.yaml")
