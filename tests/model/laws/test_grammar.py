"""Formulas are data: known names, numbers and operations within bounds, or an error that says where."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.model.laws.grammar import DEEPEST, LONGEST, MOST_PARTS, FormulaError, parse
from cmr.model.laws.units import unit_of, unit_text
from cmr.model.laws.words import FUNCTIONS, VARIABLES

SOME = {name: 0.1 * (k + 1) for k, name in enumerate(VARIABLES)}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("1", "-"),
        ("w * abs(v)", "rad m/s^2"),
        ("v**2", "m^2/s^2"),
        ("effort * s", "-"),
        ("sign(w) * exp(-since_turn / 1.5)", "-"),
        ("tanh(psi / scale)", "-"),
        ("low_pass(abs(v), tau)", "m/s"),
        ("clip(dead_zone(v, 0.1), limit) * disc(px, py, 0.4)", "m/s"),
        ("step(t, begin) * sin(freq * t)", "-"),
        ("(x - px)**2 + y**2", "m^2"),
    ],
)
def test_the_unit_of_a_formula_follows_from_its_variables(text: str, unit: str) -> None:
    constants = ("scale", "tau", "limit", "px", "py", "begin", "freq")

    assert parse(text, constants).unit == unit_of(unit)


def test_the_unit_of_a_constant_follows_from_where_it_stands() -> None:
    found = parse("sin(freq * t) * tanh(v / fast) * low_pass(w, tau) * disc(px, 1, 2)", ("freq", "fast", "tau", "px"))

    assert {name: unit_text(unit) for name, unit in found.constant_units.items()} == {
        "freq": "rad/s",
        "fast": "m/s",
        "tau": "s",
        "px": "m",
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("v *", "character 4: expected a number, a name or a bracket"),
        ("v w", "character 3: expected an operator or the end"),
        ("v ** 9", "a power must be a whole number of 2 to 4"),
        ("v ** w", "a power must be a whole number"),
        ("v / w", "a divisor must be a number or a constant"),
        ("v / 0", "divides by 0"),
        ("v + w", "has the unit rad/s, must have m/s"),
        ("exp(v)", "has the unit m/s"),
        ("a * v", "scales the formula"),
        ("a", "reads no variable"),
        ("2", None),
        ("q * v", "unknown name 'q'"),
        ("open(v)", "unknown function 'open'"),
        ("clip(v, w)", "takes a number or a constant here"),
        ("sign(v * w)", "sign takes a variable"),
        ("low_pass(low_pass(v, 1), 2)", "a low_pass within a low_pass"),
        ("low_pass(v, 0)", "a time constant must be positive"),
        ("abs(v, w)", "takes 1 arguments, not 2"),
        ("v.real", "'.' is no part of a formula"),
        ("__import__('os').system('true')", "'_' is no part of a formula"),
        ("v if w else w", "expected an operator"),
        ("lambda: v", "is no part of a formula"),
        ("1e999 * v", "is no number of"),
        ("\u0663 * v", "is no part of a formula"),
        ("v\n* w", "is no part of a formula"),
        ("", "a formula is text such as"),
    ],
)
def test_what_is_no_formula_says_why_and_where(text: str, says: str | None) -> None:
    if says is None:
        assert parse(text).unit == (0, 0, 0)
        return
    with pytest.raises(FormulaError) as error:
        parse(text, ("a",))
    assert says in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "(" * 5000 + "v" + ")" * 5000,
        "-" * 200 + "v",
        "abs(" * 60 + "v" + ")" * 60,
        "(" * (DEEPEST + 1) + "v" + ")" * (DEEPEST + 1),
        "+".join(["v"] * (MOST_PARTS // 2 + 2)),
        "v" * (LONGEST + 1),
        "9" * 299 + "v",
    ],
)
def test_a_formula_that_is_too_long_deep_or_large_is_an_error(text: str) -> None:
    with pytest.raises(FormulaError):
        parse(text)


WORDS = [*VARIABLES, *FUNCTIONS, "(", ")", ",", "+", "-", "*", "**", "/", " ", "1", "0.5", "1e9", "a", "__class__"]


@given(st.one_of(st.text(max_size=400), st.lists(st.sampled_from(WORDS), max_size=80).map("".join)))
def test_any_text_is_a_formula_or_an_error_of_formulas(text: str) -> None:
    try:
        formula = parse(text, ("a",))
    except FormulaError:
        return
    assert set(formula.variables) <= set(VARIABLES)
    assert formula.constants in ((), ("a",))
    assert sum(1 for _ in formula.root.walk()) <= MOST_PARTS


def formulas() -> st.SearchStrategy[str]:
    """Return formulas whose parts have no units, so that all sums are right."""
    leaves = st.sampled_from(["u", "s", "effort", "load", "other_u", "0.5", "2.0"])

    def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        return st.one_of(
            st.tuples(inner, st.sampled_from(["+", "-", "*"]), inner).map(lambda p: f"({p[0]} {p[1]} {p[2]})"),
            inner.map(lambda p: f"abs({p})"),
            inner.map(lambda p: f"(-{p})"),
            inner.map(lambda p: f"({p})**2"),
            inner.map(lambda p: f"{p} / 4.0"),
            inner.map(lambda p: f"tanh({p})"),
            inner.map(lambda p: f"cos({p})"),
        )

    return st.recursive(leaves, grown, max_leaves=8)


@given(formulas())
def test_a_formula_means_what_it_says(text: str) -> None:
    names = {**SOME, "abs": abs, "tanh": math.tanh, "cos": math.cos}

    try:
        found = parse(f"u + {text}").evaluate(SOME)
    except FormulaError:  # too deep
        return

    assert float(found) == pytest.approx(eval(f"u + {text}", {"__builtins__": {}}, names), rel=1e-12, abs=1e-12)


def test_functions_that_python_lacks_have_their_closed_forms() -> None:
    v = np.linspace(-1.0, 1.0, 41)

    def value(text: str, **others: object) -> np.ndarray:
        return parse(text).evaluate({"v": v, "dt": 0.1, **others})  # type: ignore[dict-item]

    assert np.array_equal(value("clip(v, 0.5)"), np.clip(v, -0.5, 0.5))
    assert np.allclose(value("dead_zone(v, 0.5)"), np.sign(v) * np.maximum(np.abs(v) - 0.5, 0.0))
    assert np.array_equal(value("step(v, 0.25)"), v > 0.25)
    assert np.allclose(value("sign(v)"), v / np.hypot(v, VARIABLES["v"].small))
    assert np.array_equal(value("disc(0.5, 0.0, 0.2)", x=v, y=0.0), np.abs(v - 0.5) < 0.2)
    smoothed = value("low_pass(v, 2)", v=np.ones(100))
    assert np.allclose(smoothed, 1.0 - np.exp(-0.1 * np.arange(100) / 2.0))


def test_units_are_written_as_the_catalogue_writes_them() -> None:
    for text in ("rad/s^2", "m s/rad^2", "1/m^2", "-", "rad s/m^2", "s/rad", "1/rad", "m"):
        assert unit_text(unit_of(text)) == text
    with pytest.raises(ValueError, match="no unit"):
        unit_of("furlong")
