"""The behaviour of a robot that a person leads: what the hands ask for, as duties of this robot's motors."""

from cmr.model.body import wheels
from cmr.model.parameters import RobotParameters
from cmr.teleop.hands import STILL, Hands
from cmr.world.behaviours import Behaviour
from cmr.world.view import Robot, WorldView

SPEED = 0.3  # m/s
TURN_RATE = 1.5  # rad/s
LARGEST_DUTY = 0.9  # leaves the motors something to turn with
SHARES = tuple(step / 10.0 for step in range(1, 21))  # of the speed, that a person can choose
USUAL = SHARES.index(1.0)


class ByHand(Behaviour):
    """Drives as `hands` ask at the moment, at most `speed` [m/s] and `turn_rate` [rad/s] times the chosen `share`.

    `wanted` is what is asked for in [m/s] and [rad/s]. Where the motors cannot do it, both sides are lowered alike.
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
        """How fast the hands want the robot to go [m/s] and to turn [rad/s]."""
        return self.hands.forward * self.share * self._speed, self.hands.turn * self.share * self._turn_rate

    def choose_speed(self, steps: int) -> None:
        """Choose a higher or a lower share."""
        self._step = min(max(self._step + steps, 0), len(SHARES) - 1)

    def ask(self, hands: Hands) -> None:
        """Note what the hands ask for at the moment."""
        self.hands = hands

    def command(self, _utime: int, _me: Robot, _world: WorldView, parameters: RobotParameters) -> tuple[float, float]:
        """Return the duties for what the hands ask for, as the paper's model has them at a steady speed."""
        left, right = (float(speed * parameters.k1) for speed in wheels(*self.wanted, parameters))
        excess = max(1.0, abs(left) / LARGEST_DUTY, abs(right) / LARGEST_DUTY)
        return left / excess, right / excess
