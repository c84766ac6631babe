"""Load scenarios for commands, with options of drivers, bridges and emulators from `robot_driver`."""

from pathlib import Path

from cmr.documents.document import DocumentError, Item
from cmr.documents.structure import structured
from cmr.experiments import scenario
from cmr.experiments.scenario import Scenario
from cmr.experiments.team.plan import BridgePlan, EmulatorPlan


class RobotDriver:
    """The devices of `robot_driver`, imported only for scenarios with such options."""

    def connection(self, item: Item) -> object:
        """Return the options of cmr-driver that an item describes.

        Raises the document's error for what the driver does not allow.
        """
        from robot_driver.settings import Connection

        return structured(item, Connection)

    def bridging(self, item: Item, folder: Path) -> BridgePlan:
        """Return the options of cmr-ros2 that an item describes; files are relative to `folder`.

        Raises the document's error for what cmr-ros2 does not allow, or a profile that it cannot use.
        """
        from robot_driver.ros2.options import Bridging

        bridging = structured(item, Bridging)
        try:
            return bridging.found_from(folder)
        except DocumentError as error:
            raise item.place.error(f"profile: {error}") from error

    def emulation(self, item: Item | None) -> EmulatorPlan:
        """Return the options of cmr-emulate described by an item, or the defaults.

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
