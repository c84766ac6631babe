"""A law is an effect of the model: entered into the catalogue of a process, compiled as others are."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.model.catalogue import CATALOGUE, DEFINITIONS, LAWS, MODELLED, effects_on, learn, unlearn
from cmr.model.effect import Effect
from cmr.model.extended.statements import Statements
from cmr.model.laws.effect import law_effect
from cmr.model.laws.law import Law, LawError
from cmr.model.laws.places import PLACES, SIDES
from cmr.model.laws.sentence import equation, headline
from cmr.model.laws.words import VARIABLES

TURN_COST = Law("law_turn_cost", "yaw_rate", ("w * abs(v)",), description="Speed costs turning.")
RICH = Law(
    "law_rich",
    "wheel_acceleration",
    ("low_pass(abs(psi), tau) * psi", "cos(theta) * sign(u)", "step(t, begin) * exp(-since_turn / tau)"),
    "opposite",
    {"tau": 20.0, "begin": 30.0},
)


@pytest.fixture(autouse=True)
def _catalogue_as_before() -> Iterator[None]:
    known = set(LAWS)
    yield
    for name in set(LAWS) - known:
        unlearn(name)


def test_a_law_is_an_entry_of_the_catalogue_with_units_that_follow() -> None:
    effect = learn(TURN_COST, {"law_turn_cost": -0.061})

    assert CATALOGUE["law_turn_cost"] is effect is MODELLED["law_turn_cost"]
    assert DEFINITIONS["law_turn_cost"].unit == "s/m"
    assert DEFINITIONS["law_turn_cost"].typical == -0.061
    assert effects_on({"law_turn_cost": -0.06}) == [effect]
    assert effects_on({"law_turn_cost": 0.0}) == []
    assert effect.sentence({"law_turn_cost": -0.061}) == (
        "Speed costs turning: a law changes the yaw rate by -0.061 s/m times w * abs(v)."
    )
    unlearn("law_turn_cost")
    assert not {"law_turn_cost"} & {*CATALOGUE, *MODELLED, *DEFINITIONS, *LAWS}


def test_a_name_stands_for_one_law() -> None:
    effect = learn(RICH)

    assert learn(replace(RICH, constants={"tau": 5.0, "begin": 1.0})) is effect
    with pytest.raises(LawError, match="the name of another law"):
        learn(replace(RICH, side="both"))
    with pytest.raises(LawError, match="law_rich_tau"):
        learn(Law("law_rich_tau", "gyro", ("w",)))


def test_laws_may_be_kept_in_sets() -> None:
    assert len({RICH, replace(RICH, constants={"tau": 5.0, "begin": 1.0}), TURN_COST}) == 3


def test_coefficients_are_found_and_constants_given() -> None:
    effect = law_effect(RICH)

    assert [parameter.name for parameter in effect.parameters] == ["law_rich_1", "law_rich_2", "law_rich_3"]
    assert {parameter.name: parameter.unit for parameter in effect.given} == {
        "law_rich_tau": "s",
        "law_rich_begin": "s",
    }
    assert [parameter.neutral for parameter in effect.given] == [20.0, 30.0]
    assert not effect.is_on({"law_rich_tau": 3.0})


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"name": "turn_cost"}, "must be law_ and words"),
        ({"name": "law_a__b"}, "must be law_ and words"),
        ({"name": "law_import os"}, "must be law_ and words"),
        ({"name": "law_" + "a" * 100}, "at most 64"),
        ({"place": "moon"}, "must be one of wheel_acceleration"),
        ({"side": "left"}, "has no sides"),
        ({"formulas": ()}, "a list of 1 to 3 formulas"),
        ({"formulas": ("v", "v")}, "there twice"),
        ({"formulas": ("psi",)}, "which yaw_rate does not have"),
        ({"formulas": ("v*v*v*q",)}, "unknown name 'q'"),
        ({"constants": {"q": 1.0}}, "no formula names q"),
        ({"formulas": ("exp(t/q)",), "constants": {"q": 0.0}}, "must be positive"),
        ({"formulas": ("exp(t/q)",), "constants": {"q": float("nan")}}, "must be a number"),
        ({"formulas": ("exp(t/v)",), "constants": {"v": 1.0}}, "taken by a variable"),
        ({"formulas": ("exp(t/q)", "tanh(v/q)"), "constants": {"q": 1.0}}, "has units s and m/s"),
        ({"description": "x" * 600}, "at most 500 characters"),
        ({"description": "clears \x1b[2J the terminal"}, "must be printable text on one line"),
        ({"description": "two\nlines"}, "must be printable text on one line"),
        ({"description": "back\u202ewards"}, "must be printable text on one line"),
        ({"place": "gyro", "formulas": ("low_pass(w, 1)",)}, "a law of a sensor keeps none"),
    ],
)
def test_what_is_no_law_says_why(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(LawError) as error:
        replace(TURN_COST, **changes)
    assert says in str(error.value)


def test_every_variable_is_given_at_each_of_its_places() -> None:
    for name, place in PLACES.items():
        for side in SIDES if place.per_side else ("",):
            for variable in place.variables:
                effect = law_effect(Law(f"law_{variable}", name, (variable,), side))
                assert set(effect.equations) >= {place.stage}
                checked(effect)


def checked(effect: Effect) -> None:
    """Have the statements of an effect checked: a ValueError where one reads what nothing gives it."""
    statements = Statements([effect], {*DEFINITIONS, *(parameter.name for parameter in effect.all_parameters)})
    for stage in effect.equations:
        statements.both(stage) if "side" in effect.equations[stage] else statements.of(stage)


def test_braces_in_a_description_are_no_fields() -> None:
    law = Law("law_a", "yaw_rate", ("w * abs(v)",), description="{__class__} {0}")

    assert law_effect(law).sentence({"law_a": 0.1}).startswith("{__class__} {0}: a law changes")


@given(st.text(max_size=200))
def test_any_description_is_text_in_the_sentence(text: str) -> None:
    try:
        law = Law("law_a", "yaw_rate", ("w * abs(v)",), description=text)
    except LawError:
        assert not text.isprintable()
        return

    assert text.rstrip(". ") in law_effect(law).sentence({"law_a": 0.1}) or not text.strip()


@pytest.mark.parametrize(
    ("law", "value", "says"),
    [
        (TURN_COST, -0.061, "Speed costs turning: w = w_wheels (1 - 0.061 s/m abs(v))"),
        (TURN_COST, 0.061, "Speed adds to turning: w = w_wheels (1 + 0.061 s/m abs(v))"),
        (
            Law("law_a", "wheel_acceleration", ("psi * psi * psi",), "left"),
            -0.1,
            "Wheel acceleration depends on wheel speed in another way than the model says: "
            "domega = domega_model - 0.1 s/rad^2 psi^3 on the left",
        ),
        (Law("law_a", "gyro", ("1",)), 0.02, "The gyro's reading has an offset: w_gyro = w + 0.02 rad/s"),
        (
            Law("law_a", "yaw_rate", ("sign(w) * exp(-since_turn / tau)",), constants={"tau": 1.5}),
            -0.1,
            "The time since the turn reversed costs turning: w = w_wheels - 0.1 rad/s sign(w) exp(-since_turn/1.5)",
        ),
        (
            Law("law_a", "pose_beside", ("(x - 0.5) * (y + 1)**2 / 2.0",)),
            0.1,
            "Place of the poses to the left depends on the place: left_pose = 0.1 1/m^2 (x - 0.5) (y + 1)^2/2",
        ),
    ],
)
def test_a_law_in_words(law: Law, value: float, says: str) -> None:
    values = {law.name: value}

    assert f"{headline(law, values)}: {equation(law, values)}" == says


def test_all_places_have_words() -> None:
    for name, place in PLACES.items():
        law = Law("law_a", name, (place.variables[0],), "both" if place.per_side else "")
        assert headline(law, {"law_a": 1.0})
        assert "=" in equation(law, {"law_a": 1.0})
    assert np.all([variable.small > 0.0 for variable in VARIABLES.values()])
