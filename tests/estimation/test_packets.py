"""Delays of single commands: what is told of jitter from the commands that come late."""

import numpy as np
import pytest

from cmr.estimation.search.command_timing import _best, _normal, largest_delay

PERIOD = 0.02  # s


@pytest.mark.parametrize("largest", [0.01, 0.02, 0.035, 0.06])
def test_the_largest_delay_is_found_though_commands_overtake_one_another(largest: float) -> None:
    """A million commands: the mean age of the newest that has come is known to a thousandth of the largest."""
    random = np.random.default_rng(1)
    sent = np.arange(1_000_000) * PERIOD
    come = sent + random.uniform(0.0, largest, len(sent))
    newest = np.minimum.accumulate(come[::-1])[::-1]  # a command that comes after a newer one is overtaken
    # Each command is in force from its coming until that of the next; ages grow evenly in between.
    seeming = float(np.mean(newest - sent))
    assert largest_delay(seeming, PERIOD) == pytest.approx(largest, rel=0.005)


def test_without_overtaking_it_is_twice_the_mean() -> None:
    assert largest_delay(0.004, PERIOD) == 0.008


def test_delays_beyond_any_outlier_leave_likelihoods_finite() -> None:
    """Where the model of the motors is wrong, delays of minutes may fit a response; their densities round to 0."""
    late, variance = np.array([0.0, 100.0]), np.array([1e-6, 1e-6])
    likelihood, number, density = _best([_normal(late, variance)], late, variance)
    assert np.isfinite(likelihood)
    assert number == 0
    assert density[1] > 0.0
