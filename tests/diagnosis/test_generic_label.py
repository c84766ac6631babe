"""A generic term that is used is called so wherever a person reads of the model: it is no physical cause."""

from dataclasses import replace
from typing import Any

import pytest

from cmr.diagnosis.document import document
from cmr.diagnosis.report import report_of
from cmr.diagnosis.result import GENERIC
from cmr.diagnosis.sentence import sentence_of
from cmr.diagnosis.summary import summary
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.laws.result import Laws
from cmr.estimation.unexplained.generic import formula
from cmr.estimation.unexplained.result import GenericTerm
from tests.support.diagnosis_example import STRANGE

NAME = "generic_motion_turn_abs_v"
TERM = GenericTerm(
    estimates={NAME: Estimate(-0.02, 0.002)},
    formula=formula({NAME: -0.02}),
    held_out=30.0,
    gain=Gain(ratio=1.6, interval=(1.3, 2.0), signals={"pose": 1.6}),
)
WITH_TERM = replace(STRANGE, unexplained=replace(STRANGE.unexplained, generic=TERM))


def test_the_label_says_that_there_is_no_cause() -> None:
    assert "generic" in GENERIC
    assert "no physical cause" in GENERIC


@pytest.mark.parametrize("used", [True, False])
def test_the_sentence_calls_it_generic_where_it_is_used(used: bool) -> None:
    unexplained = (WITH_TERM if used else STRANGE).unexplained
    nothing: Any = None
    said = sentence_of((), Laws(), unexplained, nothing, None)
    assert (GENERIC in said) is used
    assert (TERM.formula in said) is used


@pytest.mark.parametrize("used", [True, False])
def test_report_and_document_call_it_generic_where_it_is_used(used: bool) -> None:
    diagnosis = WITH_TERM if used else STRANGE
    assert (GENERIC in report_of(diagnosis)) is used
    term = document(diagnosis)["generic_term"]
    assert (term["label"] == GENERIC) if used else (term is None)


@pytest.mark.parametrize("used", [True, False])
def test_the_terminal_calls_it_generic_where_it_is_used(used: bool) -> None:
    said = " ".join(summary(WITH_TERM if used else STRANGE).split())
    assert (GENERIC in said) is used
