"""The random walk over sets of effects finds the probabilities that summing over all sets gives."""

from itertools import product
from math import erfc, exp, log, pi, sqrt

import numpy as np
import pytest

from cmr.estimation.sampling import walk
from cmr.recordings.signal import Floats

STEPS = 60_000
# Shares of a walk that decorrelates within some ten steps are off by sqrt(0.25 / 5,000) at most, one deviation.
TOLERANCE = 4.0 * sqrt(0.25 / 5_000)


def resembling(seed: int, count: int) -> tuple[Floats, Floats]:
    """Return the products of `count` columns of which the first two are nearly alike, and their pulls."""
    random = np.random.default_rng(seed)
    columns = random.standard_normal((40, count))
    columns[:, 1] = columns[:, 0] + 0.2 * random.standard_normal(40)
    rest = -columns @ np.r_[0.8, np.zeros(count - 2), 0.3] + random.standard_normal(40)
    return columns.T @ columns, columns.T @ rest


def summed(normal: Floats, pull: Floats, odds: float) -> tuple[Floats, Floats]:
    """Return the probability of each effect and the mean sizes, summed over all sets."""
    count = len(pull)
    total, presence, mean = 0.0, np.zeros(count), np.zeros(count)
    for chosen in product((False, True), repeat=count):
        on = np.flatnonzero(chosen)
        inner = normal[np.ix_(on, on)] + np.eye(len(on))
        sizes = -np.linalg.solve(inner, pull[on])
        weight = exp(-0.5 * float(pull[on] @ sizes)) / sqrt(np.linalg.det(inner)) * exp(odds * len(on))
        total += weight
        presence[on] += weight
        mean[on] += weight * sizes
    return presence / total, mean / total


@pytest.mark.parametrize("seed", range(4))
def test_presence_and_means_are_those_of_the_sum_over_all_sets(seed: int) -> None:
    normal, pull = resembling(seed, 5)
    expected, means = summed(normal, pull, log(0.25))
    groups, both_signs = np.arange(5), np.zeros(5, np.bool_)
    found, products, shares, _ = walk(normal, pull, groups, both_signs, np.full(5, log(0.25)), both_signs, STEPS, 1)
    assert shares == pytest.approx(expected, abs=TOLERANCE)
    assert found == pytest.approx(means, abs=TOLERANCE)  # sizes are about 1 at most
    assert np.linalg.eigvalsh(products - np.outer(found, found)).min() > -1e-12


@pytest.mark.parametrize("pull", [-3.0, 0.0, 2.0])
def test_an_effect_of_one_sign_has_half_a_normal_for_its_size(pull: float) -> None:
    # Against nothing: exp(pull^2 / (2 (n + 1))) / sqrt(n + 1), times 2 P(size > 0).
    normal, odds = 4.0, log(0.5)
    mean, std = -pull / (normal + 1.0), 1.0 / sqrt(normal + 1.0)
    positive = 0.5 * erfc(-mean / std / sqrt(2.0))
    factor = exp(odds) * exp(0.5 * pull**2 / (normal + 1.0)) / sqrt(normal + 1.0) * 2.0 * positive
    presence = factor / (1.0 + factor)
    truncated = mean + std * exp(-0.5 * (mean / std) ** 2) / sqrt(2.0 * pi) / positive
    one = np.array([[normal]]), np.array([pull]), np.zeros(1, np.int64), np.ones(1, np.bool_), np.array([odds])
    found, _, shares, _ = walk(*one, np.zeros(1, np.bool_), STEPS, 2)
    assert shares[0] == pytest.approx(presence, abs=TOLERANCE)
    assert found[0] == pytest.approx(presence * truncated, abs=TOLERANCE)


def test_the_same_seed_gives_the_same_walk_and_the_likeliest_set_is_the_true_one() -> None:
    normal, pull = 50.0 * np.eye(4), np.array([-60.0, 0.0, 55.0, 1.0])
    arguments = normal, pull, np.arange(4), np.zeros(4, np.bool_), np.full(4, -2.0), np.zeros(4, np.bool_), 5_000
    first, second = walk(*arguments, 7), walk(*arguments, 7)
    for one, other in zip(first, second, strict=True):
        assert np.array_equal(one, other)
    assert first[3].tolist() == [True, False, True, False]


def test_an_effect_of_several_sizes_comes_and_goes_as_one() -> None:
    normal, pull = 30.0 * np.eye(3), np.array([-25.0, 10.0, 0.0])
    groups, odds = np.array([0, 0, 1]), np.full(2, -1.0)
    mean, products, shares, likeliest = walk(
        normal, pull, groups, np.zeros(3, np.bool_), odds, np.zeros(2, np.bool_), STEPS, 3
    )
    assert likeliest.tolist() == [True, False]
    assert shares[0] > 0.99
    # Both sizes have their own normal posterior: -pull / (normal + 1), variance 1 / (normal + 1).
    assert mean[:2] / shares[0] == pytest.approx([25.0 / 31.0, -10.0 / 31.0], abs=TOLERANCE)
    assert np.diag(products - np.outer(mean, mean))[:2] == pytest.approx([1.0 / 31.0] * 2, abs=TOLERANCE)
