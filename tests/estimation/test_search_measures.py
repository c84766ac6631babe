"""The measure that decides about an effect agrees with the decision, and its sentence has the value and the limit."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.diagnosis.diagnose import _candidates
from cmr.estimation.candidates import SMALLEST, Excitation, size, worth_naming
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.search import selection
from cmr.estimation.search.criteria import (
    IN_ONE_MOMENT,
    TOO_SMALL,
    CandidateEffect,
    SelectedEffect,
    _lost_readings,
    measured,
    nearly_large,
    why_not,
)
from cmr.estimation.search.inflation import Inflation
from cmr.estimation.search.measures import readings_lost, size_below_limit, with_unit
from cmr.estimation.search.reasons import rows_of_added, rows_of_rejected, rows_of_rivals
from cmr.estimation.search.rivals import Rival
from cmr.estimation.search.selection import _Selection
from cmr.estimation.search.trace import ADDED, INCLUDED, INDISTINCT, REJECTED, Trace
from cmr.model.catalogue import CATALOGUE, definition
from cmr.recordings.signal import Floats

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
USUAL = Excitation(ROBOT, turning=2.0)
ROWS = 8
SIGNALS = ("psi_left", "psi_right", "psi_left", "yaw_rate", "yaw_rate", "forward", "sideways", "heading")  # of the rows
PROBLEM = cast(
    Any,
    SimpleNamespace(
        excitation=USUAL,
        moving=(1.0, 59.0),
        one_step=True,
        rows_of=lambda signals: np.array([name in signals for name in SIGNALS]),
    ),
)


def candidate(name: str, share: float, drop: float, explained: int | None = None) -> CandidateEffect:
    """Return an effect of one parameter, of a share of the size that matters; it explains one row of the errors."""
    rest, slopes = np.ones(ROWS), np.zeros((ROWS, 1))
    slopes[0] = 1e6
    if explained is not None:
        rest[explained] = 0.0
    values = {**ROBOT, name: share * SMALLEST * size(definition(name), USUAL)}
    fit = Fit(values, (name,), rest, slopes, cast(Any, None))
    return CandidateEffect(CATALOGUE[name], drop, values, fit, held_out=0.4 * drop)


def fit_of(*names: str) -> Fit:
    rest: Floats = np.ones(ROWS)
    return Fit(ROBOT, names, rest, np.ones((ROWS, len(names))), cast(Any, None))


@pytest.mark.parametrize("name", [one.name for one in CATALOGUE.values()])
@pytest.mark.parametrize(("share", "std"), [(0.0, 0.0), (0.9, 0.0), (1.1, 0.0), (1.1, 1.0), (4.0, 1.0)])
def test_the_size_measured_is_below_its_limit_exactly_where_it_is_not_worth_naming(
    name: str, share: float, std: float
) -> None:
    effect = CATALOGUE[name]
    least = {one.name: SMALLEST * size(one, USUAL) for one in effect.parameters if one.switches}
    values = {one.name: share * least.get(one.name, 0.0) for one in effect.parameters}
    stds = {one: std * value for one, value in least.items()}
    small = size_below_limit(effect, values, stds, USUAL)
    assert (small is None) == worth_naming(values, stds, USUAL)
    if small:
        assert abs(small.value) <= small.limit
        assert with_unit(small.value, small.unit) in small.sentence
        assert with_unit(small.limit, small.unit) in small.sentence


def test_a_reason_of_the_judgement_has_the_measure_of_the_same_reason() -> None:
    for one, quantity in (
        (candidate("gyro_bias", 0.5, 500.0), "gyro_bias"),
        (candidate("gyro_bias", 2.0, 1.0), "likelihood_ratio"),
    ):
        why = why_not(PROBLEM, fit_of(), one, Inflation(1.0))
        known = measured(PROBLEM, fit_of(), one, Inflation(1.0), why)
        assert known.measure
        assert known.measure.quantity == quantity
        assert known.reason(why) == known.measure.sentence


@pytest.mark.parametrize(
    ("name", "raised", "is_refused"),
    [
        ("pose_offset", "heading", True),  # a tracker says where the robot is, and with that what moves it at a place
        ("gyro_bias", "yaw_rate", True),
        ("gyro_bias", "heading", False),  # it may say which of two sensors is right
        ("encoder_scale", "psi_left", False),  # all predictions follow the encoders
        ("surface_patch", "heading", False),
    ],
)
def test_what_a_sensor_does_may_not_make_its_own_readings_less_likely(name: str, raised: str, is_refused: bool) -> None:
    rest = np.ones(ROWS)
    rest[SIGNALS.index(raised)] = 20.0
    one = candidate("gyro_bias", 2.0, 500.0)
    assert one.fit is not None
    one = replace(one, effect=CATALOGUE[name], fit=replace(one.fit, rest=rest))
    lost = _lost_readings(PROBLEM, fit_of(), one)
    assert lost == (399.0 if is_refused else pytest.approx(0.0, abs=1e-9))
    if is_refused:
        assert readings_lost(lost, 30.0).sentence == (
            "It raises -2 log likelihood of its own sensor's readings by 399.0; at most 30.0 may be chance."
        )


@pytest.mark.parametrize(("share", "is_nearly"), [(0.45, False), (0.55, True), (1.1, True)])
def test_half_the_size_that_matters_is_nearly_large(share: float, is_nearly: bool) -> None:
    assert nearly_large(candidate("gyro_bias", share, 500.0), USUAL) == is_nearly


def test_a_small_effect_is_included_and_its_rivals_are_rows_with_the_difference() -> None:
    trace, inflation = Trace(), Inflation(1.0)
    others = [(candidate("gyro_drift", 2.0, 495.0), "It explains less.")]
    for share in (0.5, 2.0):
        chosen = SelectedEffect(candidate("gyro_bias", share, 500.0), ("gyro_drift",), fit_of())
        trace.note(*rows_of_added(chosen, others, inflation, USUAL))
    assert [one.action for one in trace.decisions] == [INCLUDED, INDISTINCT, ADDED, INDISTINCT]
    assert trace.decisions[0].measures[0].quantity == "gyro_bias"
    assert (trace.decisions[1].effects, trace.decisions[1].statistic) == (("gyro_drift", "gyro_bias"), 5.0)
    assert trace.decisions[1].threshold > 5.0


def test_a_rival_beside_all_other_effects_is_a_row_with_the_difference_and_its_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = _Selection(PROBLEM, fit_of(), Trace(), 1.0)
    state.named = [SelectedEffect(candidate("gyro_bias", 2.0, 500.0), ("turn_slip", "gyro_drift"), fit_of())]
    monkeypatch.setattr(
        "cmr.estimation.search.selection.rivals_of", lambda *_: (Rival("gyro_drift", 5.0, 12.0, fit_of()),)
    )
    rivals = state.rivals(cast(Any, None))
    assert not state.exchanged_for_one_of(rivals)
    (named,) = state.with_rivals(rivals)
    assert named.rivals == ("gyro_drift",)
    (row,) = rows_of_rivals(rivals)
    assert (row.action, row.effects) == (INDISTINCT, ["gyro_drift", "gyro_bias"])
    assert (row.statistic, row.threshold) == (5.0, 12.0)


def test_a_rejected_effect_keeps_the_measure_for_which_it_was() -> None:
    kept = measured(PROBLEM, fit_of(), candidate("gyro_bias", 0.5, 500.0), Inflation(1.0), TOO_SMALL)
    (row,) = rows_of_rejected([(kept, TOO_SMALL)], Inflation(1.0))
    (measure,) = row.measures
    assert row.action == REJECTED
    assert measure is kept.measure
    assert row.reason.startswith("Its size, 0.00")


def test_small_effects_that_explain_the_same_are_one_that_is_seen() -> None:
    first, same = candidate("gyro_bias", 0.5, 500.0, explained=3), candidate("gyro_drift", 0.5, 400.0, explained=3)
    other, chance = candidate("coulomb_friction", 0.5, 90.0, explained=5), candidate("turn_slip", 2.0, 3.0)
    others = [(first, TOO_SMALL), (same, TOO_SMALL), (other, TOO_SMALL), (chance, "Chance.")]
    found = _candidates(cast(Any, SimpleNamespace(others=others, seen=fit_of("k1"), inflation=4.0)))
    assert [one.name for one in found if one.harmless] == ["gyro_bias", "coulomb_friction"]
    assert found[0].estimates["gyro_bias"].value == first.values["gyro_bias"]
    assert found[0].estimates["gyro_bias"].std == pytest.approx(2.0 * 1e-6)


def test_a_value_is_told_with_two_digits_and_its_unit() -> None:
    told = [with_unit(0.4, "rad/s^2"), with_unit(-0.0025, "-"), with_unit(12.0, "m"), with_unit(512.3, "s")]
    assert [*told, with_unit(math.nan, "m")] == ["0.40 rad/s^2", "-0.0025", "12 m", "512 s", "nan m"]


@pytest.mark.parametrize(("moments", "is_refused"), [([20.0], True), ([20.0, 20.4], True), ([11.0, 20.0, 31.0], False)])
def test_what_happened_in_one_second_is_no_place(moments: list[float], is_refused: bool) -> None:
    """A command that was stamped late looks like a place that the robot only touches."""
    times = np.arange(0.0, 60.0, 0.2)
    predictor = SimpleNamespace(
        times={"psi_left": times}, segment=SimpleNamespace(recording=0, observations=SimpleNamespace(time=0.0))
    )
    problem = cast(Any, SimpleNamespace(**{**vars(PROBLEM), "predictors": (predictor,)}))
    rest = np.ones(len(times))
    rest[np.searchsorted(times, moments)] = math.sqrt(600.0 / len(moments))
    place = {f"surface_patch_{name}": value for name, value in {"x": 1.0, "y": 0.0, "radius": 0.5}.items()}
    values = {**ROBOT, **place, "surface_patch_friction": 5.0, "surface_patch_base_width": 0.1}
    before = Fit(ROBOT, (), rest, np.zeros((len(times), 0)), cast(Any, None))
    names = tuple(parameter.name for parameter in CATALOGUE["surface_patch"].parameters)
    slopes = 1e3 * np.random.default_rng(0).standard_normal((len(times), len(names)))
    after = Fit(values, names, np.ones(len(times)), slopes, cast(Any, None))
    patch = CandidateEffect(CATALOGUE["surface_patch"], 600.0, values, after, held_out=100.0)
    assert (why_not(problem, before, patch, Inflation(1.0)) == IN_ONE_MOMENT) == is_refused


def test_what_is_not_seen_in_the_wheels_is_judged_so_when_it_is_selected(monkeypatch: pytest.MonkeyPatch) -> None:
    """What late commands leave in the wheels raises the thresholds of effects of the wheels, not that of slip."""
    found = [Inflation(20.0, 1.0, frozenset({"longitudinal_slip"})), Inflation(20.0, 1.0)]
    screenings = iter(SimpleNamespace(inflation=one, noise=None) for one in found)
    monkeypatch.setattr(selection, "screen", lambda *_model: next(screenings))
    predictors = [SimpleNamespace(segment=SimpleNamespace(tick=0.0))]
    problem = SimpleNamespace(**vars(PROBLEM), predictors=predictors, renewed=lambda fit, _noise: fit)
    state = _Selection(cast(Any, problem), fit_of(), Trace())
    for named in ([], [candidate("longitudinal_slip", 2.0, 500.0)]):
        state.named = [SelectedEffect(one, (), fit_of()) for one in named]
        state.screened()
        assert state.inflation.of("longitudinal_slip") == 1.0
    assert state.inflation.of("coulomb_friction") == 20.0
