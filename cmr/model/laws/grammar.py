"""The closed grammar of formulas: text is parsed into a tree of known names, numbers and operations, or rejected.

A formula is data from an untrusted file. Its length is limited before parsing, its depth during parsing and its size
afterwards; names must be known variables, known functions or constants declared by the law.

    sum     := product (("+" | "-") product)*
    product := power (("*" | "/") power)*          a divisor has no variable
    power   := "-" power | atom ["**" whole number]
    atom    := number | name | name "(" sum ("," sum)* ")" | "(" sum ")"
"""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from cmr.model.laws.tree import Part
from cmr.model.laws.units import ANGLE, NUMBER, Constants, Measure, Unit, unit_of
from cmr.model.laws.words import FUNCTIONS, VARIABLES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LONGEST, DEEPEST, MOST_PARTS = 300, 12, 60  # characters, nesting of brackets and signs, parts of the tree
LARGEST_POWER = 4
MOST_CONSTANTS = 6
SMALLEST, LARGEST = 1e-9, 1e9  # magnitude of a number other than 0
TOKEN = re.compile(
    r" *(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)|(?P<name>[a-z][a-z0-9_]*)|(?P<sign>\*\*|[-+*/(),]))",
    re.ASCII,
)
CONSTANT = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*", re.ASCII)


class FormulaError(ValueError):
    """A formula is not in the grammar; the text says what is wrong, and at which character."""


@dataclass(frozen=True)
class Formula:
    """A valid formula."""

    text: str
    root: Part
    constant_units: Mapping[str, Unit] = field(hash=False)
    measured: Unit

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables read, in the order of VARIABLES."""
        return tuple(name for name in VARIABLES if name in self.root.names)

    @property
    def constants(self) -> tuple[str, ...]:
        """The constants named, in the order of the text."""
        named = (part.name for part in self.root.walk() if part.kind == "name" and part.name not in VARIABLES)
        return tuple(dict.fromkeys(named))

    @property
    def unit(self) -> Unit:
        """The unit of its value."""
        return self.measured

    def evaluate(self, variables: Mapping[str, "Floats | float"]) -> "Floats":
        """Return its value for arrays of variables and constants by name, which broadcast.

        `low_pass` also needs `dt` [s], the step from each row to the next; along the first axis, starting at 0.
        """
        from cmr.model.laws.evaluating import evaluate

        return evaluate(self.root, variables)


def parse(text: str, constants: Collection[str] = ()) -> Formula:
    """Parse a formula, in which `constants` are known.

    Raises FormulaError, a ValueError, with the error and its position.
    """
    if not isinstance(text, str) or not text.strip(" "):
        raise FormulaError("a formula is text such as v * abs(w)")
    if len(text) > LONGEST:
        raise FormulaError(f"a formula has at most {LONGEST} characters, this one {len(text)}")
    root = _Reader(text, constants).formula()
    if sum(1 for _ in root.walk()) > MOST_PARTS:
        raise FormulaError(f"{text!r} has more than {MOST_PARTS} parts")
    if root.names.isdisjoint(VARIABLES) and root.kind != "number":
        raise FormulaError(f"{text!r} reads no variable; where nothing varies, write 1")
    units = Constants()
    measured = units.resolved(_measure(root, units, text))
    _measure(root, units, text)  # a second pass applies the units learned in the first
    if measured.unknown:
        raise FormulaError(
            f"{text!r}: the constant {' and '.join(measured.unknown)} scales the formula, as its coefficient does"
        )
    return Formula(text, root, dict(units.known), measured.unit)


class _Reader:
    """Parser of one text."""

    def __init__(self, text: str, constants: Collection[str]) -> None:
        self._text, self._constants = text, constants
        self._tokens = list(_tokens(text))
        self._next = 0
        self._depth = 0

    def formula(self) -> Part:
        """Parse the whole text."""
        part = self._sum()
        if self._kind != "end":
            raise self._error(f"expected an operator or the end, not {self._token[1]!r}")
        return part

    @property
    def _token(self) -> tuple[str, str, int]:
        return self._tokens[self._next]

    @property
    def _kind(self) -> str:
        kind, text, _ = self._token
        return text if kind == "sign" else kind

    def _taken(self) -> tuple[str, int]:
        _, text, at = self._token
        self._next += 1
        return text, at

    def _error(self, text: str, at: int | None = None) -> FormulaError:
        return FormulaError(f"{self._text!r}, character {(self._token[2] if at is None else at) + 1}: {text}")

    def _sum(self) -> Part:
        self._depth += 1
        if self._depth > DEEPEST:
            raise self._error(f"more than {DEEPEST} brackets within one another")
        part = self._product()
        while self._kind in ("+", "-"):
            sign, at = self._taken()
            part = Part(sign, at, parts=(part, self._product()))
        self._depth -= 1
        return part

    def _product(self) -> Part:
        part = self._power()
        while self._kind in ("*", "/"):
            sign, at = self._taken()
            other = self._power()
            if sign == "/" and not other.names.isdisjoint(VARIABLES):
                raise self._error("a divisor must be a number or a constant: a variable may be 0", at)
            if sign == "/" and other.kind == "number" and other.number == 0.0:
                raise self._error("this divides by 0", at)
            if sign == "/" and other.kind not in ("number", "name"):
                raise self._error("a divisor must be one number or one constant", at)
            part = Part(sign, at, parts=(part, other))
        return part

    def _power(self) -> Part:
        if self._kind == "-":
            _, at = self._taken()
            self._depth += 1
            if self._depth > DEEPEST:
                raise self._error(f"more than {DEEPEST} signs within one another", at)
            part = Part("negative", at, parts=(self._power(),))
            self._depth -= 1
            return part
        part = self._atom()
        if self._kind != "**":
            return part
        _, at = self._taken()
        text, where = self._taken()
        if text not in [str(n) for n in range(2, LARGEST_POWER + 1)]:
            raise self._error(f"a power must be a whole number of 2 to {LARGEST_POWER}, not {text!r}", where)
        if self._kind == "**":
            raise self._error("a power of a power: put brackets around the first")
        return Part("**", at, number=float(text), parts=(part,))

    def _atom(self) -> Part:
        kind = self._kind
        if kind not in ("number", "name", "("):
            raise self._error(f"expected a number, a name or a bracket, not {self._token[1] or 'the end'!r}")
        text, at = self._taken()
        if kind == "number":
            number = float(text)
            if number != 0.0 and not SMALLEST <= number <= LARGEST:
                raise self._error(f"{text} is no number of {SMALLEST:g} to {LARGEST:g}", at)
            return Part("number", at, number=number)
        if kind == "(":
            part = self._sum()
            self._expect(")")
            return part
        return self._call(text, at) if self._kind == "(" else self._name(text, at)

    def _name(self, name: str, at: int) -> Part:
        if name not in VARIABLES and name not in self._constants:
            known = ", ".join((*VARIABLES, *self._constants))
            raise self._error(f"unknown name {name!r}; known are {known}", at)
        return Part("name", at, name=name)

    def _call(self, name: str, at: int) -> Part:
        if name not in FUNCTIONS:
            raise self._error(f"unknown function {name!r}; known are {', '.join(FUNCTIONS)}", at)
        function = FUNCTIONS[name]
        self._expect("(")
        parts = [self._sum()]
        while self._kind == ",":
            self._taken()
            parts.append(self._sum())
        self._expect(")")
        if len(parts) != function.arguments:
            raise self._error(f"{name} takes {function.arguments} arguments, not {len(parts)}", at)
        for part in parts[len(parts) - function.constants :]:
            if not _is_constant(part):
                raise self._error(f"{name} takes a number or a constant here", part.at)
        if name == "sign" and not (parts[0].kind == "name" and parts[0].name in VARIABLES):
            raise self._error("sign takes a variable; of anything else use tanh(... / scale)", at)
        if name == "low_pass" and any(part.kind == "low_pass" for part in parts[0].walk()):
            raise self._error("a low_pass within a low_pass", at)
        if name == "low_pass" and parts[1].kind != "name" and not parts[1].number > 0.0:
            raise self._error("a time constant must be positive", parts[1].at)
        return Part(name, at, parts=tuple(parts))

    def _expect(self, sign: str) -> None:
        if self._kind != sign:
            raise self._error(f"expected {sign!r}, not {self._token[1] or 'the end'!r}")
        self._taken()


def _is_constant(part: Part) -> bool:
    """Return whether a part is a number, with or without a sign, or a constant."""
    if part.kind == "negative":
        return part.parts[0].kind == "number"
    return part.kind == "number" or (part.kind == "name" and part.name not in VARIABLES)


def _tokens(text: str) -> Iterator[tuple[str, str, int]]:
    """Yield kind, text and position of each token; "end" is the last."""
    at = 0
    while text[at:].strip(" "):
        match = TOKEN.match(text, at)
        if match is None:
            at += len(text[at:]) - len(text[at:].lstrip(" "))
            raise FormulaError(f"{text!r}, character {at + 1}: {text[at]!r} is no part of a formula")
        kind = str(match.lastgroup)
        yield kind, match[kind], match.start(kind)
        at = match.end()
    yield "end", "", len(text)


def _measure(part: Part, units: Constants, text: str) -> Measure:
    """Return the unit of a part, and infer those of constants; raise FormulaError if units do not match."""
    inner = [_measure(one, units, text) for one in part.parts]
    try:
        return _combined(part, inner, units)
    except FormulaError:
        raise
    except ValueError as error:
        raise FormulaError(f"{text!r}, character {part.at + 1}: {part.name or part.kind} {error}") from None


def _combined(part: Part, inner: list[Measure], units: Constants) -> Measure:
    if part.kind == "number":
        return Measure(any=True)
    if part.kind == "name":
        return Measure(unit_of(VARIABLES[part.name].unit)) if part.name in VARIABLES else units.of(part.name)
    if part.kind in ("+", "-"):
        return units.alike(*inner)
    if part.kind in ("*", "/"):
        return inner[0].times(inner[1], 1 if part.kind == "*" else -1)
    if part.kind == "**":
        return replace(Measure().times(inner[0], int(part.number)), any=inner[0].any, scaled=inner[0].scaled)
    if part.kind in ("abs", "negative"):
        return inner[0]
    if part.kind in ("tanh", "exp", "sin", "cos"):
        units.require(inner[0], ANGLE if part.kind in ("sin", "cos") else NUMBER)
        return Measure()
    if part.kind == "disc":
        for one in inner:
            units.require(one, unit_of("m"))
        return Measure()
    if part.kind == "low_pass":
        units.require(inner[1], unit_of("s"))
        return inner[0]
    if part.kind == "sign":
        return Measure()
    together = units.alike(*inner)  # clip, dead_zone, step
    return Measure() if part.kind == "step" else together
