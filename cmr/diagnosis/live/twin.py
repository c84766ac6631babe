"""Predicted wheel motion of one robot: the model, driven with the robot's duties."""

import numpy as np

from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats

STEP = 0.01  # s; as in cmr-sim
EVERY = 2  # steps after which wheel speeds are read: they change little within 20 ms


class Twin:
    """The simulated wheels of one robot, starting with these speeds [rad/s]; they run freely, without corrections.

    The initial state of motor and gearing decays within a second. Longer memories, such as motor heat and energy drawn,
    start from zero here.
    """

    def __init__(self, parameters: RobotParameters, psi_left: float, psi_right: float) -> None:
        from cmr.model.fleet import Fleet  # imports Numba, which is slow; commands that do not simulate skip it

        self._fleet = Fleet(STEP)
        self._fleet.add(RobotState.at_rest()._replace(psi_left=psi_left, psi_right=psi_right), parameters)
        self.seconds = 0  # driven so far

    def drive(self, duties: Floats) -> Floats:
        """Simulate a second with one pair of duties per step, shape (1 / STEP, 2).

        Returns the wheel speeds [rad/s] at its beginning and after every EVERY steps, shape (n, 2).
        """
        speeds = [self._speeds()]
        for number, (left, right) in enumerate(duties.tolist(), start=1):
            self._fleet.command(0, left, right)
            self._fleet.advance()
            if number % EVERY == 0:
                speeds.append(self._speeds())
        self.seconds += 1
        return np.array(speeds)

    def _speeds(self) -> tuple[float, float]:
        state = self._fleet.states(0)
        return float(state.psi_left), float(state.psi_right)
