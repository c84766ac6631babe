"""Closed loop: robots of the independent plant, in which something is hidden, on a floor of 2 m x 2 m."""

import pytest

from tests.hidden_effects.investigated import InvestigatedCase, investigated

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("effect", ["coulomb_friction", "gyro_scale", "command_delay", "wheel_radius_asymmetry"])
def test_a_hidden_effect_is_named_and_nothing_else(effect: str) -> None:
    """The right name, no other, within the half minute in which 96 % of all effects should be; never off the floor."""
    outcome = investigated(InvestigatedCase((effect,), seed=11, longest=30.0), until_named=effect)
    assert list(outcome.named) == [effect]
    assert outcome.within > 0.0


def test_nothing_hidden_is_named_nothing() -> None:
    """A robot as the model has it gets no name."""
    outcome = investigated(InvestigatedCase((), seed=11, longest=25.0))
    assert not outcome.named
    assert outcome.within > 0.0


def test_the_same_seed_gives_the_same_investigation() -> None:
    """Chance comes from seeds alone: two runs end at the same time with the same names."""
    first, again = (investigated(InvestigatedCase(("gyro_bias",), seed=12, longest=6.0)) for _ in range(2))
    assert first == again
