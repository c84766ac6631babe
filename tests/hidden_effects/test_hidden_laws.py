"""Laws of physics that no effect describes are found: the sample that CI runs of scripts/study_laws.

Its seed is none of the study's. Six kinds are formulas of the grammar, two are not, and one robot has nothing hidden.
"""

import pytest

from tests.hidden_effects.cases import RICH, Case
from tests.hidden_effects.laws.answers import row_of
from tests.hidden_effects.laws.judging import HONEST, failures, false_law, outcome
from tests.hidden_effects.laws.robots import LawCase

pytestmark = [pytest.mark.hidden_effects, pytest.mark.slow]

SEED = 2000  # the study's are smaller
SAYABLE = ("understeer", "armature_reaction", "brake_drag", "gyro_asymmetry", "breakaway_skid", "puncture")
OTHERS = ("cogging", "curvature_slip")


@pytest.mark.parametrize("kind", SAYABLE)
def test_a_law_that_formulas_can_say_is_found_exactly(kind: str) -> None:
    row = row_of(LawCase("kinds", Case((kind,), RICH, SEED)))
    assert outcome(row) == "exact", failures([row])


@pytest.mark.parametrize("kind", OTHERS)
def test_what_no_formula_says_is_called_an_approximation_or_unexplained(kind: str) -> None:
    row = row_of(LawCase("kinds", Case((kind,), RICH, SEED)))
    assert outcome(row) in HONEST, failures([row])


def test_where_nothing_is_hidden_no_law_is_claimed() -> None:
    row = row_of(LawCase("null", Case((), RICH, SEED)))
    assert not row.error
    assert not false_law(row), failures([row])
