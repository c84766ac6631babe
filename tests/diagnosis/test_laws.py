"""A law that a diagnosis found is said in words, in the document, in the report and in the parameter file."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmr.diagnosis.document import extended_file, write_document
from cmr.diagnosis.laws import experiment_to_decide, law_sentence, laws_sentence
from cmr.diagnosis.next_experiment import Pilot, motions_in
from cmr.diagnosis.report import report_of
from cmr.diagnosis.result import EFFECTS_FOUND, LAW_FOUND, NO_EFFECT, UNEXPLAINED, VERDICTS, Diagnosis
from cmr.diagnosis.sentence import verdict_of
from cmr.diagnosis.summary import summary
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.laws.proposing import MANOEUVRE
from cmr.estimation.laws.result import APPROXIMATION, LAW, TIE, Course, Curve, LawFound, Laws
from cmr.estimation.unexplained.result import Unexplained
from cmr.model.catalogue import CATALOGUE, LAWS, learn, unlearn
from cmr.model.laws import Law
from cmr.model.laws.effect import NEEDS
from cmr.parameters.file import parse
from tests.support.made_up_diagnosis import DIAGNOSIS

TURN_COST = Law("law_turn_cost", "yaw_rate", ("w * abs(v)",))
BUZZ = Law("law_buzz", "wheel_voltage", ("sin(freq * t)", "cos(freq * t)"), "left", {"freq": 12.5})
GAIN = Gain(ratio=41.0 / 12.0, interval=(3.0, 4.0), signals={"pose": 41.0 / 12.0})


def found(law: Law, *values: tuple[float, float]) -> LawFound:
    estimates = {name: Estimate(*one) for name, one in zip(law.coefficients, values, strict=True)}
    return LawFound(law=law, estimates=estimates, gain=GAIN, held_out=210.0, score=1800.0, left=4.0)


COST = found(TURN_COST, (-0.0612, 0.0021))
RIVAL = found(Law("law_rival", "yaw_rate", ("w * v**2",)), (-0.05, math.nan))


@pytest.fixture(autouse=True)
def _catalogue_as_before() -> Iterator[None]:
    for law in (TURN_COST, BUZZ):
        learn(law)
    yield
    for name in set(LAWS):
        unlearn(name)


def course(sign: float) -> Course:
    at = np.linspace(0.0, 1.0, 9)
    lacking = -0.06 * at * sign
    lacking[3] = np.nan
    return Course(
        at=at, count=np.full(9, 50.0), before=lacking, after=0.01 * lacking, std=np.full(9, 1e-3), law=-0.06 * at
    )


def diagnosed(laws: Laws) -> Diagnosis:
    """Return the diagnosis of a robot with these laws and no effect."""
    assert DIAGNOSIS.extended is not None
    parameters = {name: value for name, value in DIAGNOSIS.parameters.items() if name not in LAWS}
    own = {name: one.value for law in laws.found for name, one in law.estimates.items()}
    paper = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
    estimates = {name: one for name, one in DIAGNOSIS.extended.estimates.items() if name in paper}
    estimates |= {name: one for law in laws.found for name, one in law.estimates.items()}
    return replace(
        DIAGNOSIS,
        verdict=LAW_FOUND,
        sentence=laws_sentence(laws, 0.012),
        effects=(),
        laws=laws,
        unexplained=Unexplained(),
        parameters={**{name: value for name, value in parameters.items() if name in paper}, **paper, **own},
        extended=replace(DIAGNOSIS.extended, estimates=estimates, held_out_path_rmse=0.012),
    )


def test_the_sentence_has_formula_unit_interval_and_gain() -> None:
    assert law_sentence(COST, 0.012) == (
        "Speed costs turning: w = w_wheels (1 - 0.0612 s/m abs(v)), -0.0612 +- 0.0021 s/m; held-out path error 41 to "
        "12 mm."
    )
    assert "held-out" not in law_sentence(COST)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (LAW, "No entry of the catalogue describes this."),
        (APPROXIMATION, "It is an approximation of something unknown"),
        (TIE, "Cannot be distinguished from: w = w_wheels (1 - 0.05 s^2/m^2 v^2)."),
    ],
)
def test_each_answer_says_what_it_is(answer: str, says: str) -> None:
    laws = Laws(answer=answer, found=(COST,), rivals=(RIVAL,) if answer == TIE else (), manoeuvre=MANOEUVRE)

    assert says in laws_sentence(laws, 0.012)
    assert "Which formula holds would show in" in experiment_to_decide(laws, Pilot())
    assert "cmr-pilot" in experiment_to_decide(laws, Pilot())


def test_without_a_law_nothing_is_said_but_what_would_show_one() -> None:
    laws = Laws(reasons=("One speed and one radius.",), manoeuvre=MANOEUVRE)

    assert laws_sentence(laws, 0.012) == ""
    assert experiment_to_decide(laws, Pilot()).startswith("Whether a law holds would show in multisine, circles")
    assert experiment_to_decide(Laws(), Pilot()) == ""


def test_a_law_that_ties_with_names_is_said_everywhere_and_used_nowhere() -> None:
    laws = Laws(answer=TIE, rivals=(RIVAL,), reasons=("gyro_bias and gyro_drift explain as much.",))
    diagnosis = replace(DIAGNOSIS, laws=laws)
    formula = "w = w_wheels (1 - 0.05 s^2/m^2 v^2)"

    assert formula in laws_sentence(laws, 0.012)
    assert "Laws (tie): none is used. gyro_bias and gyro_drift explain as much." in summary(diagnosis).replace(
        "\n", " "
    )
    section = report_of(diagnosis).split('id="laws"')[1].split("<h2")[0]
    assert "No law is used." in section
    assert "gyro_bias and gyro_drift explain as much." in section


def test_names_come_before_laws_and_laws_before_what_is_unexplained() -> None:
    laws, left = Laws(answer=LAW, found=(COST,)), Unexplained(present=True, signal="yaw_rate")

    assert verdict_of(DIAGNOSIS.effects, laws, left) == EFFECTS_FOUND
    assert verdict_of((), laws, left) == LAW_FOUND
    assert verdict_of((), Laws(), left) == UNEXPLAINED
    assert verdict_of((), Laws(), Unexplained()) == NO_EFFECT
    assert LAW_FOUND in VERDICTS


def test_the_document_has_all_of_a_law(tmp_path: Path) -> None:
    laws = Laws(answer=TIE, found=(COST, found(BUZZ, (0.02, 0.001), (-0.01, 0.001))), rivals=(RIVAL,), reasons=("So.",))

    write_document(diagnosed(laws), tmp_path / "diagnosis.json")
    section = json.loads((tmp_path / "diagnosis.json").read_text())["laws"]

    assert section["answer"] == "tie"
    assert section["reasons"] == ["So."]
    assert section["indistinguishable_from"][0]["formulas"] == ["w * v**2"]
    assert section["indistinguishable_from"][0]["parameters"]["law_rival"]["ci95"] == [None, None]
    cost, buzz = section["found"]
    assert (cost["name"], cost["place"], cost["side"]) == ("law_turn_cost", "yaw_rate", "")
    assert cost["parameters"]["law_turn_cost"]["unit"] == "s/m"
    assert cost["parameters"]["law_turn_cost"]["ci95"] == pytest.approx(
        [-0.0612 - 1.96 * 0.0021, -0.0612 + 1.96 * 0.0021]
    )
    assert cost["held_out_path_rmse_ratio"] == pytest.approx(41.0 / 12.0)
    assert "Speed costs turning" in cost["sentence"]
    assert buzz["side"] == "left"
    assert buzz["constants"] == {"freq": 12.5}
    assert buzz["parameters"]["law_buzz_freq"] == {"value": 12.5, "unit": "rad/s", "std": None, "ci95": [None, None]}


def test_the_parameter_file_carries_the_law_to_another_process() -> None:
    text = extended_file(diagnosed(Laws(answer=LAW, found=(COST,))), {}).to_yaml()
    unlearn("law_turn_cost")

    received = parse(text)

    assert received.effects == ("law_turn_cost",)
    assert received.value("law_turn_cost") == pytest.approx(-0.0612)
    assert CATALOGUE["law_turn_cost"].sentence({"law_turn_cost": -0.0612}).startswith("A law changes the yaw rate by")


def test_the_report_draws_the_law_through_what_is_lacking() -> None:
    curve = Curve(
        law="law_turn_cost",
        variable="abs(v)",
        unit="m/s",
        place_unit="rad/s",
        training=course(1.0),
        held_out=course(0.9),
    )
    laws = Laws(answer=LAW, found=(COST,), curve=(curve,), reasons=("A reason.",))

    page = report_of(diagnosed(laws))

    assert "law found" in page
    assert "data fitted" in page
    assert "data held out" in page
    assert "without the law" in page
    assert "A reason." in page
    section = page.split('id="laws"')[1].split("<h2")[0]
    assert "data fitted" in section
    assert "nan" not in section.lower()


def test_the_terminal_names_the_law_and_what_speaks_for_it() -> None:
    text = summary(diagnosed(Laws(answer=LAW, found=(COST,), reasons=("It holds on held-out data.",))))

    assert "Laws (law): law_turn_cost. It holds on held-out data." in text.replace("\n", " ")
    assert "with the law" in text


def test_each_variable_asks_for_a_motion_that_a_manoeuvre_gives() -> None:
    assert all(motions_in(text) for text in NEEDS.values())
