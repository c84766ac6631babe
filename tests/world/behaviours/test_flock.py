"""A flock keeps together, goes one way, does not crowd, and stays inside its geofence."""

import numpy as np
import pytest

from cmr.world.behaviours.flocking import Flock
from cmr.world.interaction.obstacles import Geofence, Obstacles
from tests.world.behaviours.team_bench import DIAMETER, Bench

pytestmark = pytest.mark.slow


def crowd(seed: int, count: int = 16) -> list[tuple[float, float, float]]:
    random = np.random.default_rng(seed)
    return [
        (0.6 * (k % 4) + random.uniform(0.0, 0.2), 0.6 * (k // 4) + random.uniform(0.0, 0.2), random.uniform(-3.1, 3.1))
        for k in range(count)
    ]


def order(bench: Bench) -> float:
    """Return the length of the mean heading: 1 if all are turned the same way."""
    theta = bench.world.surroundings().theta
    return float(np.hypot(np.cos(theta).mean(), np.sin(theta).mean()))


@pytest.mark.parametrize("seed", range(2))
def test_it_comes_to_go_one_way_keeps_together_and_nobody_touches(seed: int) -> None:
    bench = Bench(crowd(seed), [(Flock(), range(16))])
    before = order(bench)
    assert min(bench.nearest() for _ in bench.run(25.0)) > DIAMETER
    assert order(bench) > max(0.9, before)
    assert np.hypot(np.ptp(bench.x), np.ptp(bench.y)) < 5.0
    assert bench.speed.mean() > 0.15


def test_it_turns_back_at_the_geofence() -> None:
    bench = Bench(crowd(3, 8), [(Flock(), range(8))])
    fence = Geofence([(-1.5, -1.5), (3.5, -1.5), (3.5, 3.5), (-1.5, 3.5)])
    bench.world.geofence = fence
    for _ in bench.run(40.0):
        assert fence.contains(bench.x, bench.y).all()


def test_it_keeps_clear_of_discs() -> None:
    bench = Bench(crowd(4, 8), [(Flock(), range(8))])
    bench.world.geofence = Geofence([(-1.5, -1.5), (3.5, -1.5), (3.5, 3.5), (-1.5, 3.5)])
    bench.world.obstacles = Obstacles([(2.5, 2.5, 0.3), (-0.8, 0.5, 0.2)])
    for _ in bench.run(25.0):
        for x, y, radius in bench.world.obstacles.discs.T:
            assert np.hypot(bench.x - x, bench.y - y).min() > radius + DIAMETER / 2.0
