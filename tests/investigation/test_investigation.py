"""Closed loop: robots of the independent plant, in which something is hidden, on a floor of 2 m x 2 m."""

import pytest

from tests.investigation.investigated import InvestigatedCase, investigated

pytestmark = pytest.mark.slow

SEED = 1000
HIDDEN = (
    *("battery_sag", "coulomb_friction", "motor_gain_asymmetry", "slew_limit", "command_delay", "backlash"),
    *("wheel_radius_asymmetry", "turn_slip", "gyro_bias", "gyro_scale", "gyro_latency", "pose_offset"),
)


@pytest.mark.parametrize("effect", HIDDEN)
def test_a_hidden_effect_is_named_and_nothing_else(effect: str) -> None:
    """The right name and no other, and the robot never left the floor."""
    outcome = investigated(InvestigatedCase((effect,), seed=SEED), until_named=effect)
    assert list(outcome.named) == [effect]
    assert outcome.within > 0.0


@pytest.mark.further  # nor by a calibration, below
def test_nothing_hidden_is_named_nothing() -> None:
    """A robot as the model has it gets no name."""
    outcome = investigated(InvestigatedCase((), seed=1, longest=15.0))
    assert not outcome.named
    assert outcome.within > 0.0


@pytest.mark.further  # nothing else is drawn than by the seed
def test_the_same_seed_gives_the_same_investigation() -> None:
    """Chance comes from seeds alone: two runs end at the same time with the same names."""
    first, again = (investigated(InvestigatedCase(("gyro_bias",), seed=12, longest=6.0)) for _ in range(2))
    assert first == again


@pytest.mark.further  # what it waits for: test_calibrating.py
def test_a_calibration_goes_on_while_there_is_more_to_name() -> None:
    """Between the names of six small effects, parameters beside one more seem known, and are wrong by percents."""
    outcome = investigated(InvestigatedCase((), seed=4001, longest=15.0, messy=True, calibrate=True))
    assert set(outcome.named) <= set(outcome.sizes)
    for name, allowed in (("k1", 0.01), ("base_width", 0.01), ("k2_over_k3", 0.03)):
        value, std, true = outcome.known[name]
        assert value == pytest.approx(true, rel=allowed)
        assert abs(value - true) < 3.0 * std


def test_a_calibration_ends_when_what_it_writes_is_certain_enough() -> None:
    """At first the base width is not: wheels of another size would be a wider base. It drives for these, then."""
    outcome = investigated(InvestigatedCase((), seed=7604, longest=30.0, calibrate=True))
    assert not outcome.named
    assert outcome.ended < 30.0
    for name, allowed in (("k1", 0.01), ("base_width", 0.01), ("k2_over_k3", 0.03)):
        value, std, true = outcome.known[name]
        assert 2.0 * std <= allowed * value, name
        assert abs(value - true) < 3.0 * std, name
