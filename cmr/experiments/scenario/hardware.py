"""The interface of drivers, bridges and emulators needed to read a scenario, independent of their implementation."""

from pathlib import Path
from typing import Protocol

from cmr.documents.document import Item
from cmr.experiments.team.plan import BridgePlan, EmulatorPlan


class Hardware(Protocol):
    """The options of drivers, bridges and emulators; `cmr.commands.scenarios` has those of `robot_driver`."""

    def connection(self, item: Item) -> object:
        """Return the dataclass of the options of cmr-driver that an item describes.

        Raises the document's error for values that the driver does not allow.
        """
        ...

    def bridging(self, item: Item, folder: Path) -> BridgePlan:
        """Return the dataclass of the options of cmr-ros2 that an item describes; files are named from `folder`.

        Raises the document's error for values that cmr-ros2 does not allow.
        """
        ...

    def emulation(self, item: Item | None) -> EmulatorPlan:
        """Return the dataclass of the options of cmr-emulate that an item describes; without one, of its defaults.

        Raises the document's error for values that the emulator does not allow.
        """
        ...

    def check_emulator(self, settings: Path) -> None:
        """Raise DocumentError unless the settings of this file describe a valid emulator."""
        ...
