"""A running robot under a controller: duties take effect later, or never, if commands are delayed or lost."""

from collections import deque
from random import Random

from cmr.plant.motors import counted_width
from cmr.plant.parameters import PlantParameters
from cmr.plant.running import RunningRobot


def wheel_speeds_of(p: PlantParameters, v: float, omega: float) -> tuple[float, float]:
    """Return the wheel speeds (left, right) [rad/s] of a robot with a velocity controller for (v, omega)."""
    difference = omega * counted_width(p) / 2.0
    return (v - difference) / p.wheel_radius, (v + difference) / p.wheel_radius


class CommandedRobot:
    """The robot `running`, with command_delay, command_jitter and command_loss applied to its duties.

    Random numbers are drawn from `random`.
    """

    def __init__(self, running: RunningRobot, parameters: PlantParameters, random: Random) -> None:
        self.running = running
        self._parameters, self._random = parameters, random
        self._commands: deque[tuple[float, float, float]] = deque()  # when they take effect, and both duties

    def command(self, left: float, right: float) -> None:
        """Drive each side with this duty, -1 to 1, from now on; later, or never, if the command is delayed or lost."""
        left, right = (max(-1.0, min(1.0, duty)) for duty in (left, right))
        p, random = self._parameters, self._random
        if p.command_loss > 0.0 and random.random() < p.command_loss:
            return
        now = self.running.time
        effective = now + p.command_delay + (p.command_jitter * random.random() if p.command_jitter else 0.0)
        while self._commands and self._commands[-1][0] >= effective:
            self._commands.pop()  # it arrives after a newer one, and is ignored
        if effective > now:
            self._commands.append((effective, left, right))
        else:
            self.running.drive(left, right)

    def advance(self, time: float) -> None:
        """Advance to `time` (s); a time in the past changes nothing."""
        while self._commands and self._commands[0][0] <= time:
            effective, left, right = self._commands.popleft()
            self.running.advance(effective)
            self.running.drive(left, right)
        self.running.advance(time)
