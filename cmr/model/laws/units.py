"""Units of formulas: the unit of each part, those required of constants, and consistency of sums.

A unit is a set of exponents of m, s and rad. An angle counts as a number in sums and comparisons: 1 rad is 1 m/m.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

BASE = ("m", "s", "rad")
Unit = tuple[int, int, int]
NUMBER: Unit = (0, 0, 0)
ANGLE: Unit = (0, 0, 1)
FACTOR = re.compile(r"(m|s|rad)(?:\^(\d+))?")


def unit_of(text: str) -> Unit:
    """Return the exponents of a unit in text such as "rad/s^2" or "m s/rad^2"; "-" and "1/m" are units too.

    Raises ValueError for other text.
    """
    above, _, below = text.partition("/")
    exponents = dict.fromkeys(BASE, 0)
    for part, sign in ((above, 1), (below, -1)):
        for factor in part.split():
            match = FACTOR.fullmatch(factor)
            if match:
                exponents[match[1]] += sign * int(match[2] or 1)
            elif factor not in ("1", "-"):
                raise ValueError(f"{text!r} is no unit of m, s and rad")
    return exponents["m"], exponents["s"], exponents["rad"]


def unit_text(unit: Unit) -> str:
    """Format a unit as in the catalogue: "rad/s^2", "1/m", "-"."""
    names = (2, 0, 1)  # rad, m, s: "rad s/m^2"
    above = [_power(BASE[k], unit[k]) for k in names if unit[k] > 0]
    below = [_power(BASE[k], -unit[k]) for k in (0, 1, 2) if unit[k] < 0]
    if not above and not below:
        return "-"
    return (" ".join(above) or "1") + ("/" + " ".join(below) if below else "")


def per(unit: Unit, other: Unit) -> Unit:
    """Return the quotient of two units."""
    return unit[0] - other[0], unit[1] - other[1], unit[2] - other[2]


def _power(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"


@dataclass(frozen=True)
class Measure:
    """The unit of a part of a formula, times powers of constants with unknown units.

    A bare number has `any` unit when added to a quantity. A value `scaled` by a number has any unit where a function
    requires one, as in exp(-t / 1.5).
    """

    unit: Unit = NUMBER
    unknown: Mapping[str, int] = field(default_factory=dict)
    any: bool = False
    scaled: bool = False

    def times(self, other: "Measure", power: int = 1) -> "Measure":
        """Return the measure of a product with a power of another."""
        unit = tuple(a + power * b for a, b in zip(self.unit, other.unit, strict=True))
        powers = dict(self.unknown)
        for name, exponent in other.unknown.items():
            powers[name] = powers.get(name, 0) + power * exponent
        unknown = {name: exponent for name, exponent in powers.items() if exponent}
        scaled = self.scaled or other.scaled or self.any or other.any
        return Measure((unit[0], unit[1], unit[2]), unknown, self.any and other.any, scaled)


class Constants:
    """The known units of the constants of a formula."""

    def __init__(self) -> None:
        self.known: dict[str, Unit] = {}

    def of(self, name: str) -> Measure:
        """Return the measure of a constant."""
        return Measure(self.known[name]) if name in self.known else Measure(unknown={name: 1})

    def resolved(self, measure: Measure) -> Measure:
        """Return a measure with all units known by now."""
        result = Measure(measure.unit)
        for name, power in measure.unknown.items():
            result = result.times(self.of(name), power)
        return Measure(result.unit, result.unknown, measure.any, measure.scaled)

    def require(self, measure: Measure, unit: Unit) -> None:
        """Require a unit of a measure, which may determine that of a constant.

        Raises ValueError if it has another unit, or several constants leave it open.
        """
        measure = self.resolved(measure)
        if measure.any:
            return
        if not measure.unknown:
            if measure.unit[:2] != unit[:2] and not measure.scaled:
                raise ValueError(f"has the unit {unit_text(measure.unit)}, must have {unit_text(unit)}")
            return
        (name, power), *more = measure.unknown.items()
        missing = per(unit, measure.unit)
        if more or any(exponent % power for exponent in missing):
            raise ValueError(f"leaves the unit of {' and '.join(measure.unknown)} open")
        self.known[name] = (missing[0] // power, missing[1] // power, missing[2] // power)

    def alike(self, one: Measure, other: Measure) -> Measure:
        """Return the measure of a sum.

        Raises ValueError unless both may have the same unit.
        """
        one, other = self.resolved(one), self.resolved(other)
        if one.any:
            one, other = other, one
        if other.any and one.unknown:
            self.require(one, NUMBER)  # "1 + v / limit"
        elif one.unknown and one == other:
            return one
        elif one.unknown and other.unknown:
            raise ValueError(f"leaves the unit of {' and '.join({**one.unknown, **other.unknown})} open")
        elif one.unknown:
            self.require(one, other.unit)
        else:
            self.require(replace(other, scaled=False), one.unit)
        return self.resolved(one)
