"""Duty changes no faster than the limits; stopping is never slower than starting."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_driver.ramp import Limits, Ramp, approach

DUTY = st.floats(-1.0, 1.0)


@given(DUTY, DUTY, st.floats(0.0, 0.1))
def test_a_step_grows_and_shrinks_within_the_limits_and_never_overshoots(
    duty: float, wanted: float, seconds: float
) -> None:
    limits = Limits(2.0, 5.0)
    after = approach(duty, wanted, seconds, limits)
    assert min(duty, wanted) - 1e-12 <= after <= max(duty, wanted) + 1e-12
    assert abs(after) - abs(duty) <= limits.speeding_up * seconds + 1e-12
    assert abs(after - duty) <= limits.slowing_down * seconds + 1e-12


def test_the_wanted_duty_is_reached_in_time_through_zero() -> None:
    limits = Limits(2.0, 4.0)
    assert approach(0.0, 1.0, 0.5, limits) == pytest.approx(1.0)
    assert approach(0.8, 0.0, 0.2, limits) == 0.0
    assert approach(0.4, -1.0, 0.1, limits) == 0.0
    assert approach(0.4, -1.0, 0.35, limits) == pytest.approx(-0.5)


def driven(ramp: Ramp, left: float, right: float, now: float) -> tuple[float, float]:
    """Return the next duties of the ramp after the device has acknowledged them."""
    duties = ramp.towards(left, right, now)
    ramp.confirm()
    return duties


def test_after_a_reset_the_ramp_begins_at_zero_again() -> None:
    ramp = Ramp(Limits(10.0, 20.0), longest_step=0.02)
    duties = [driven(ramp, 1.0, -1.0, 5.0 + 0.01 * turn)[0] for turn in range(12)]
    assert duties == pytest.approx([min(0.1 * turn, 1.0) for turn in range(12)])
    ramp.reset()
    assert driven(ramp, 1.0, 1.0, 6.0) == (0.0, 0.0)


def test_a_pause_is_no_licence_to_jump() -> None:
    ramp = Ramp(Limits(10.0, 20.0), longest_step=0.02)
    driven(ramp, 1.0, 1.0, 5.0)
    assert driven(ramp, 1.0, 1.0, 5.3) == pytest.approx((0.2, 0.2))


def test_after_a_pause_in_which_the_device_may_have_stopped_the_motors_the_ramp_begins_at_zero() -> None:
    ramp = Ramp(Limits(10.0, 20.0), longest_step=0.02)
    for turn in range(12):
        driven(ramp, 1.0, 1.0, 5.0 + 0.01 * turn)
    assert driven(ramp, 1.0, 1.0, 5.6) == (0.0, 0.0)
    assert driven(ramp, 1.0, 1.0, 5.61) == pytest.approx((0.1, 0.1))


def test_duties_that_were_lost_on_the_line_are_no_licence_to_jump() -> None:
    ramp = Ramp(Limits(10.0, 20.0), longest_step=0.02)
    driven(ramp, 1.0, 1.0, 5.0)
    lost = [ramp.towards(1.0, 1.0, 5.0 + 0.01 * turn) for turn in range(1, 10)]
    assert lost[-1] == pytest.approx((0.2, 0.2))
    assert driven(ramp, 1.0, 1.0, 5.1) == pytest.approx((0.2, 0.2))


@pytest.mark.parametrize("limits", [(0.0, 1.0), (2.0, 1.0), (float("nan"), 1.0), (1.0, float("inf"))])
def test_slowing_down_slower_than_speeding_up_is_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="at least as fast"):
        Limits(*limits)
