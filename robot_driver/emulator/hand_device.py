"""A person's hands at the emulated robot: they lift it, turn its wheels and turn it round.

Lines on a port of their own command them: `lift`, `lower`, `left 10`, `right -1` and `robot 1` (turns; a wheel forward,
the robot counter-clockwise), and `look`, which is answered with all angles turned: `left 10.00 right 0.00 robot 0.25`.
"""

import math
from contextlib import suppress

from robot_driver.emulator.device import Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings

TURN = 2.0 * math.pi
PERIOD = 0.005  # s between movements of the hands
WHEEL_SPEED, ROBOT_SPEED = 4.0 * TURN, TURN / 4.0  # rad/s by hand


class HandDevice:
    """Hands at `plant`. While it is lifted, or turned by hand, its wheels do not move it."""

    def __init__(self, settings: Settings, plant: Plant) -> None:
        del settings
        self.byte_time = byte_time(0)
        self.wake_time = math.inf
        self._plant = plant
        self._line = b""
        self._lifted = False
        self._pose = self._where()
        self._left = self._right = self._robot = 0.0  # rad still to be turned

    @property
    def busy(self) -> bool:
        """Whether a turn is still in progress."""
        return any((self._left, self._right, self._robot))

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process bytes; execute complete lines."""
        *lines, self._line = (self._line + data).split(b"\n")
        said = b"".join(self._do(line.decode("ascii", "replace").split()) for line in lines)
        active = self._lifted or self.busy
        self.wake_time = min(self.wake_time, time + PERIOD) if active else math.inf
        return [Transmission(time, said)] if said else []

    def wake(self, time: float) -> list[Transmission]:
        """Move on by one period."""
        plant = self._plant
        self._left, step = _stepped(self._left, WHEEL_SPEED)
        plant.left.angle += step
        self._right, step = _stepped(self._right, WHEEL_SPEED)
        plant.right.angle += step
        self._robot, step = _stepped(self._robot, ROBOT_SPEED)
        if self._lifted or step:
            x, y, theta = self._pose
            self._pose = x, y, theta + step
            plant.x, plant.y, plant.theta = self._pose
        self.wake_time = time + PERIOD if self._lifted or self.busy else math.inf
        return []

    def _do(self, words: list[str]) -> bytes:
        """Execute a line; return the answer."""
        if not self._lifted and not self._robot:
            self._pose = self._where()
        if words in (["lift"], ["lower"]):
            self._lifted = words == ["lift"]
        elif words == ["look"]:
            turned = self._plant.left.angle / TURN, self._plant.right.angle / TURN, self._plant.theta / TURN
            return b"left %.2f right %.2f robot %.2f\n" % turned
        elif len(words) == 2 and words[0] in ("left", "right", "robot"):
            with suppress(ValueError):
                setattr(self, f"_{words[0]}", TURN * float(words[1]))
        return b""

    def _where(self) -> tuple[float, float, float]:
        return self._plant.x, self._plant.y, self._plant.theta


def _stepped(left: float, speed: float) -> tuple[float, float]:
    """Return the remaining turn after one period, and the turn made in it."""
    step = math.copysign(min(abs(left), speed * PERIOD), left)
    return left - step, step
