"""An emulated device at the end of a pseudo-terminal, for clients that nobody here wrote."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from robot_driver.emulator.device import Device
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.terminals.pseudo_terminal import Ports


@contextmanager
def served(folder: Path, device: Device, plant: Plant) -> Iterator[str]:
    """Yield the port at which a device is."""
    with Ports(folder, ("motor",)) as ports, Engine(plant, {"motor": device}, ports.terminals) as engine:
        yield str(folder / "motor")
        engine.check()


def emulated(section: str, **changes: Any) -> tuple[Settings, Plant]:
    """Return an ideal robot whose controller differs in its `section` of the settings."""
    settings = load_settings().ideal()
    own = dataclasses.replace(getattr(settings, section), **changes)
    settings = dataclasses.replace(settings, **{section: own})
    return settings, Plant(settings)
