"""Effects that a robot is known to have: what is tried, taken away and judged are departures from them."""

from cmr.estimation.candidates import (
    SMALLEST,
    Excitation,
    least_worth_naming,
    size,
    trials,
    unlikelihood,
    worth_naming,
)
from cmr.estimation.preparation import given_effects
from cmr.estimation.search.screening import Score, one_sided, start_of
from cmr.model.catalogue import CATALOGUE, definition
from cmr.parameters.file import ParameterFile, Value

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
GIVEN = {"coulomb_friction": 6.0, "saturation": 0.5, "gyro_scale": -0.03}
KNOWN = Excitation(ROBOT, turning=2.0, given=GIVEN)


def test_an_effect_that_is_taken_away_is_as_it_was_given() -> None:
    values = {**ROBOT, **GIVEN, "coulomb_friction": 9.0, "turn_slip": 0.1}
    assert KNOWN.without(values, ["coulomb_friction", "turn_slip"]) == {**ROBOT, **GIVEN}


def test_what_departs_is_what_differs_from_what_is_given() -> None:
    friction, slip = CATALOGUE["coulomb_friction"], CATALOGUE["turn_slip"]
    assert not KNOWN.departs(friction, {**GIVEN})
    assert KNOWN.departs(friction, {**GIVEN, "coulomb_friction": 5.0})
    assert KNOWN.departs(friction, {**GIVEN, "coulomb_friction": 0.0})
    assert not KNOWN.departs(slip, GIVEN)
    assert KNOWN.departs(slip, {**GIVEN, "turn_slip": 0.1})


def test_trials_change_an_effect_from_what_is_given_and_may_make_it_smaller() -> None:
    friction = definition("coulomb_friction")
    (trial,) = [one for one in trials(KNOWN) if one.effect == "coulomb_friction"]
    change = size(friction, KNOWN)
    assert trial.values == {"coulomb_friction": 6.0 + change}
    assert not one_sided(trial)
    assert start_of(Score(trial, 100.0, -0.5)) == {"coulomb_friction": 6.0 - 0.5 * change}
    assert start_of(Score(trial, 100.0, -3.0)) == {"coulomb_friction": max(6.0 - 3.0 * change, 0.0)}


def test_a_limit_that_is_given_is_tried_tighter_and_wider() -> None:
    tried = [one.values["saturation"] for one in trials(KNOWN) if one.effect == "saturation"]
    assert min(tried) < 0.5 < max(tried)
    assert all(definition("saturation").allows(one) for one in tried)


def test_changes_are_judged_and_not_sizes() -> None:
    friction = {"coulomb_friction": 6.0}
    most = SMALLEST * size(definition("coulomb_friction"), KNOWN)
    assert not worth_naming({"coulomb_friction": 6.0 - 0.9 * most}, {}, KNOWN)
    assert worth_naming({"coulomb_friction": 6.0 - 1.1 * most}, {}, KNOWN)
    assert unlikelihood({**ROBOT, **GIVEN}, KNOWN) == 0.0
    assert unlikelihood({**ROBOT, **GIVEN, **friction, "gyro_scale": 0.0}, KNOWN) > 0.0
    assert least_worth_naming(definition("saturation"), KNOWN) == 0.05
    assert least_worth_naming(definition("current_limit"), KNOWN) == 0.0


def test_effects_that_act_by_chance_or_are_read_off_are_not_given() -> None:
    values = {**ROBOT, "coulomb_friction": 6.0, "command_loss": 0.1, "encoder_quantisation": 48.0}
    effects = ("coulomb_friction", "command_loss", "encoder_quantisation")
    file = ParameterFile(0, {name: Value(value) for name, value in values.items()}, effects)
    assert given_effects(file) == {"coulomb_friction": 6.0}
