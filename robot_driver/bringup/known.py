"""What bring-up knows of a robot, and the file that keeps it: the driver's settings, and what else was found.

driver: {port: ..., controller: roboclaw, swap: true, ...}   what cmr-driver --settings takes
undecided: [ticks]                                           the steps that came to no end
found: {...}                                                 what later steps need, and what a person may want to read
"""

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from cmr.cli.errors import CommandError
from cmr.files import write_atomically
from robot_driver.settings import Connection, Settings

DRIVER_STEPS = ("devices", "motors", "ticks", "gyro")  # without which cmr-driver would go by settings that may be wrong
Plain = str | float | bool | list[str] | None
LARGEST = 65_536  # bytes


@dataclass
class Known:
    """What is known: the driver's options by name, steps that came to no end, and what was found by name."""

    driver: dict[str, Plain] = field(default_factory=dict)
    undecided: list[str] = field(default_factory=lambda: list(DRIVER_STEPS))
    found: dict[str, Plain] = field(default_factory=dict)

    def settings(self, robot: int, **changed: bool | float | None) -> Settings:
        """Return the driver's settings with some of them changed."""
        return Settings(**{**self.driver, **changed, "robot": robot})  # type: ignore[arg-type]

    def number(self, name: str) -> float:
        """Return a number that was found; NaN where it was not."""
        value = self.found.get(name)
        return float(value) if isinstance(value, int | float) else math.nan

    def decide(self, step: str) -> None:
        """Note that a step came to its end."""
        self.undecided = [name for name in self.undecided if name != step]

    def doubt(self, step: str) -> None:
        """Note that a step has to be done, or done again."""
        if step in DRIVER_STEPS and step not in self.undecided:
            self.undecided = [name for name in DRIVER_STEPS if name in (*self.undecided, step)]

    def to_yaml(self) -> str:
        """Return the text of the file."""
        content = {"driver": self.driver, "undecided": self.undecided, "found": self.found}
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=False, allow_unicode=True)
        return f"# Written by cmr bringup; cmr-driver --settings takes `driver`.\n{text}"

    def save(self, path: Path) -> None:
        """Write the file, all of it or nothing."""
        write_atomically(self.to_yaml(), path)


def load(path: Path) -> Known:
    """Return what a file keeps; nothing where there is none. Raises CommandError."""
    if not path.exists():
        return Known()
    try:
        with path.open(encoding="utf-8") as file:
            content = yaml.safe_load(file.read(LARGEST))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise CommandError(f"{path} cannot be read: {error}") from error
    parts = {"driver": dict, "undecided": list, "found": dict}
    if not isinstance(content, dict) or not all(isinstance(content.get(name), kind) for name, kind in parts.items()):
        raise CommandError(f"{path} is no file of cmr bringup: it needs driver, undecided and found.")
    names = {entry.name for entry in dataclasses.fields(Connection)}
    if unknown := set(content["driver"]) - names:
        raise CommandError(f"{path}: the driver has no setting {min(map(str, unknown))!r}.")
    return Known(content["driver"], [str(step) for step in content["undecided"]], content["found"])


def driver_arguments(path: Path) -> list[str]:
    """Return the options of cmr-driver that a file holds.

    Raises CommandError for one that bring-up has not completed, and cannot be read.
    """
    known = load(path)
    if not path.exists():
        raise CommandError(f"There is no {path}. cmr bringup writes it.")
    if known.undecided:
        steps = ", ".join(known.undecided)
        raise CommandError(f"{path} is not complete: cmr bringup has still to decide {steps}.")
    options: list[str] = []
    for name, value in known.driver.items():
        option = f"--{name.replace('_', '-')}"
        if value is True:
            options.append(option)
        elif value is not None and value is not False:
            options += [option, str(value)]
    return options
