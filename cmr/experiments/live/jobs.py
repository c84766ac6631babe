"""The processes that a scenario needs, with their commands, in starting order."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from cmr.cli.options import arguments_of
from cmr.experiments.team.plan import RobotPlan, Scenario
from cmr.model.command_kinds import DUTY
from cmr.processes.children import our_command
from cmr.processes.job import (
    CALIBRATOR,
    DIAGNOSER,
    DRIVER,
    EMULATOR,
    PILOT,
    RECORDER,
    SIM,
    START_ORDER,
    Job,
)

OPEN_LOOP = "manoeuvre"  # the open-loop behaviour
ENDING = (OPEN_LOOP, "investigate")  # behaviours that end and are not restarted
LOG = "run.lcm"
SIM_SCENARIO = "sim.yaml"
STATE = "state"  # folder in which drivers of emulated robots store an emergency stop: it ends with the run


def jobs_of(scenario: Scenario, folder: Path, url: str, begin_with: str = "") -> list[Job]:
    """Return the processes of a scenario whose files lie in `folder`, on the bus at `url`.

    Robots stand until the program `begin_with` is ready, if given.
    """
    bus = ["--lcm-url", url]
    moving = [*bus, "--begin-with", begin_with] if begin_with else bus
    recorder = [sys.executable, "-m", "cmr.experiments.live.recorder", str(folder / LOG), *bus]
    sim = [our_command("cmr-sim"), "--scenario", str(folder / SIM_SCENARIO), "--parameters", str(folder)]
    sim += ["--rate", f"{scenario.rate:g}", *moving]
    jobs = [Job("recorder", RECORDER, recorder, host=scenario.host), Job("sim", SIM, sim, host=scenario.host)]
    for robot in scenario.with_driver:
        jobs += _of_robot(robot, scenario, folder, bus, moving)
    return sorted(jobs, key=lambda job: START_ORDER.index(job.role))


def _of_robot(robot: RobotPlan, scenario: Scenario, folder: Path, bus: list[str], moving: list[str]) -> Iterator[Job]:
    """Yield the processes of a real or emulated robot, with the options of the bus and of the process that moves it."""
    robot_id = robot.robot_id
    who = ["--robot", str(robot_id)]
    parameters = ["--parameters", str(folder / f"robot_{robot_id}.yaml")]
    yield from _driven(robot, scenario, folder, bus)
    if robot.calibrate:
        command = [our_command("cmr-calibrate"), *who, "--out", str(folder / f"robot_{robot_id}.yaml"), *bus]
        yield Job(f"calibrator {robot_id}", CALIBRATOR, command, robot_id, host=scenario.host)
    if robot.diagnose:
        command = [our_command("cmr-diagnose"), "--live", *who, *parameters, "--out"]
        command += [str(folder / f"diagnosis_{robot_id}"), *bus]
        yield Job(f"diagnoser {robot_id}", DIAGNOSER, command, robot_id, host=scenario.host)
    if robot.behaviour is not None:
        command = [our_command("cmr-pilot"), *who, "--behaviour", str(robot.behaviour), *parameters, *moving]
        if scenario.geofence is not None:
            corners = ",".join(f"{value!r}" for corner in scenario.geofence for value in corner)
            command.append(f"--geofence={corners}")
        once = robot.behaviour.name in ENDING
        yield Job(f"pilot {robot_id}", PILOT, command, robot_id, host=robot.host, once=once)


def _driven(robot: RobotPlan, scenario: Scenario, folder: Path, bus: list[str]) -> Iterator[Job]:
    """Yield the processes between a robot and the bus: emulator and driver, or a bridge to ROS 2.

    Other robots with a velocity controller connect themselves, real ones by a bridge of their own.
    """
    robot_id = robot.robot_id
    who, ports = ["--robot", str(robot_id)], folder / f"ports_{robot_id}"
    name, after = f"driver {robot_id}", None
    connection = arguments_of(robot.driver) if robot.driver is not None else []
    if robot.emulator is not None:
        emulation = arguments_of(replace(robot.emulator, settings=folder / f"emulator_{robot_id}.yaml"))
        behind = ["--ports", str(ports)] if robot.emulator.command == DUTY else []
        command = [our_command("cmr-emulate"), *who, *behind, *emulation, *bus]
        command += ["--seed", str(scenario.seed + robot_id)]
        yield Job(f"emulator {robot_id}", EMULATOR, command, robot_id, host=robot.host)
        connection = ["--port", str(ports / "motor"), "--controller", robot.emulator.controller]
        connection += ["--gyro-port", str(ports / "gyro"), "--gyro", robot.emulator.gyro]
        connection += ["--state", str(folder / STATE)]
        after = ports / "gyro"
    if robot.ros2 is not None:
        yield Job(name, DRIVER, [our_command("cmr-ros2"), *robot.ros2.arguments(robot_id), *bus], robot_id)
    elif robot.driver is not None or (robot.emulator is not None and robot.emulator.command == DUTY):
        parameters = ["--parameters", str(folder / f"robot_{robot_id}.yaml")]
        driver = [our_command("cmr-driver"), *who, *connection, *parameters, *bus]
        yield Job(name, DRIVER, driver, robot_id, after, robot.host)
