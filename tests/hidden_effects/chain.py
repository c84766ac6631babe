"""Logs of the whole chain in simulated time: pilot, driver, bytes, controller, gyro, and an effect hidden in the robot.

The robot is the emulator's own, with its unequal motors and wheels, friction, slip and gyro bias, and its parameters
within 15 % of the typical ones; or one without any of that.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats
from robot_driver.emulator.faults import Faults
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.simulated.drive import SimulatedDrive
from robot_driver.simulated.usb import Lateness
from tests.hidden_effects.places import find_place
from tests.hidden_effects.robots import draw_nominal, draw_robot
from tests.hidden_effects.sizes import draw_sizes
from tests.reference_plant import TYPICAL

DEFAULT, IDEAL = "default", "ideal"  # robots in which nothing further is hidden
HARDWARE: Mapping[str, tuple[str, str | None]] = MappingProxyType(
    {
        "roboclaw+dsp3000": ("roboclaw", "dsp3000"),
        "roboclaw+kvh-binary": ("roboclaw", "kvh-binary"),
        "roboteq+dsp3000": ("roboteq", "dsp3000"),
        "roboteq+kvh-binary": ("roboteq", "kvh-binary"),
        "mbot": ("mbot", None),
    }
)
CONDITIONS: Mapping[str, tuple[Lateness, Faults]] = MappingProxyType(
    {
        "usual": (Lateness(), Faults()),
        "hard": (Lateness(usb_latency=0.016, busy=0.1), Faults(lose_answer=0.05)),
    }
)
RICH, EIGHTS = "rich_drive", "figure_eight"
DRIVES: Mapping[str, tuple[str, Mapping[str, str], float]] = MappingProxyType(  # behaviour, its settings, s
    {
        RICH: ("manoeuvre", {"name": RICH}, 124.0),
        EIGHTS: ("figure_eight", {"size": "1.15", "laps": "3", "start": "1"}, 66.0),
    }
)
# What the emulator's own robot has; gyros tell late by what their bytes take.
OF_DEFAULT = frozenset(
    {"motor_gain_asymmetry", "wheel_radius_asymmetry", "coulomb_friction", "turn_slip", "longitudinal_slip"}
    | {"gyro_bias", "gyro_latency"}
)
OF_IDEAL = frozenset({"gyro_latency"})


@dataclass(frozen=True)
class ChainCase:
    """What is hidden, an effect of TYPICAL or the DEFAULT or IDEAL robot as it is, and the chain that the log is of.

    Raises ValueError for a name that is not known.
    """

    effect: str
    hardware: str
    drive: str = RICH
    conditions: str = "usual"
    seed: int = 0

    def __post_init__(self) -> None:
        known = (TYPICAL.keys() | {DEFAULT, IDEAL}, HARDWARE, DRIVES, CONDITIONS)
        for name, names in zip((self.effect, self.hardware, self.drive, self.conditions), known, strict=True):
            if name not in names:
                raise ValueError(f"no {name!r}; there are {', '.join(sorted(names))}")

    @property
    def there(self) -> frozenset[str]:
        """The names that are true of this robot."""
        if self.effect == IDEAL:
            return OF_IDEAL
        return OF_DEFAULT | ({self.effect} - {DEFAULT})

    @property
    def random(self) -> np.random.Generator:
        """What draws the robot and the size of the effect: the same ones for all hardware."""
        return np.random.default_rng([self.seed, zlib.crc32(f"chain {self.effect}".encode())])


class Hidden(NamedTuple):
    """A robot with what is hidden in it, and its parameters as they are believed to be."""

    settings: Settings
    believed: ParameterFile


def hidden_robot(case: ChainCase, random: np.random.Generator) -> Hidden:
    """Draw the robot of a case."""
    robot = draw_robot(random)
    believed = ParameterFile(0, {name: Value(value) for name, value in draw_nominal(robot, random).items()})
    settings = load_settings(seed=case.seed)
    settings = replace(settings, robot=replace(settings.robot, **robot))
    if case.effect == IDEAL:
        settings = settings.ideal()
    if case.effect in TYPICAL:
        settings = _hiding(settings, draw_sizes(case.effect, robot, DRIVES[case.drive][2], random))
    return Hidden(settings, believed)


def write_chain_log(case: ChainCase, path: Path) -> Settings:
    """Drive, write the event log, and return the robot that was driven, with what is hidden in it."""
    random = case.random
    settings, believed = hidden_robot(case, random)
    behaviour, behaviour_settings, seconds = DRIVES[case.drive]
    controller, gyro = HARDWARE[case.hardware]
    lateness, faults = CONDITIONS[case.conditions]
    drive = SimulatedDrive(
        settings=settings,
        controller=controller,
        gyro=gyro,
        behaviour=behaviour,
        behaviour_settings=behaviour_settings,
        seconds=seconds,
        seed=case.seed,
        lateness=lateness,
        faults=faults,
        believed=believed,
    )
    if case.effect == "surface_patch":
        drive = _placed(drive, path, random)
    drive.write_log(path)
    return drive.settings


def _hiding(settings: Settings, sizes: Mapping[str, float]) -> Settings:
    return replace(settings, effects={**settings.effects, **sizes})


def _placed(drive: SimulatedDrive, path: Path, random: np.random.Generator) -> SimulatedDrive:
    """Return the drive with the patch where it is crossed often."""

    def there(x: float, y: float) -> SimulatedDrive:
        return replace(drive, settings=_hiding(drive.settings, {"surface_patch_x": x, "surface_patch_y": y}))

    def driven(x: float, y: float) -> Floats:
        there(x, y).write_log(path)
        poses = Recording.read(path).poses
        return np.column_stack([poses["x"], poses["y"]])

    return there(*find_place(driven, drive.settings.effects["surface_patch_radius"], random))
