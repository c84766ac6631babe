"""Delays of single commands: what is told of jitter from the commands that come late."""

import numpy as np
import pytest

from cmr.estimation.search.chance import SURE_LOSS
from cmr.estimation.search.command_timing import PARTS, Timing, _best, _normal, _throughout, largest_delay

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


@pytest.mark.parametrize("share", [0.0, 0.04])
def test_the_share_of_commands_that_come_with_the_next_is_found_and_none_where_none_does(share: float) -> None:
    """Each delay is known to 3 ms, independently of the others'; a binomial share to its deviation."""
    count, std = 1000, 3e-3
    random = np.random.default_rng(3)
    gaps = random.uniform(0.04, 0.06, count)
    lost = random.random(count) < share
    measured = lost * gaps + random.normal(0.0, std, count)
    loss = Timing(np.full((1, count), std**-2), measured / std**2, gaps, (0, count), 0.05).loss()
    assert loss is not None
    assert (loss.drop > SURE_LOSS) == bool(share)
    if share:
        assert loss.share == pytest.approx(share, abs=3.0 * np.sqrt(share / count))
        assert list(loss.lost) == list(lost)


def test_commands_that_are_late_in_one_burst_are_not_lost_ones() -> None:
    drops = np.zeros(80)
    drops[:10] = 5.0  # the first of PARTS
    assert _throughout(drops) == 0.0
    assert _throughout(np.full(80, 0.5)) == pytest.approx(40.0)
    assert len(drops) == 10 * PARTS
