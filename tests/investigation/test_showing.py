"""What a floor can show: the Kalman filter beside the model, and the table that comes of it."""

import numpy as np
import pytest

from cmr.plant.sensors import REALISTIC
from tests.investigation.filtering import EVERY_POSE, Along, whitened
from tests.investigation.showing import EFFECTS, shown

READINGS = 100  # of a rest of 1 s


def test_a_gyro_s_bias_at_rest_shows_as_its_noise_lets_it_and_no_more() -> None:
    """A bias of one deviation: n readings make n at most, and most of it where other sensors say that it stands."""
    still = Along(np.zeros(READINGS), np.zeros((READINGS, 2)))
    gyro = REALISTIC.gyro * np.array([[1.0, 2.0, 0.0]] * READINGS)
    wheels, poses = np.zeros((READINGS, 2, 3)), np.zeros((READINGS // EVERY_POSE, 3, 3))
    one, two, none = np.sum(whitened(still, wheels, gyro, poses) ** 2, axis=0)
    assert 0.2 * READINGS < one < READINGS
    assert two == pytest.approx(4.0 * one)
    assert none == 0.0


def test_the_table_has_every_effect_that_is_driven_for() -> None:
    """By its name, with how many drives it rests on."""
    table = shown()
    assert set(table) == set(EFFECTS)
    assert all(deviations >= 0.0 and drives > 0 for deviations, drives in table.values())
