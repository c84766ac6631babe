"""What movements are predicted to tell: finite, and more of what they excite."""

import numpy as np

from cmr.estimation.gains import USUAL_ANGLE, USUAL_POSE, gains_at
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Batch, Predictor
from cmr.estimation.segments import segments_of
from cmr.investigation.movements import PERIOD, Movement
from cmr.investigation.prediction import Situation, changes, paths
from cmr.model.commands import Commands
from cmr.model.duty_ramp import Limits
from cmr.model.observer.observer import Observer
from tests.investigation.investigated import DrivenRobot

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
SETS: tuple[dict[str, float], ...] = ({}, {"motor_gain_asymmetry": 0.03}, {"gyro_bias": 0.01}, {"gyro_scale": 0.02})
GAINS = gains_at(USUAL_ANGLE, USUAL_POSE, 0.01)


def situation() -> Situation:
    """A robot that rolls while a movement ends."""
    under_way = Commands(np.array([-0.3, -0.1, 0.02]), np.full((3, 2), 0.2))
    intervals = (0.01, 0.01, 0.04)  # of which multiples lie on either side of steps' borders, by rounding
    return Situation((0.0, 0.0, 0.0, 3.0, 3.0), 3.0, (1.0, 2.0), under_way, 0.5, 1.0, 0.1, Limits(), intervals)


def held(left: float, right: float) -> Movement:
    """A movement of 1 s."""
    return Movement("held", np.tile((left, right), (round(1.0 / PERIOD), 1)))


def noise() -> Noise:
    """The noise of the sensors on a curve."""
    robot = DrivenRobot(ROBOT)
    for _ in range(round(3.0 / PERIOD)):
        robot.drive(0.15, 0.25, PERIOD)
    predictor = Predictor(segments_of(robot.recording(), (), 0)[0])
    batch = Batch([predictor])
    return Noise.found(batch, batch.errors(Observer(ROBOT, GAINS)))


def test_movements_are_predicted_to_tell_of_what_they_excite() -> None:
    """Unequal gains show on any drive, a gyro that reads too large on a spin only, its bias everywhere alike."""
    rest, straight, spin = (
        np.sum(one**2, axis=0)
        for one in changes(
            situation(),
            [held(0.0, 0.0), held(0.4, 0.4), held(-0.4, 0.4)],
            [{**ROBOT, **own} for own in SETS],
            GAINS,
            noise(),
        )
    )
    gain, bias, scale = range(3)
    assert np.all(np.isfinite([rest, straight, spin]))
    assert straight[gain] > 4.0 * rest[gain] > 0.0
    assert spin[scale] > 100.0 * straight[scale]
    assert np.allclose([rest[bias], straight[bias]], spin[bias], rtol=0.05)


def test_a_movement_tells_the_same_whatever_is_predicted_beside_it() -> None:
    """Each begins with the battery and the motors as they are now, not as another candidate would leave them."""
    sets = [ROBOT, {**ROBOT, "battery_drift": 0.03}, {**ROBOT, "motor_heating": 0.06}]
    movements = [held(0.9, 0.9), held(0.4, 0.4)]
    beside = changes(situation(), movements, sets, GAINS, noise())[1]
    (alone,) = changes(situation(), movements[1:], sets, GAINS, noise())
    assert np.allclose(beside, alone, rtol=1e-9, atol=1e-12)


def test_paths_end_where_the_robot_comes_to_rest() -> None:
    """A robot that goes straight on ends ahead by what it rolled, and coasted: duty over k1, times the time."""
    (path,) = paths(situation(), [held(0.4, 0.4)], [ROBOT])
    way = ROBOT["wheel_radius"] * (0.5 * 0.2 / ROBOT["k1"] + 1.0 * 0.4 / ROBOT["k1"])
    assert abs(float(path[-1, 0, 0]) - way) < 0.02
    assert abs(float(path[-1, 0, 1])) < 1e-9
