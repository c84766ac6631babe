"""Options for emulating a robot: those of cmr-emulate, and `emulator:` in a scenario."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cmr.documents.declared import Between, Option, Word
from cmr.model.command_kinds import DUTY, KINDS

SLOWEST_POSES, FASTEST_POSES = 0.1, 1000.0  # Hz
IDEAL_HELP = "no effects and imperfections but the noise of the sensors, and what FILE.yaml of --settings hides"


def controllers() -> Sequence[str]:
    """Return the names of the motor controllers that can be emulated."""
    from robot_driver.emulator.devices import CONTROLLER_DEVICES

    return sorted(CONTROLLER_DEVICES)


def gyros() -> Sequence[str]:
    """Return the names of the gyros that can be emulated."""
    from robot_driver.emulator.devices import GYRO_DEVICES

    return sorted(GYRO_DEVICES)


CommandKind = Annotated[str, Word(lambda: KINDS)]
ControllerName = Annotated[str, Word(controllers)]
GyroName = Annotated[str, Word(gyros)]
PoseRate = Annotated[float, Between(SLOWEST_POSES, FASTEST_POSES)]


@dataclass(frozen=True)
class Emulation:
    """Options for emulating a robot.

    Raises ValueError for a pose rate out of bounds, naming the option as on the command line.
    """

    command: Annotated[CommandKind, Option("what the robot takes: see above")] = DUTY
    controller: Annotated[ControllerName, Option("on port motor")] = "roboclaw"
    gyro: Annotated[GyroName, Option("on port gyro")] = "dsp3000"
    settings: Annotated[Path | None, Option("what differs from the default robot", "FILE.yaml")] = None
    ideal: Annotated[bool, Option(IDEAL_HELP)] = False
    pose_rate: Annotated[PoseRate, Option("rate of POSE_N", "HZ", read=float)] = 50.0

    def __post_init__(self) -> None:
        if not SLOWEST_POSES <= self.pose_rate <= FASTEST_POSES:
            raise ValueError(f"--pose-rate must be {SLOWEST_POSES:g} to {FASTEST_POSES:g} Hz")
