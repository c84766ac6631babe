"""What is known of the size of an effect is what integrating over its prior gives."""

from math import sqrt

import numpy as np
import pytest

from cmr.estimation.candidates import Excitation
from cmr.estimation.sizes import SMALL, SPREAD, TRACE, SizePosterior, Sizes
from cmr.model.catalogue import CATALOGUE
from cmr.recordings.signal import Floats

EXCITATION = Excitation({"k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16, "wheel_radius": 0.04}, 2.0)
PRESENT = 0.2
STEPS = 60_000
# A mean over some 5,000 independent sizes is off by a seventieth of their deviation; four times that.
TOLERANCE = 4.0 / sqrt(5_000)
LIKELIHOODS = [(0.0, 0.0), (4.0, -3.0), (100.0, -25.0), (400.0, -40.0)]  # curvature and slope, in typical sizes


def posterior_of(effect: str, curvature: float, slope: float) -> tuple[SizePosterior, float]:
    """Return what is known of the effect's one size, and the typical one."""
    sizes = Sizes([CATALOGUE[effect]], EXCITATION)
    (usual,) = sizes.usual
    odds = np.log([PRESENT / (1.0 - PRESENT)])
    normal, pull = np.array([[curvature / usual**2]]), np.array([slope / usual])
    begin = np.zeros(1, np.bool_)
    return sizes.posterior(normal, pull, SPREAD * sizes.usual, odds, begin, STEPS, 1, traces=True), float(usual)


def moments(sizes: Floats, weights: Floats, curvature: float, slope: float) -> tuple[float, float]:
    """Return mean and standard deviation under a prior that gives these sizes their weights."""
    posterior = weights * np.exp(-0.5 * curvature * sizes**2 - slope * sizes)
    posterior /= posterior.sum()
    mean = float(posterior @ sizes)
    return mean, sqrt(float(posterior @ (sizes - mean) ** 2))


def normal(sizes: Floats, std: float) -> Floats:
    density = np.exp(-0.5 * (sizes / std) ** 2)
    return np.asarray(density / density.sum())


@pytest.mark.parametrize(("curvature", "slope"), LIKELIHOODS)
def test_of_an_effect_of_either_sign_there_may_be_a_trace(curvature: float, slope: float) -> None:
    found, usual = posterior_of("wheel_radius_asymmetry", curvature, slope)
    grid = np.linspace(-5.0, 5.0, 20_001)
    prior = (1.0 - PRESENT) * normal(grid, TRACE) + PRESENT * normal(grid, sqrt(SPREAD**2 + TRACE**2))
    mean, std = moments(grid, prior, curvature, slope)
    assert found.mean[0] / usual == pytest.approx(mean, abs=TOLERANCE * std)
    assert sqrt(found.covariance[0, 0]) / usual == pytest.approx(std, rel=2.0 * TOLERANCE)


@pytest.mark.parametrize(("curvature", "slope"), LIKELIHOODS)
def test_an_effect_of_one_sign_is_there_or_not_as_a_trace_too(curvature: float, slope: float) -> None:
    found, usual = posterior_of("coulomb_friction", curvature, slope)
    grid = np.linspace(0.0, 4.0, 1_601)
    large = PRESENT * normal(grid, SPREAD)
    small = 0.5 * normal(grid, SMALL)
    large[0] += 1.0 - PRESENT
    small[0] += 0.5
    sums = (grid[:, None] + grid[None, :]).ravel()
    mean, std = moments(sums, (large[:, None] * small[None, :]).ravel(), curvature, slope)
    assert found.mean[0] / usual == pytest.approx(mean, abs=TOLERANCE * std)
    assert sqrt(found.covariance[0, 0]) / usual == pytest.approx(std, rel=2.0 * TOLERANCE)


def test_without_traces_what_is_not_present_is_nothing() -> None:
    sizes = Sizes([CATALOGUE["wheel_radius_asymmetry"], CATALOGUE["coulomb_friction"]], EXCITATION)
    odds, begin = np.full(2, -1e3), np.zeros(2, np.bool_)
    found = sizes.posterior(np.eye(2), -np.ones(2), SPREAD * sizes.usual, odds, begin, 100, 1, traces=False)
    assert not found.mean.any()
    assert not found.covariance.any()
    assert not found.likeliest.any()
