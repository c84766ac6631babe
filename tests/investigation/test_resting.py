"""The gyro of a robot that stands: which readings these are, and how much they tell of its bias."""

import numpy as np
import pytest

from cmr.estimation.gains import USUAL_ANGLE, USUAL_POSE, gains_at
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Batch, Errors, Predictor
from cmr.estimation.search.cross_validation import GYRO
from cmr.estimation.segments import segments_of
from cmr.investigation.movements import PERIOD
from cmr.investigation.resting import NoiseWithRests, resting, with_rests
from cmr.model.observer.observer import Observer
from tests.investigation.investigated import DrivenRobot

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
RESTS, DRIVES = 2.0, 2.0  # s
GAINS = gains_at(USUAL_ANGLE, USUAL_POSE, 0.01)
GYRO_NOISE = 0.005  # rad/s, of the plant


def errors_of() -> tuple[Batch, Errors]:
    """Return the errors of the true model in a drive that begins with a rest."""
    robot = DrivenRobot(ROBOT, seed=3)
    for left, right, seconds in ((0.0, 0.0, RESTS), (0.2, 0.3, DRIVES)):
        for _ in range(round(seconds / PERIOD)):
            robot.drive(left, right, PERIOD)
    batch = Batch([Predictor(segments_of(robot.recording(), (), 0)[0])])
    return batch, batch.errors(Observer(ROBOT, GAINS))


def test_a_robot_rests_until_its_wheels_turn() -> None:
    """All readings of the rest but those next to its ends."""
    batch, _ = errors_of()
    still, times = resting(batch), batch.predictors[0].times[GYRO]
    assert still[(times > 0.3) & (times < RESTS - 0.1)].all()
    assert not still[times > RESTS].any()


def test_at_rest_the_errors_of_a_gyro_are_as_they_are() -> None:
    """Their size is the gyro's own noise, or more where its means wander; there a bias shows more."""
    batch, errors = errors_of()
    noise = with_rests(Noise.found(batch, errors), batch, errors)
    assert isinstance(noise, NoiseWithRests)
    assert 0.8 * GYRO_NOISE < noise.size < 2.0 * GYRO_NOISE
    biased = Errors({**errors.of, GYRO: errors.of[GYRO] + GYRO_NOISE}, errors.motion, errors.followed)
    change = noise.all_white(batch, biased) - noise.all_white(batch, errors)
    rows = resting(batch)
    (part,) = batch.white_rows(GYRO)
    assert change[part][rows] == pytest.approx(GYRO_NOISE / noise.size)
    assert np.sum(change[part][rows] ** 2) > 4.0 * np.sum(change[part][~rows] ** 2)
