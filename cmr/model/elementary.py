"""Vectorisable sine, cosine and exponential as polynomials; calls of libm prevent vectorisation.

Arguments are reduced by a multiple of pi, or of ln 2, held in three parts (Cody and Waite, 1980): products with the
first two are exact for multiples below 2^23. The polynomials interpolate at Chebyshev points. Errors: sine and cosine
6e-16 absolute for angles up to 1e6 rad, mostly 2e-16; `exp` and `expm1` 4e-16 relative.
"""

import numpy as np

from cmr.model.compiled import inlined

ROUND = 6755399441055744.0  # 1.5 * 2^52: adding and subtracting it rounds to whole numbers, and vectorises
PI_1, PI_2, PI_3 = 3.141592651605606, 1.9841871583270443e-09, 1.034036596358821e-18
LN2_1, LN2_2, LN2_3 = 0.6931471796706319, 8.893134232496047e-10, 6.390629507645039e-19
ONE_OVER_PI, ONE_OVER_LN2 = 0.3183098861837907, 1.4426950408889634
LOWEST, HIGHEST = -708.0, 709.0  # arguments whose exponential is a normal number
MANTISSA_BITS, EXPONENT_BIAS = 52, 1023


@inlined
def sincos(angle: float) -> tuple[float, float]:
    """Return sine and cosine of any angle [rad]."""
    turns = (angle * ONE_OVER_PI + ROUND) - ROUND
    r = ((angle - turns * PI_1) - turns * PI_2) - turns * PI_3
    odd = turns - 2.0 * ((turns * 0.5 + ROUND) - ROUND)
    sign = 1.0 - 2.0 * odd * odd
    z = r * r
    sine = -7.374387503862757e-13
    sine = 1.6048168318165643e-10 + z * sine
    sine = -2.505188194671259e-08 + z * sine
    sine = 2.7557316609073673e-06 + z * sine
    sine = -0.00019841269824861897 + z * sine
    sine = 0.008333333333282756 + z * sine
    sine = r + r * (z * (-0.16666666666666072 + z * sine))
    cosine = 4.608977003001797e-14
    cosine = -1.1462901901757276e-11 + z * cosine
    cosine = 2.0876561839933163e-09 + z * cosine
    cosine = -2.755731639102575e-07 + z * cosine
    cosine = 2.4801587277414926e-05 + z * cosine
    cosine = -0.001388888888877299 + z * cosine
    cosine = 0.04166666666666388 + z * cosine
    cosine = 1.0 + z * (-0.4999999999999997 + z * cosine)
    return sign * sine, sign * cosine


@inlined
def sin(angle: float) -> float:
    """Return the sine of any angle [rad]."""
    return sincos(angle)[0]


@inlined
def cos(angle: float) -> float:
    """Return the cosine of any angle [rad]."""
    return sincos(angle)[1]


@inlined
def sincos_small(angle: float) -> tuple[float, float]:
    """Return sine and cosine of an angle of at most 0.3 rad; errors 4e-14 and 2e-12 there, less by angle^11 and ^10."""
    z = angle * angle
    sine = angle * (1.0 + z * (-1 / 6 + z * (1 / 120 + z * (-1 / 5040 + z * (1 / 362880)))))
    cosine = 1.0 + z * (-0.5 + z * (1 / 24 + z * (-1 / 720 + z * (1 / 40320))))
    return sine, cosine


@inlined
def expm1_small(x: float) -> float:
    """Return e^x - 1 for |x| of at most ln(2) / 2."""
    p = 2.5100472505694996e-08
    p = 2.7620201591031547e-07 + x * p
    p = 2.7557268276905696e-06 + x * p
    p = 2.4801521057868204e-05 + x * p
    p = 0.00019841269863171557 + x * p
    p = 0.0013888888917367081 + x * p
    p = 0.008333333333330039 + x * p
    p = 0.041666666666623824 + x * p
    p = 0.16666666666666669 + x * p
    return x + x * x * (0.5 + x * p)


@inlined
def sinh_and_cosh_minus_1(x: float) -> tuple[float, float]:
    """Return sinh(x) and cosh(x) - 1 for |x| of at most 0.2; relative errors 2e-15 there, less by x^8."""
    z = x * x
    sinh = x * (1.0 + z * (1 / 6 + z * (1 / 120 + z * (1 / 5040 + z * (1 / 362880)))))
    return sinh, z * (0.5 + z * (1 / 24 + z * (1 / 720 + z * (1 / 40320))))


@inlined
def _power_and_rest(x: float) -> tuple[float, float]:
    """Return the power of two nearest to e^x, and the relative excess of e^x."""
    bounded = min(max(x, LOWEST), HIGHEST)
    shifted = bounded * ONE_OVER_LN2 + ROUND
    doublings = shifted - ROUND
    r = ((bounded - doublings * LN2_1) - doublings * LN2_2) - doublings * LN2_3
    p = expm1_small(r)
    # The low bits of `shifted` are the exponent: shifted to the exponent field, they are that power of 2.
    exponent = (np.float64(shifted).view(np.int64) + EXPONENT_BIAS) << MANTISSA_BITS
    power = np.int64(exponent).view(np.float64)
    return power, p


@inlined
def expm1(x: float) -> float:
    """Return e^x - 1, precise near 0 too; x is clipped to [-708, 709]."""
    power, p = _power_and_rest(x)
    return power * p + (power - 1.0)


@inlined
def exp(x: float) -> float:
    """Return e^x, bounded as in `expm1`."""
    power, p = _power_and_rest(x)
    return power * p + power
