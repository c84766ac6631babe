"""Interfaces of drivers, bridges and emulators needed to read a scenario, independent of their implementation."""

from dataclasses import Field
from pathlib import Path
from typing import Any, ClassVar, Protocol

from cmr.documents.document import Item


class EmulatorPlan(Protocol):
    """The options of an emulated robot: the dataclass of cmr-emulate's options, as far as others use them."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def command(self) -> str:
        """The kind of command that the robot takes."""
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
        """The file with settings that differ from the default robot."""
        ...


class BridgePlan(Protocol):
    """The options of a robot that speaks ROS 2: the dataclass of cmr-ros2's options for one robot."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def kept_in(self, path: Path) -> "BridgePlan":
        """Return a copy whose profile is copied to `path`, unless it is shipped with CMR. Raises OSError."""
        ...

    def arguments(self, robot_id: int) -> list[str]:
        """Return the options of cmr-ros2 for this robot."""
        ...


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
