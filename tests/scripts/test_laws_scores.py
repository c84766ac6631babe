"""The study of laws judges an answer by what is true, in whatever words it is said; its rows outlive a process."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.model.catalogue import CATALOGUE
from tests.hidden_effects.cases import RICH, Case, Truth
from tests.hidden_effects.laws import answers, judging, robots
from tests.hidden_effects.laws.answers import APPROXIMATION, LAW, TIE, LawRow, answered, explained
from tests.hidden_effects.laws.kinds import KINDS
from tests.hidden_effects.laws.states import States

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}


def states() -> States:
    """A made-up motion that excites everything."""
    random = np.random.default_rng(25)
    time = np.arange(4000) * 0.01
    rates, phases = random.uniform(0.2, 4.0, (9, 4, 1)), random.uniform(0.0, 6.0, (9, 4, 1))
    waves = np.sin(rates * time + phases).sum(axis=1)
    names = ("psi_left", "psi_right", "domega_left", "domega_right", "phi_left", "phi_right", "x", "y", "theta")
    duties = 0.2 * waves[4:6].T
    return States(dict(zip(names, (3.0 * wave for wave in waves), strict=True)), duties, ROBOT, 0.01)


def truth(*kinds: str) -> Truth:
    sizes = {name: size for kind in kinds for name, size in KINDS[kind].sizes.items()}
    return Truth(case=Case(kinds, RICH, 0), robot=ROBOT, parameters=sizes, nominal=ROBOT)


def law(place: str, *formulas: str, side: str = "", **constants: float) -> dict[str, Any]:
    """A law as diagnosis.json says it."""
    parameters = {f"law_one_{name}": {"value": value} for name, value in constants.items()}
    return {"name": "law_one", "place": place, "side": side, "formulas": list(formulas), "parameters": parameters}


def row(set_name: str = "kinds", hidden: str = "understeer", **fields: Any) -> LawRow:
    return LawRow(set_name=set_name, hidden=hidden, seed=fields.pop("seed", 0), **fields)


@pytest.mark.parametrize(
    ("kind", "found"),
    [
        ("understeer", law("yaw_rate", "v**2 * w")),
        ("weak_reverse", law("wheel_voltage", "abs(u)", side="both")),
        ("weak_reverse", law("wheel_acceleration", "u + abs(u)", side="both")),
        ("mass_ahead", law("wheel_acceleration", "w**2", side="both")),
        ("gyro_field", law("gyro", "cos(theta)", "sin(theta)")),
        ("breakaway_skid", law("lateral_speed", "dead_zone(v * w, grip)", grip=0.151)),
        ("winding_heat", law("wheel_acceleration", "effort * low_pass(effort**2, memory)", side="both", memory=12.2)),
        ("brake_drag", law("wheel_acceleration", "sign(psi)", side="left")),
    ],
)
def test_the_same_mathematics_counts_in_other_words(kind: str, found: Mapping[str, Any]) -> None:
    assert explained(KINDS[kind].laws[0], [found], states(), truth(kind)) > judging.SAME


@pytest.mark.parametrize(
    ("kind", "found"),
    [
        ("understeer", law("yaw_rate", "abs(v) * w")),
        ("understeer", law("forward_speed", "v**2 * w")),
        ("weak_reverse", law("wheel_voltage", "abs(psi)", side="both")),
        ("brake_drag", law("wheel_acceleration", "sign(psi)", side="both")),
        ("cogging", law("wheel_acceleration", "sign(psi)", side="both")),
        ("breakaway_skid", law("lateral_speed", "dead_zone(v * w, grip)", grip=0.3)),
    ],
)
def test_another_formula_or_place_does_not(kind: str, found: Mapping[str, Any]) -> None:
    assert explained(KINDS[kind].laws[0], [found], states(), truth(kind)) < 0.97


def test_every_true_law_can_be_told_from_what_the_papers_parameters_say() -> None:
    for name, kind in KINDS.items():
        for one in kind.laws:
            column = one.column(states(), truth(name).parameters)
            assert np.isfinite(column).all(), name
            assert explained(one, [], states(), truth(name)) == 0.0


def test_each_answer_has_one_outcome() -> None:
    outcome = judging.outcome
    assert outcome(row(answer=LAW, found=("a",), fits=(0.999,))) == "exact"
    assert outcome(row(answer=LAW, found=("a",), fits=(0.9,))) == "wrong law"
    assert outcome(row(answer=LAW, found=("a", "b"), fits=(0.999,))) == "wrong law"
    assert outcome(row(hidden="mass_ahead", answer=LAW, found=("a", "b"), fits=(0.999, 0.995))) == "exact"
    assert outcome(row(hidden="mass_ahead", answer=LAW, found=("a",), fits=(0.999, 0.0))) == "wrong law"
    assert outcome(row(answer=APPROXIMATION, found=("a",), fits=(0.9,))) == "approximation"
    assert outcome(row(answer=TIE, rivals=("a", "b"), fits=(0.0,), fits_of_set=(0.999,))) == "in set"
    assert outcome(row(answer=TIE, rivals=("a", "b"), fits=(0.0,), fits_of_set=(0.5,))) == "wrong set"
    assert outcome(row(verdict="unexplained", names=("slope",))) == "unexplained"
    assert outcome(row(verdict="effects_found", names=("slope",))) == "names"
    assert outcome(row(verdict="no_effect")) == "silent"
    assert outcome(row(hidden="slosh", answer=LAW, found=("a",))) == "wrong law"


def test_scores_count_what_the_table_demands() -> None:
    rows = [
        row(answer=LAW, found=("a",), fits=(1.0,), fits_of_set=(1.0,), seed=1),
        row(answer=LAW, found=("a",), fits=(0.5,), fits_of_set=(1.0,), places_right=False, seed=2),
        row(hidden="slosh", answer=APPROXIMATION, found=("a",), seed=3),
        row(hidden="slosh", verdict="no_effect", seed=4),
        row("null", RICH, answer=APPROXIMATION, found=("a",), seed=5),
        row("mixed", "slope understeer", answer=LAW, found=("a",), fits=(1.0,), names=("slope",), seed=6),
    ]
    found = {(score.set_name, score.quantity): score.value for score in judging.scores(rows)}
    assert found["kinds", "in the grammar: exact first"] == 0.5
    assert found["kinds", "in the grammar: in the set"] == 1.0
    assert found["kinds", "others: exact, approximation or unexplained"] == 0.5
    assert found["kinds", "a wrong formula called a law"] == 0.25
    assert found["kinds", "silent"] == 0.25
    assert found["kinds", "right place of laws claimed"] == pytest.approx(2.0 / 3.0)
    assert found["null", "a law"] == 1.0
    assert found["mixed", "both right"] == 1.0
    assert len(judging.failures(rows)) == 3
    assert "understeer" in judging.table(rows)


def test_what_a_diagnosis_says_of_laws_is_read_with_and_without_that_section() -> None:
    plain = {"verdict": "no_effect", "effects": [], "unexplained": {"present": True}, "gain": None}
    assert answered(plain)["answer"] == answers.NO_LAW
    found = law("yaw_rate", "w * v**2")
    said = answered({**plain, "laws": {"answer": LAW, "found": [found], "indistinguishable_from": ["gyro_scale"]}})
    assert said["found"] == ("yaw_rate: w * v**2",)
    assert said["rivals"] == ("gyro_scale",)


def test_rows_outlive_a_process_that_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    first, again = row(fits=(0.5,), names=("slope",)), row(fits=(0.7,))
    for one in (first, row(seed=1), again):
        answers.append(path, one)
    with path.open("a", encoding="utf-8") as stream:
        stream.write('{"set_name": "kin')
    assert {one.key: one.fits for one in answers.read(path)} == {again.key: (0.7,), row(seed=1).key: ()}


def test_sets_hold_what_is_to_be_reached_and_no_robot_twice() -> None:
    cases = {name: make(20) for name, make in robots.SETS.items()}
    assert len(cases["kinds"]) == 20 * len(KINDS)
    assert len(cases["null"]) == 1000
    assert sum(one.case.manoeuvre != RICH for one in cases["null"]) == 500
    assert sum("slow" in one.case.noise for one in cases["null"]) >= 200
    assert len(cases["six"]) == len(cases["mixed"]) == 100
    assert {one.removed for one in cases["removed"]} == {one.case.effects[0] for one in cases["catalogue"]}
    for own in cases.values():
        assert len({one.key for one in own}) == len(own)


def test_an_entry_is_removed_for_a_while_only() -> None:
    before = list(CATALOGUE)
    with answers.without_entry("slope"):
        assert set(before) - set(CATALOGUE) == {"slope"}
    with answers.without_entry(""):
        assert list(CATALOGUE) == before
    assert list(CATALOGUE) == before
