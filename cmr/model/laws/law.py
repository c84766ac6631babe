"""A law: one to three formulas at one place in the model, each with a coefficient."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cmr.model.laws.grammar import CONSTANT, MOST_CONSTANTS, Formula, FormulaError, parse
from cmr.model.laws.places import PLACES, SIDES, Place
from cmr.model.laws.units import Unit, per, unit_of, unit_text
from cmr.model.laws.words import FUNCTIONS, VARIABLES

PREFIX = "law_"  # reserved prefix: names of laws become names in the compiled step
NAME = re.compile(PREFIX + r"[a-z0-9]+(?:_[a-z0-9]+)*", re.ASCII)
LONGEST_NAME, LONGEST_DESCRIPTION = 64, 500
MOST_FORMULAS = 3
LARGEST = 1e6  # of a coefficient or constant: a bound that is never reached


class LawError(ValueError):
    """A law is invalid; the text says what is wrong, `within` where, as keys of a document."""

    def __init__(self, text: str, *within: str) -> None:
        super().__init__(text)
        self.within = within


@dataclass(frozen=True)
class Law:
    """Physics that no entry of the catalogue describes, as a formula.

    `place` is a key of PLACES; `side`, of a place at the wheels, says which wheels: both, the right one with the
    opposite sign ("opposite"), or one. The quantity there is increased by the sum of `formulas`, each times its
    coefficient: the parameter `name` where there is one formula, `name`_1 to `name`_3 where there are more. `constants`
    are the values of constants in formulas, such as a frequency: the parameters `name`_constant. `description` is free
    text. Raises LawError, a ValueError, on construction if it is not in the grammar.
    """

    name: str
    place: str
    formulas: tuple[str, ...]
    side: str = ""
    constants: Mapping[str, float] = field(default_factory=dict, hash=False)
    description: str = ""

    def __post_init__(self) -> None:
        _check_name(self.name)
        if not isinstance(self.place, str) or self.place not in PLACES:
            raise LawError(f"must be one of {', '.join(PLACES)}, not {self.place!r:.80}", "place")
        _check_side(self.side, PLACES[self.place])
        _check_constants(self.constants)
        if not isinstance(self.formulas, tuple) or not 1 <= len(self.formulas) <= MOST_FORMULAS:
            raise LawError(f"must be a list of 1 to {MOST_FORMULAS} formulas", "formulas")
        _check_formulas(self)
        _check_description(self.description)

    @cached_property
    def parsed(self) -> tuple[Formula, ...]:
        """The formulas, parsed.

        Raises FormulaError for one that is not in the grammar.
        """
        return tuple(parse(text, tuple(self.constants)) for text in self.formulas)

    @property
    def at(self) -> Place:
        """The place where it acts."""
        return PLACES[self.place]

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The names of the parameters that are its coefficients, one for each formula."""
        if len(self.formulas) == 1:
            return (self.name,)
        return tuple(f"{self.name}_{number}" for number in range(1, len(self.formulas) + 1))

    @property
    def units(self) -> dict[str, str]:
        """The units of its coefficients, then of its constants, by the names of their parameters."""
        found = {
            name: unit_text(per(unit_of(self.at.unit), formula.unit))
            for name, formula in zip(self.coefficients, self.parsed, strict=True)
        }
        known = {name: unit for formula in self.parsed for name, unit in formula.constant_units.items()}
        return found | {self.parameter_of(name): unit_text(known[name]) for name in self.constants}

    def parameter_of(self, constant: str) -> str:
        """Return the name of the parameter that holds a constant."""
        return f"{self.name}_{constant}"

    def is_same(self, other: "Law") -> bool:
        """Return whether another law is the same apart from the values of constants."""
        mine, its = (
            (one.name, one.place, one.side, one.formulas, tuple(sorted(one.constants))) for one in (self, other)
        )
        return mine == its


def _check_name(name: object) -> None:
    if not isinstance(name, str) or len(name) > LONGEST_NAME or not NAME.fullmatch(name):
        raise LawError(
            f"must be {PREFIX} and words of small letters and digits between underscores, at most {LONGEST_NAME} "
            f"characters, not {name!r:.80}",
            "name",
        )


def _check_side(side: object, place: Place) -> None:
    allowed = SIDES if place.per_side else ("",)
    if not isinstance(side, str) or side not in allowed:
        expected = f"one of {', '.join(SIDES)}" if place.per_side else "left out: this place has no sides"
        raise LawError(f"must be {expected}, not {side!r:.80}", "side")


def _check_constants(constants: object) -> None:
    if not isinstance(constants, Mapping) or len(constants) > MOST_CONSTANTS:
        raise LawError(f"must be a mapping of at most {MOST_CONSTANTS} names to numbers", "constants")
    for name, value in constants.items():
        if not isinstance(name, str) or len(name) > LONGEST_NAME or not CONSTANT.fullmatch(name):
            raise LawError(f"a constant needs a name of small letters and digits, not {name!r:.80}", "constants")
        if name in VARIABLES or name in FUNCTIONS or name.isdigit():
            raise LawError(f"the name {name} is taken by a variable or function", "constants", name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
            raise LawError(f"must be a number of at most {LARGEST:g} either way, not {value!r:.80}", "constants", name)
        if math.isnan(value):
            raise LawError("must be a number", "constants", name)


def _check_description(text: object) -> None:
    """Raise LawError for text with characters that affect a terminal or a page, such as a line break."""
    if not isinstance(text, str) or len(text) > LONGEST_DESCRIPTION or not text.isprintable():
        raise LawError(f"must be printable text on one line, at most {LONGEST_DESCRIPTION} characters", "description")


def _check_formulas(law: Law) -> None:
    try:
        formulas = law.parsed
    except FormulaError as error:
        raise LawError(str(error), "formulas") from None
    if len({formula.text for formula in formulas}) < len(formulas):
        raise LawError("the same formula is there twice", "formulas")
    named = {name for formula in formulas for name in formula.constants}
    if named != set(law.constants):
        raise LawError(f"no formula names {', '.join(sorted(set(law.constants) - named))}", "constants")
    _check_units_of_constants(formulas)
    for formula in formulas:
        beyond = [name for name in formula.variables if name not in law.at.variables]
        if beyond:
            raise LawError(
                f"{formula.text!r} reads {', '.join(beyond)}, which {law.place} does not have; it has "
                f"{', '.join(law.at.variables)}",
                "formulas",
            )
        if law.at.of_sensors and any(part.kind == "low_pass" for part in formula.root.walk()):
            raise LawError(f"{formula.text!r} has a memory, and a law of a sensor keeps none", "formulas")
        _check_divisors(law, formula)


def _check_units_of_constants(formulas: tuple[Formula, ...]) -> None:
    units: dict[str, Unit] = {}
    for formula in formulas:
        for name, unit in formula.constant_units.items():
            if units.setdefault(name, unit) != unit:
                raise LawError(f"has units {unit_text(units[name])} and {unit_text(unit)}", "constants", name)


def _check_divisors(law: Law, formula: Formula) -> None:
    """Raise LawError if a constant used as divisor or time constant is not positive."""
    for name in positive_constants(formula):
        if law.constants[name] <= 0.0:
            raise LawError(f"must be positive: {formula.text!r} divides by it", "constants", name)


def positive_constants(formula: Formula) -> set[str]:
    """Return the constants that must be positive: divisors and time constants."""
    dividing = (part.parts[1] for part in formula.root.walk() if part.kind in ("/", "low_pass"))
    return {part.name for part in dividing if part.kind == "name"}
