"""Format numbers as in a paper: known digits only, true minus signs, a dash for missing ones."""

import math
import re
from collections.abc import Sequence

UNKNOWN = "\u2013"  # a dash for unknown numbers
SUPERSCRIPTS = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
MINUS = str.maketrans("-", "\u2212")
MOST_DECIMALS, LEAST, LARGEST = 6, 1e-4, 1e7  # beyond, powers of ten are written
SMALLEST_CHANCE = 1e-300  # smaller values are rounding errors


def number(value: float | None, digits: int = 4) -> str:
    """Return a number with this many significant digits."""
    if value is None or math.isnan(value):
        return UNKNOWN
    if value == 0.0 or math.isinf(value):
        return f"{value:.0f}".replace("inf", "\u221e").replace("-0", "0").translate(MINUS)
    if not LEAST <= abs(value) < LARGEST:
        return _power_of_ten(value, digits)
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])  # after rounding: 9.99 may become 10.0
    return fixed(value, max(digits - 1 - exponent, 0))


def fixed(value: float, decimals: int) -> str:
    """Return a finite number with this many decimals."""
    return f"{value:,.{decimals}f}".translate(MINUS)


def likelihood(value: float) -> str:
    """Format a difference of log-likelihoods with one decimal."""
    return fixed(value, 1) if math.isfinite(value) else number(value)


def alike(values: Sequence[float], digits: int = 2) -> list[str]:
    """Format numbers with equal decimals, such that the smallest has this many significant digits."""
    sizes = [abs(value) for value in values if math.isfinite(value) and value]
    decimals = max(digits - 1 - math.floor(math.log10(min(sizes))), 0) if sizes else 0
    if decimals > MOST_DECIMALS:
        return [number(value, digits) for value in values]
    return [fixed(value, decimals) if math.isfinite(value) else number(value) for value in values]


def rounded(value: float, std: float) -> str:
    """Return a value rounded to two digits of its standard deviation; to four significant digits if that is unknown."""
    if not (math.isfinite(value) and math.isfinite(std) and std > 0.0):
        return number(value)
    decimals = max(1 - math.floor(math.log10(std)), 0)
    return fixed(value, decimals) if decimals <= MOST_DECIMALS else number(value, 3)


def with_sign(value: float, text: str) -> str:
    """Prepend a plus sign to the text of a positive number."""
    return f"+{text}" if value > 0.0 else text


def unit_text(unit: str) -> str:
    """Format a unit to follow a number; empty for "-"."""
    return "" if unit == "-" else typeset(unit)


def typeset(text: str) -> str:
    """Return a text for a page: exponents, as in rad/s^2, are raised; minus and plus-minus get their own characters."""
    text = re.sub(r"\^(-?\d+)", lambda match: match[1].translate(SUPERSCRIPTS), text).replace("+-", "\u00b1")
    return re.sub(r"(?<!\S)-(?=[\d ])|(?<=\()-(?=\d)", "\u2212", text)


def given(value: float, unit: str) -> str:
    """Format a number without a standard deviation, with its unit."""
    text = f"{value:.6g}".translate(MINUS) if LEAST <= abs(value) < LARGEST else number(value)
    return f"{text} {unit_text(unit)}".rstrip()


def chance(p_value: float) -> str:
    """Format a probability with a relation sign: "= 0.013", "< 10^-300"."""
    if math.isnan(p_value):
        return f"= {UNKNOWN}"
    if p_value < SMALLEST_CHANCE:
        return f"< {_power_of_ten(SMALLEST_CHANCE, 1).rpartition(' ')[2]}"
    return f"= {number(p_value, 2)}"


def _power_of_ten(value: float, digits: int) -> str:
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa} \u00d7 10{str(int(exponent)).translate(SUPERSCRIPTS)}".translate(MINUS)
