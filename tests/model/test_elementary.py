"""The polynomials against the standard library's functions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.model.compiled import compiled
from cmr.model.elementary import exp, expm1, expm1_small, sincos, sincos_small, sinh_and_cosh_minus_1

EPSILON = float(np.finfo(float).eps)


@compiled("UniTuple(f8, 4)(f8)")
def _everywhere(x: float) -> tuple[float, float, float, float]:
    sine, cosine = sincos(x)
    return sine, cosine, exp(x), expm1(x)


@compiled("UniTuple(f8, 5)(f8)")
def _near_zero(x: float) -> tuple[float, float, float, float, float]:
    sine, cosine = sincos_small(x)
    sinh, cosh_minus_1 = sinh_and_cosh_minus_1(x)
    return sine, cosine, sinh, cosh_minus_1, expm1_small(x)


@given(st.floats(-1e6, 1e6))
def test_sine_and_cosine_are_right_to_the_last_digits_for_any_heading(angle: float) -> None:
    sine, cosine, _, _ = _everywhere(angle)
    # Near 1 some six roundings of half a last digit meet: of the reduced angle, in the polynomial, and in libm.
    assert sine == pytest.approx(math.sin(angle), abs=3.0 * EPSILON)
    assert cosine == pytest.approx(math.cos(angle), abs=3.0 * EPSILON)


@given(st.floats(-700.0, 700.0))
def test_exponentials_are_right_to_the_last_digits(x: float) -> None:
    _, _, value, minus_one = _everywhere(x)
    assert value == pytest.approx(math.exp(x), rel=4.0 * EPSILON)
    assert minus_one == pytest.approx(math.expm1(x), rel=4.0 * EPSILON, abs=1e-300)


def test_exponentials_of_infinities_are_bounded() -> None:
    assert 0.0 < _everywhere(-math.inf)[2] < 1e-300
    assert 1e300 < _everywhere(math.inf)[2] < math.inf
    assert _everywhere(-math.inf)[3] == -1.0


@given(st.floats(-0.3, 0.3))
def test_the_short_series_for_small_angles_are_off_by_their_first_missing_term(x: float) -> None:
    sine, cosine, _, _, _ = _near_zero(x)
    assert abs(sine - math.sin(x)) <= abs(x) ** 11 / math.factorial(11) + EPSILON
    assert abs(cosine - math.cos(x)) <= x**10 / math.factorial(10) + EPSILON


@given(st.floats(-0.2, 0.2))
def test_the_short_series_for_hyperbolic_functions_keep_relative_precision(x: float) -> None:
    _, _, sinh, cosh_minus_1, minus_one = _near_zero(x)
    assert sinh == pytest.approx(math.sinh(x), rel=4.0 * EPSILON + 1.01 * x**10 / math.factorial(11), abs=1e-300)
    # cosh(x) - 1 = 2 sinh(x / 2)^2 without cancellation.
    truth = 2.0 * math.sinh(x / 2.0) ** 2
    assert cosh_minus_1 == pytest.approx(truth, rel=4.0 * EPSILON + 2.01 * x**8 / math.factorial(10), abs=1e-300)
    assert minus_one == pytest.approx(math.expm1(x), rel=4.0 * EPSILON, abs=1e-300)
