"""Movements: what is drawn is bounded, the same seed draws the same, and the driver's ramp is predicted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.investigation.movements import LARGEST, LENGTHS, candidates, opening, ramped, towards, waiting
from cmr.model.duty_ramp import Limits, approach


@given(seed=st.integers(0, 2**32))
def test_movements_are_short_and_within_their_duty(seed: int) -> None:
    """No movement is longer than 3 s, nor drives harder than with 0.9; the same seed draws the same ones."""
    first, again = (candidates(np.random.default_rng(seed), 8) for _ in range(2))
    for movement, same in zip(first, again, strict=True):
        assert any(abs(movement.seconds - length) < 1e-9 for length in LENGTHS)
        assert np.max(np.abs(movement.duty)) <= LARGEST + 1e-12
        assert np.array_equal(movement.duty, same.duty)


def test_the_opening_leads_back_to_where_it_began() -> None:
    """Each side's duties add up to nothing: what is driven forth is driven back."""
    assert np.allclose(sum(part.duty.sum(axis=0) for part in opening()), 0.0)
    assert sum(part.seconds for part in opening()) <= 3.0


def test_reversals_while_the_first_choice_is_made_stay_on_the_spot() -> None:
    """Both sides are driven against each other, for about a second, and each as long forth as back."""
    duty = waiting().duty
    assert abs(waiting().seconds - 1.0) < 0.05
    assert np.array_equal(duty[:, 0], -duty[:, 1])
    assert np.allclose(duty.sum(axis=0), 0.0)


def test_movements_towards_the_middle_go_both_ways() -> None:
    """There are 24, straight and curved ones, of both signs; some of them lead across."""
    drawn = towards(0.5, 0.74, np.random.default_rng(0))
    assert len(drawn) == 24
    assert {float(np.sign(movement.duty.sum())) for movement in drawn} == {-1.0, 1.0}


def test_commands_are_ramped_as_the_driver_does() -> None:
    """A jump takes the steps of the driver's own ramp, and then stays."""
    limits = Limits(10.0, 20.0)
    time, duty = ramped(np.array([0.0]), np.array([[0.6, -0.6]]), limits, (0.0, 0.2))
    expected = [0.0, 0.2]
    for row in duty:
        expected = [approach(now, wanted, 0.01, limits) for now, wanted in zip(expected, (0.6, -0.6), strict=True)]
        assert np.allclose(row, expected)
    assert np.allclose(duty[-1], (0.6, -0.6))
    assert np.allclose(np.diff(time), 0.01)


def test_movements_that_must_last_are_as_long_or_the_longest_there_are() -> None:
    """So long a decision takes: what is over sooner would make the robot wait."""
    random = np.random.default_rng(1)
    for least, shortest in ((0.0, 1.0), (1.2, 1.5), (2.0, 2.0), (9.0, 3.0)):
        lengths = [one.seconds for one in candidates(random, least=least)]
        assert min(lengths) == pytest.approx(shortest)
        assert max(lengths) == pytest.approx(3.0)
    assert min(one.seconds for one in towards(0.5, 0.7, random, least=1.7)) == pytest.approx(2.0)
