"""Programs that run beside CMR's own processes while these are killed.

`Circle` is the behaviour of cmr-pilot; `python -m killing.programs FILE` rewrites a robot's parameter file for ever.
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
        """Return the left and right duty, which are constant."""
        return LEFT, RIGHT


def write(path: Path) -> None:
    """Rewrite a parameter file for ever, with another base_width each time."""
    values, count = load(path).values, 0
    while True:
        count += 1
        base_width = values["base_width"].value + 1e-6 * (count % 1000)
        ParameterFile(0, {**values, "base_width": Value(base_width)}).save(path)
        time.sleep(PAUSE)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
