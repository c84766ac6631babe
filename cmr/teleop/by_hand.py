"""Behaviour of a robot driven by hand: converts the input to duties of this robot's motors."""

from cmr.model.body import wheels
from cmr.model.parameters import RobotParameters
from cmr.teleop.hands import STILL, Hands
from cmr.world.behaviours import Behaviour
from cmr.world.view import Robot, WorldView

SPEED = 0.3  # m/s
TURN_RATE = 1.5  # rad/s
LARGEST_DUTY = 0.9  # leaves a reserve for turning
SHARES = tuple(step / 10.0 for step in range(1, 21))  # of the full speed, selectable by the operator
USUAL = SHARES.index(1.0)


class ByHand(Behaviour):
    """Drives as `hands` currently ask, at most `speed` [m/s] and `turn_rate` [rad/s] times the chosen `share`.

    `wanted` is the demand in [m/s] and [rad/s]. If it exceeds what the motors can do, both sides are scaled down by the
    same factor.
    """

    def __init__(self, speed: float = SPEED, turn_rate: float = TURN_RATE) -> None:
        self.hands = STILL
        self._speed, self._turn_rate = speed, turn_rate
        self._step = USUAL

    @property
    def share(self) -> float:
        """The chosen share of the speed."""
        return SHARES[self._step]

    @property
    def wanted(self) -> tuple[float, float]:
        """Demanded speed [m/s] and turn rate [rad/s]."""
        return self.hands.forward * self.share * self._speed, self.hands.turn * self.share * self._turn_rate

    def choose_speed(self, steps: int) -> None:
        """Choose a higher or a lower share."""
        self._step = min(max(self._step + steps, 0), len(SHARES) - 1)

    def ask(self, hands: Hands) -> None:
        """Store the current input."""
        self.hands = hands

    def command(self, _utime: int, _me: Robot, _world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties for the demand, by the paper's model at steady speed."""
        left, right = (float(speed * parameters.k1) for speed in wheels(*self.wanted, parameters))
        excess = max(1.0, abs(left) / LARGEST_DUTY, abs(right) / LARGEST_DUTY)
        return left / excess, right / excess
