"""What the driver and the emulator of robots must answer for a scenario to be read; it knows neither of them."""

from dataclasses import Field
from pathlib import Path
from typing import Any, ClassVar, Protocol

from cmr.documents.document import Item


class EmulatorPlan(Protocol):
    """How an emulated robot is emulated: the dataclass of the options of cmr-emulate, as far as others ask for them."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def command(self) -> str:
        """What kind of command the robot takes."""
        ...

    @property
    def controller(self) -> str:
        """The kind of its motor controller."""
        ...

    @property
    def gyro(self) -> str:
        """The kind of its gyro."""
        ...

    @property
    def settings(self) -> Path | None:
        """The file of what differs from the default robot."""
        ...


class Hardware(Protocol):
    """The options of drivers and emulators; `cmr.commands.scenarios` has those of `robot_driver`."""

    def connection(self, item: Item) -> object:
        """Return the dataclass of the options of cmr-driver that an item describes.

        Raises the document's error for what the driver does not allow.
        """
        ...

    def emulation(self, item: Item | None) -> EmulatorPlan:
        """Return the dataclass of the options of cmr-emulate that an item describes; without one, of its defaults.

        Raises the document's error for what the emulator does not allow.
        """
        ...

    def check_emulator(self, settings: Path) -> None:
        """Raise DocumentError unless an emulator can be made by the settings of this file."""
        ...
