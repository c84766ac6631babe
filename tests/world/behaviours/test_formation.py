"""Formations: every robot gets to its place, keeps it while the leader drives, and stands without a leader."""

import math

import numpy as np
import pytest

from cmr.world.behaviours.formation import SHAPES, Formation, places_of
from cmr.world.behaviours.waypoints import Waypoints
from tests.world.behaviours.team_bench import DIAMETER, Bench


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("with_leader", [True, False])
def test_neighbours_in_a_formation_are_the_spacing_apart(shape: str, with_leader: bool) -> None:
    places = places_of(shape, 0.5, 7, with_leader=with_leader)
    everybody = np.vstack([places, [(0.0, 0.0)]]) if with_leader else places
    away = np.hypot(*(everybody[:, np.newaxis] - everybody).transpose(2, 0, 1))
    np.fill_diagonal(away, math.inf)
    assert away.min() == pytest.approx(0.5)
    assert places.shape == (7, 2)


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_the_formation_is_kept_behind_a_leader_that_drives(shape: str) -> None:
    leader = Waypoints(points="4:0", speed=0.25)
    team = Formation(leader=0, shape=shape, spacing=0.5)
    places = places_of(shape, 0.5, 4, with_leader=True)
    starts = [(x - 0.2, y, 0.0) for x, y in places]
    bench = Bench([(0.0, 0.0, 0.0), *starts], [(leader, [0]), (team, [1, 2, 3, 4])])
    nearest = min(bench.nearest() for _ in bench.run(12.0))
    assert nearest > DIAMETER
    assert bench.x[0] > 2.0
    assert bench.x[1:] - bench.x[0] == pytest.approx(places[:, 0], abs=0.1)
    assert bench.y[1:] - bench.y[0] == pytest.approx(places[:, 1], abs=0.1)


def test_without_its_leader_a_formation_stands() -> None:
    bench = Bench([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(Formation(leader=99), [0, 1])])
    for _ in bench.run(1.0):
        assert not bench.duties.any()


@pytest.mark.parametrize("seed", range(3))
def test_a_team_without_a_leader_gathers_in_its_shape_and_rests(seed: int) -> None:
    random = np.random.default_rng(seed)
    poses = [(x, y, random.uniform(-3.0, 3.0)) for x in (0.0, 0.7, 1.4) for y in (0.0, 0.7)]
    bench = Bench(poses, [(Formation(leader=-1, shape="line", spacing=0.6), range(6))])
    assert min(bench.nearest() for _ in bench.run(40.0)) > DIAMETER
    assert np.ptp(bench.x) < 0.25
    assert np.ptp(bench.y) == pytest.approx(3.0, abs=0.25)
    assert np.abs(bench.speed).max() < 0.02


def test_members_have_their_places_in_separate_objects_too() -> None:
    """As a real robot's pilot and the simulation have."""
    members = "1:2:3"
    one, others = (Formation(leader=0, shape="column", members=members) for _ in range(2))
    bench = Bench([(-0.4 * k, 0.1 * k, 0.0) for k in range(4)], [(one, [2]), (others, [1, 3])])
    for _ in bench.run(15.0):
        pass
    assert bench.x == pytest.approx([0.0, -0.5, -1.0, -1.5], abs=0.08)
    assert bench.y == pytest.approx([0.0] * 4, abs=0.08)


def test_who_is_no_member_stands() -> None:
    bench = Bench([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(Formation(leader=0, members="5:6"), [1])])
    for _ in bench.run(0.5):
        assert not bench.duties.any()
