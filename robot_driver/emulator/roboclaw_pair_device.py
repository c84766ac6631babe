"""Two RoboClaws on one line that drive four wheels, two on each side."""

import dataclasses
from collections import Counter
from functools import partial

from robot_driver.emulator.device import Transmission
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.settings import Settings

ADDRESSES = (0x80, 0x81)


class RoboclawPairDevice:
    """Units 0x80 and 0x81; the two wheels of a side are coupled by the ground and turn by the mean of their duties."""

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self._plant = plant
        self._duties = [(0.0, 0.0) for _ in ADDRESSES]
        self.units = [
            RoboclawDevice(
                dataclasses.replace(settings, roboclaw=dataclasses.replace(settings.roboclaw, address=address)),
                plant,
                partial(self._command, unit),
            )
            for unit, address in enumerate(ADDRESSES)
        ]
        self.byte_time = self.units[0].byte_time

    @property
    def not_understood(self) -> Counter[str]:
        """Counts of packets that either did not understand."""
        return self.units[0].not_understood + self.units[1].not_understood

    @property
    def wake_time(self) -> float:
        """The earlier of both wake times."""
        return min(unit.wake_time for unit in self.units)

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Pass bytes to both; the addressed one answers."""
        return [answer for unit in self.units for answer in unit.receive(data, time)]

    def wake(self, time: float) -> list[Transmission]:
        """Wake the units that are due."""
        return [answer for unit in self.units if unit.wake_time <= time for answer in unit.wake(time)]

    def _command(self, unit: int, left: float, right: float) -> None:
        self._duties[unit] = (left, right)
        lefts, rights = zip(*self._duties, strict=True)
        self._plant.command(sum(lefts) / len(lefts), sum(rights) / len(rights))
