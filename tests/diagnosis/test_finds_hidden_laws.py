"""Physics that no effect describes, hidden in robots of an independent plant: the sample of scripts/study_laws for CI.

Six kinds have a law of the grammar, two have none. Their seed is none of the study's. A robot takes ten seconds.
"""

import pytest

from tests.hidden_effects.cases import RICH, Case
from tests.hidden_effects.laws.answers import LAW, LawRow, row_of
from tests.hidden_effects.laws.judging import HONEST, exact, in_set, outcome
from tests.hidden_effects.laws.kinds import KINDS
from tests.hidden_effects.laws.robots import LawCase

pytestmark = [pytest.mark.hidden_effects, pytest.mark.slow, pytest.mark.longest]

SEED = 1000  # the study's are smaller
SAID = ("brake_drag", "winding_heat", "understeer", "carpet_drift", "gyro_asymmetry", "body_roll")
NOT_SAID = ("reel_pull", "cogging")


def answered(kind: str) -> LawRow:
    """What a diagnosis of a robot with this kind of physics answers, with a held-out drive."""
    row = row_of(LawCase("kinds", Case((kind,), RICH, SEED)))
    assert row.error == ""
    return row


@pytest.mark.parametrize("kind", SAID)
def test_a_law_that_the_grammar_has_is_found_as_it_is(kind: str) -> None:
    assert KINDS[kind].in_grammar
    row = answered(kind)
    assert exact(row) or in_set(row), (row.answer, row.found, row.rivals, row.names, row.reasons)
    assert row.places_right


@pytest.mark.parametrize("kind", NOT_SAID)
def test_what_the_grammar_does_not_have_is_never_called_a_law_of_another_formula(kind: str) -> None:
    assert not KINDS[kind].in_grammar
    row = answered(kind)
    assert outcome(row) in HONEST, (row.answer, row.found, row.names, row.reasons)
    assert exact(row) or row.answer != LAW
