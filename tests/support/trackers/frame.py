"""What an emulated tracker sends at one moment."""

import math
from dataclasses import dataclass
from typing import NamedTuple


class Body(NamedTuple):
    """A body in a frame whose z axis points up [m], with its quaternion x, y, z, w."""

    name: str
    x: float
    y: float
    theta: float
    tracked: bool = True
    z: float = 0.1

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """The turn about the z axis."""
        return 0.0, 0.0, math.sin(self.theta / 2.0), math.cos(self.theta / 2.0)


@dataclass(frozen=True)
class Emitted:
    """A frame: its number, when it was exposed and sent on the tracker's own clock [s], and the bodies."""

    number: int
    exposed: float
    sent: float
    bodies: list[Body]
