"""Export a robot to a target: write its files, and return remarks about them."""

import subprocess
from pathlib import Path
from typing import NamedTuple

from cmr.cli.errors import CommandError
from cmr.exporting.c_statements import NoCounterpartError
from cmr.exporting.carried import FMU, MJCF, PYTHON, ROS2_CONTROL, SDF, URDF
from cmr.exporting.diff_drive import described, ros2_control
from cmr.exporting.fmu import NO_COMPILER, fmu
from cmr.exporting.gazebo import sdf, urdf
from cmr.exporting.mjcf import mjcf
from cmr.exporting.python_file import python_file
from cmr.exporting.robot import ExportedRobot
from cmr.files import write_atomically

ENDINGS = {PYTHON: ".py", FMU: ".fmu", MJCF: ".xml", ROS2_CONTROL: ".ros2_control.yaml", SDF: ".sdf", URDF: ".urdf"}


class Description(NamedTuple):
    """What a robot description says, for targets that keep it: wheel separation and radius [m], None if not given."""

    separation: float | None = None
    radius: float | None = None


NOTHING_KNOWN = Description()


def name_of_file(robot: ExportedRobot, target: str) -> str:
    """Return the default file name for a target."""
    return f"robot_{robot.robot_id}{ENDINGS[target]}"


def export(robot: ExportedRobot, target: str, path: Path, description: Description = NOTHING_KNOWN) -> list[str]:
    """Write a robot for a target; return remarks for the user.

    Raises CommandError if the robot cannot be exported there, and OSError if the file cannot be written.
    """
    remarks: list[str] = []
    try:
        content: str | bytes
        if target == FMU:
            unit = fmu(robot)
            content = unit.content
            if not unit.has_binary:
                remarks.append(NO_COMPILER.format(path=path))
        else:
            content = _text(robot, target, description)
    except (NoCounterpartError, ValueError) as error:
        raise CommandError(f"Robot {robot.robot_id} cannot be exported to {target}: {error}") from error
    except subprocess.CalledProcessError as error:
        reason = (error.stderr or "").strip().splitlines()[:1]
        raise CommandError(f"The C compiler failed: {' '.join(reason) or error}") from error
    write_atomically(content, path)
    return remarks


def _text(robot: ExportedRobot, target: str, description: Description) -> str:
    if target == PYTHON:
        return python_file(robot)
    if target == MJCF:
        return mjcf(robot)
    write = {ROS2_CONTROL: ros2_control, SDF: sdf, URDF: urdf}[target]
    return write(robot, described(robot, *description))
