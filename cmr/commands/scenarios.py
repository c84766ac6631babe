"""Scenarios as commands read them: the options of drivers and emulators in them are those of `robot_driver`."""

from pathlib import Path

from cmr.documents.document import Item
from cmr.documents.structure import structured
from cmr.experiments import scenario
from cmr.experiments.scenario import Scenario
from cmr.experiments.scenario.hardware import EmulatorPlan


class RobotDriver:
    """The devices of `robot_driver`, loaded when a scenario has options for them: few have."""

    def connection(self, item: Item) -> object:
        """Return the options of cmr-driver that an item describes.

        Raises the document's error for what the driver does not allow.
        """
        from robot_driver.settings import Connection

        return structured(item, Connection)

    def emulation(self, item: Item | None) -> EmulatorPlan:
        """Return the options of cmr-emulate that an item describes; without one, those that it has by default.

        Raises the document's error for what the emulator does not allow.
        """
        from robot_driver.emulator.options import Emulation

        return Emulation() if item is None else structured(item, Emulation)

    def check_emulator(self, settings: Path) -> None:
        """Raise SettingsError unless an emulator can be made by the settings of this file."""
        from robot_driver.emulator.settings import load_settings

        load_settings(settings)


HARDWARE = RobotDriver()


def load(path: Path, *, starts_checked: bool = True) -> Scenario:
    """Read a scenario from a YAML file, as `cmr.experiments.scenario.load` does."""
    return scenario.load(path, HARDWARE, starts_checked=starts_checked)


def parse(text: str, source: str = "scenario.yaml", folder: Path = Path(), *, starts_checked: bool = True) -> Scenario:
    """Return the scenario that a YAML text describes, as `cmr.experiments.scenario.parse` does."""
    return scenario.parse(text, HARDWARE, source, folder, starts_checked=starts_checked)
