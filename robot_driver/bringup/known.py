"""Results of bring-up for a robot, and their file: the driver's settings, and other findings.

driver: {port: ..., controller: roboclaw, swap: true, ...}   the options for cmr-driver --settings
undecided: [ticks]                                           the steps without a result
found: {...}                                                 findings for later steps and for people
"""

import math
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from cmr.files import write_atomically
from robot_driver.settings import Settings, content_of

DRIVER_STEPS = ("devices", "motors", "ticks", "gyro")  # required for valid settings of cmr-driver
Plain = str | float | bool | list[str] | None


@dataclass
class Known:
    """The results: the driver's options by name, undecided steps, and findings by name."""

    driver: dict[str, Plain] = field(default_factory=dict)
    undecided: list[str] = field(default_factory=lambda: list(DRIVER_STEPS))
    found: dict[str, Plain] = field(default_factory=dict)

    def settings(self, robot: int, **changed: bool | float | None) -> Settings:
        """Return the driver's settings with some of them changed."""
        return Settings(**{**self.driver, **changed, "robot": robot})  # type: ignore[arg-type]

    def number(self, name: str) -> float:
        """Return a finding; NaN if unknown."""
        value = self.found.get(name)
        return float(value) if isinstance(value, int | float) else math.nan

    def decide(self, step: str) -> None:
        """Mark a step as decided."""
        self.undecided = [name for name in self.undecided if name != step]

    def doubt(self, step: str) -> None:
        """Mark a step as undecided."""
        if step in DRIVER_STEPS and step not in self.undecided:
            self.undecided = [name for name in DRIVER_STEPS if name in (*self.undecided, step)]

    def to_yaml(self) -> str:
        """Return the text of the file."""
        content = {"driver": self.driver, "undecided": self.undecided, "found": self.found}
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=False, allow_unicode=True)
        return f"# Written by cmr bringup; cmr-driver --settings takes `driver`.\n{text}"

    def save(self, path: Path) -> None:
        """Write the file atomically."""
        write_atomically(self.to_yaml(), path)


def load(path: Path) -> Known:
    """Load a file; empty if there is none. Raises CommandError."""
    if not path.exists():
        return Known()
    return Known(*content_of(path))
