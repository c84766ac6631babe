"""Investigate an emulated robot in simulated time: pilot, driver, bytes, controller, plant and sensors."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from cmr.cli.errors import CommandError
from cmr.investigation.behaviour import Investigate
from cmr.parameters.file import ParameterFile, Value
from cmr.plant.parameters import TYPICAL
from robot_driver.emulator.settings import Settings, SettingsError, load_settings
from robot_driver.simulated.drive import SimulatedDrive

# Relative to the emulated robot's own, like an inaccurate data sheet.
BELIEVED = {"k2_over_k3": 0.9, "k1": 1.05, "base_width": 1.05}
# Factor of the driving time, and further s, that an investigation may take, including pauses.
OVERHEAD, MORE = 2.0, 10.0


def add_emulated(options: argparse.ArgumentParser) -> None:
    """Add the options of an emulated robot."""
    options.add_argument("--emulated", action="store_true", help="investigate an emulated robot in simulated time")
    options.add_argument("--settings", type=Path, metavar="FILE", help="with --emulated: as for cmr-emulate")
    options.add_argument(
        "--ideal", action="store_true", help="with --emulated: a robot that is exactly as the model says"
    )
    options.add_argument(
        "--hide",
        nargs="+",
        default=[],
        choices=sorted(TYPICAL),
        metavar="EFFECT",
        help="with --emulated: effects that the robot has, at their usual size",
    )


def drive_emulated(
    options: argparse.Namespace, behaviour: Investigate, log: Path, on_second: Callable[[], object]
) -> None:
    """Let the emulated robot be driven by its behaviour, and write the event log.

    Raises CommandError for invalid settings, or if the behaviour ended with a problem.
    """
    settings = _settings(options)
    drive = SimulatedDrive(
        settings=settings,
        behaviour=behaviour,
        seconds=OVERHEAD * options.longest + MORE,
        seed=options.seed,
        believed=believed(settings, options.robot),
        robot_id=options.robot,
        on_second=on_second,
    )
    drive.write_log(log)
    if behaviour.problem:
        raise CommandError(behaviour.problem)


def _settings(options: argparse.Namespace) -> Settings:
    """Return the settings of the emulated robot, with hidden effects at their typical size."""
    try:
        settings = load_settings(options.settings, seed=options.seed, ideal=options.ideal)
    except SettingsError as error:
        raise CommandError(str(error)) from error
    hidden = {name: value for effect in options.hide for name, value in TYPICAL[effect].items()}
    return replace(settings, effects={**settings.effects, **hidden})


def believed(settings: Settings, robot_id: int) -> ParameterFile:
    """Return the believed parameters of the emulated robot, as inaccurate as a data sheet."""
    robot = settings.robot
    values = {"wheel_radius": Value(robot.wheel_radius)}
    values |= {name: Value(share * getattr(robot, name)) for name, share in BELIEVED.items()}
    return ParameterFile(robot_id, values)
