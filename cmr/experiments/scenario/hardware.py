"""What the driver and the emulator of robots must answer for a scenario to be read; it knows neither of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from cmr.documents.document import Item


class Hardware(Protocol):
    """The devices that robots can have, and their options; `cmr.commands.scenarios` has those of `robot_driver`."""

    @property
    def controllers(self) -> Sequence[str]:
        """The names of the motor controllers that can be emulated."""
        ...

    @property
    def gyros(self) -> Sequence[str]:
        """The names of the gyros that can be emulated."""
        ...

    def connection(self, item: Item) -> object:
        """Return the dataclass of the options of cmr-driver that an item describes.

        Raises the document's error for what the driver does not allow.
        """
        ...

    def check_emulator(self, settings: Path) -> None:
        """Raise DocumentError unless an emulator can be made by the settings of this file."""
        ...
