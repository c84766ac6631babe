"""The diagnosis by courses says how well it knows what it found."""

import numpy as np
import pytest

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise
from cmr.estimation.simulation_error import covariance_by_blocks

BLOCKS, LENGTH = 400, 25


@pytest.mark.parametrize(("lasts", "samples"), [(LENGTH, BLOCKS), (1, BLOCKS * LENGTH)], ids=["bursts", "white"])
def test_errors_that_come_in_bursts_count_once_a_burst(lasts: int, samples: int) -> None:
    """What a mean is known to is one over the root of how many errors there are that have causes of their own."""
    random = np.random.default_rng(5)
    rest = np.repeat(random.standard_normal(BLOCKS * LENGTH // lasts), lasts)
    fit = Fit({"k1": 0.0}, ("k1",), rest, np.ones((len(rest), 1)), Noise({}))
    blocks = np.repeat(np.arange(BLOCKS, dtype=np.float64), LENGTH)[:, None]
    assert np.sqrt(covariance_by_blocks(fit, blocks)[0, 0]) == pytest.approx(samples**-0.5, rel=0.15)
