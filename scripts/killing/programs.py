"""What runs beside CMR's own processes while these are killed.

`Circle` is what cmr-pilot does; `python -m killing.programs FILE` writes a robot's parameter file without end.
"""

import sys
import time
from pathlib import Path

from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value, load
from cmr.world.behaviours import Behaviour
from cmr.world.view import Robot, WorldView

PAUSE = 0.002  # s
LEFT, RIGHT = 0.4, 0.5  # duties


class Circle(Behaviour):
    """Drive in a circle at about half duty."""

    def command(self, _utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        """Return both duties, always the same."""
        return LEFT, RIGHT


def write(path: Path) -> None:
    """Write a parameter file again and again, each time another one."""
    known, count = load(path).values, 0
    while True:
        count += 1
        base_width = known["base_width"].value + 1e-6 * (count % 1000)
        ParameterFile(0, {**known, "base_width": Value(base_width)}).save(path)
        time.sleep(PAUSE)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
