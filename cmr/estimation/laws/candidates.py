"""All candidate laws: products of a few factors at each place of the model, the simplest first.

A factor is a piece of text in the grammar of formulas. Of two quantities of motion, products up to the third degree are
formed in every even and odd variant, each also multiplied by a possible modulation: heading, position, time, charge
drawn, rotation, past values, or another quantity at its limit.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache

from cmr.model.laws.places import PLACES

DEGREES = 3  # highest degree of products of two quantities
POWERS = {
    0: ("1",),
    1: ("{0}", "abs({0})"),
    2: ("{0} ** 2", "{0} * abs({0})"),
    3: ("{0} ** 3", "abs({0}) ** 3"),
}
HEADINGS = (("cos(theta)", "sin(theta)"), ("cos(2 * theta)", "sin(2 * theta)"))
PLACE_FACTORS = ("x", "y", "(x ** 2 + y ** 2)")
TIMES = ("t", "t ** 2")
SLOW = (1.5, 5.0, 15.0)  # s, time constants of smoothing
SINCE = (0.3, 1.0, 3.0)  # s since the turn reversed
WAYS = (0.05, 0.15, 0.5)  # m since the turn reversed
DECAYS = (5.0, 20.0, 60.0)  # s since the start
SHARES = (0.15, 0.35, 0.7)  # of a quantity's usual size, at which it saturates or begins
SENSORS = tuple(name for name, place in PLACES.items() if place.of_sensors)


@dataclass(frozen=True)
class Candidate:
    """A law to be tested: each formula is the product of its `factors`; of several, each has a coefficient.

    The factors of the second and later formulas are in `others`. `size` counts factors with their degree, to order laws
    by simplicity. `constants` are the values named in factors; those `scaled` are shares of the usual size of a
    quantity in the drive, given by name. `reach` is the largest error of a constant, in its unit.
    """

    place: str
    factors: tuple[str, ...]
    size: int
    side: str = ""
    others: tuple[tuple[str, ...], ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)
    scaled: str = ""
    reach: Mapping[str, float] = field(default_factory=dict)

    @property
    def formulas(self) -> tuple[str, ...]:
        """The formulas in the grammar, one for each coefficient."""
        return tuple(" * ".join(factors) for factors in (self.factors, *self.others))

    @property
    def count(self) -> int:
        """How many formulas there are, each with a coefficient."""
        return 1 + len(self.others)

    @property
    def all_factors(self) -> tuple[tuple[str, ...], ...]:
        """The factors of each formula."""
        return (self.factors, *self.others)

    @property
    def key(self) -> tuple[str, str, tuple[str, ...]]:
        """The identity of a law apart from its constants: place, side and formulas."""
        return self.place, self.side, self.formulas

    def on(self, side: str) -> "Candidate":
        """Return the same law for other wheels."""
        return replace(self, side=side)

    def with_constants(self, constants: Mapping[str, float]) -> "Candidate":
        """Return the same law with other constants."""
        return replace(self, constants=constants)


@cache
def candidates() -> tuple[Candidate, ...]:
    """Return all laws of the body, the sensors and, without a side, the wheels."""
    return (
        *(one for place in ("forward_speed", "yaw_rate", "lateral_speed") for one in _of_body(place)),
        *(one for place in SENSORS for one in _of_sensor(place)),
        *(one for place in ("wheel_voltage", "encoder_rate", "wheel_slip") for one in _of_wheel(place)),
    )


def _products(one: str, other: str, degree: int = DEGREES) -> Iterator[tuple[tuple[str, ...], int]]:
    """Yield products of two quantities up to a degree, each in its factors with its size."""
    for first in range(degree + 1):
        for second in range(degree + 1 - first):
            for a in POWERS[first]:
                for b in POWERS[second]:
                    factors = tuple(text for text in (a.format(one), b.format(other)) if text != "1")
                    yield factors or ("1",), max(first + second, 1)
    for second in range(degree):
        for b in POWERS[second]:
            yield tuple(text for text in (f"sign({one})", b.format(other)) if text != "1"), 1 + second
            if second:
                yield (f"sign({other})", *((b.format(one),))), 1 + second
    yield (f"sign({other})",), 1
    yield (f"sign({one})", f"sign({other})"), 2


def _of_body(place: str) -> Iterator[Candidate]:
    for factors, size in _products("v", "w"):
        base = Candidate(place, factors, size)
        yield base
        degree = size
        if degree <= 2:
            yield from _modulated(base)
            yield from _remembering(base, ("abs(w)", "abs(v)"))
    for name in ("dv", "dw"):
        yield Candidate(place, (name,), 1)
        yield Candidate(place, (f"abs({name})",), 1)
        yield Candidate(place, (name, "abs(v)"), 2)
        yield Candidate(place, (name, "abs(w)"), 2)
    yield from _limited(place, ("v", "w", "v * w"))


def _of_sensor(place: str) -> Iterator[Candidate]:
    if place == "pose_lateness":
        yield Candidate(place, ("t ** 2",), 2)  # a term linear in t is clock skew, which is in the catalogue
        return
    degree = 2 if place in ("pose_x", "pose_y") else DEGREES
    for factors, size in _products("v", "w", degree):
        base = Candidate(place, factors, size)
        yield base
        if size <= 1:
            yield from _modulated(base)
    yield from (Candidate(place, factors, 2) for factors in (("x ** 2",), ("y ** 2",), ("x", "y")))
    yield from _limited(place, ("v", "w"))


def _of_wheel(place: str) -> Iterator[Candidate]:
    """Yield laws of wheels, none with the wheel's own acceleration.

    At the motor that would be its gain, and at the encoder its latency, which the model and the catalogue contain.
    """
    own, other = ("s", "u") if place == "wheel_voltage" else ("psi", "u")
    for factors, size in _products(own, other):
        base = Candidate(place, factors, size)
        yield base
        if (size <= 2 and not any("u" in factor for factor in factors)) or factors == ("u",):
            yield from _modulated(base)
            yield from _remembering(base, ("abs(w)", "abs(psi)", "u ** 2", "load"))
    further: list[tuple[str, ...]] = [
        ("other_psi",),
        ("other_u",),
        ("abs(other_psi)",),
        ("abs(other_u)",),
        ("abs(domega)",),
    ]
    further += [("other_domega",), ("load",), ("load", "u"), ("load", own), ("load ** 2",), ("load", f"sign({own})")]
    further += [("effort", "abs(effort)"), ("effort ** 3",), ("abs(effort)",), ("effort", f"abs({own})")]
    further += [(own, "abs(effort)"), (f"sign({own})", "abs(effort)"), ("effort", "load"), (f"sign({own})", "abs(w)")]
    further += [(f"sign({own})", "abs(v)"), ("w", "abs(w)"), ("v", "abs(w)"), ("v", "w"), ("w ** 2",), (own, "abs(w)")]
    further += [("w",), ("abs(w)",), ("v ** 2",), ("u", "abs(w)"), ("u", "abs(v)"), ("effort", "abs(w)")]
    further += [("other_psi", "abs(other_psi)"), ("other_psi", f"abs({own})"), ("other_u", f"abs({own})")]
    further += [("sign(effort)",)]
    for factors in further:
        yield Candidate(place, factors, len(factors) + sum("**" in factor for factor in factors))
    yield from _limited(place, (own, "u", "effort", "w"))
    current = Candidate(place, ("effort",), 1)
    yield from _modulated(current)
    yield from _remembering(current, ("effort ** 2", "abs(w)", "load"))
    yield from _fading(place, own)
    yield Candidate(place, ("x", "cos(theta)"), 2, others=(("y", "sin(theta)"),))
    yield Candidate(place, ("y", "cos(theta)"), 2, others=(("x", "sin(theta)"),))


def _fading(place: str, name: str) -> Iterator[Candidate]:
    """Yield terms that act only at low speed: the sign of the speed, times a decay with speed."""
    for share in SHARES:
        factors = f"sign({name})", f"exp(-abs({name}) / fade)"
        yield Candidate(place, factors, 2, constants={"fade": share}, scaled=name)


def _modulated(base: Candidate) -> Iterator[Candidate]:
    """Yield a law modulated by heading, position or time."""
    factors = tuple(factor for factor in base.factors if factor != "1")
    for number, (cosine, sine) in enumerate(HEADINGS):
        size = base.size + 1 + number
        yield replace(base, factors=(*factors, cosine), others=((*factors, sine),), size=size)
    for text in (*PLACE_FACTORS, *TIMES):
        yield replace(base, factors=(*factors, text), size=base.size + (2 if "**" in text else 1))
    if base.size <= 1:
        for seconds in DECAYS:
            decaying = (*factors, "exp(-t / decay)")
            yield replace(base, factors=decaying, size=base.size + 1, constants={"decay": seconds})


def _remembering(base: Candidate, smoothed: tuple[str, ...]) -> Iterator[Candidate]:
    """Yield a law modulated by past values."""
    factors = tuple(factor for factor in base.factors if factor != "1")
    yield replace(base, factors=(*factors, "charge"), size=base.size + 1)
    for scales, name, what in ((SINCE, "since_turn", "since"), (WAYS, "way_since_turn", "way")):
        for scale in scales:
            text = f"exp(-{name} / {what})"
            yield replace(base, factors=(*factors, text), size=base.size + 1, constants={what: scale})
    for text in smoothed:
        for seconds in SLOW:
            behind = f"low_pass({text}, memory)"
            yield replace(base, factors=(*factors, behind), size=base.size + 1, constants={"memory": seconds})


def _limited(place: str, names: tuple[str, ...]) -> Iterator[Candidate]:
    """Yield quantities with a saturation, smooth or hard, or with a dead zone."""
    for name in names:
        for share in SHARES:
            constants, scaled = {"limit": share}, name
            for text in ("tanh({0} / limit)", "clip({0}, limit)", "dead_zone({0}, limit)"):
                yield Candidate(place, (text.format(name),), 2, constants=constants, scaled=scaled)
