"""Who is near whom: the same as trying all pairs, wherever robots are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cmr.world.interaction import neighbours as module
from cmr.world.interaction.cells import ALL_PAIRS, close_pairs
from cmr.world.interaction.neighbours import NearList, Neighbours, pairs_within, range_and_bearing

Floats = NDArray[np.float64]


def by_all_pairs(x: Floats, y: Floats, radius: float) -> list[list[int]]:
    near = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2 <= radius * radius
    np.fill_diagonal(near, False)
    return [np.flatnonzero(row).tolist() for row in near]


def listed(neighbours: Neighbours) -> list[list[int]]:
    return [neighbours.of(i).tolist() for i in range(len(neighbours.start) - 1)]


@st.composite
def crowds(draw: st.DrawFn) -> tuple[Floats, Floats]:
    """Robots in some clusters, each scattered or on a grid, near one another or as far apart as can be."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    parts = [np.zeros((2, 0))]
    for _ in range(draw(st.integers(0, 4))):
        number = draw(st.integers(1, 120))
        centre = np.array([[draw(st.sampled_from([0.0, -3.0, 40.0, 1e6, -1e11]))], [draw(st.floats(-50.0, 50.0))]])
        size = draw(st.sampled_from([0.0, 1.0, 20.0, 1e4]))
        scattered = random.uniform(-size, size, (2, number))
        step = size / 16.0
        on_grid = np.round(scattered / step) * step if draw(st.booleans()) and step else scattered
        parts.append(centre + on_grid)
    x, y = np.hstack(parts)
    return x, y


@pytest.mark.slow
@given(crowds(), st.sampled_from([0.0, 0.1, 1.0, 1.25, 7.0, 1e3, 1e12]))
def test_neighbours_are_those_of_all_pairs_in_ascending_order(crowd: tuple[Floats, Floats], radius: float) -> None:
    neighbours = pairs_within(*crowd, radius)
    assert listed(neighbours) == by_all_pairs(*crowd, radius)
    assert len(neighbours.start) == len(crowd[0]) + 1


@given(st.integers(0, 2**32), st.integers(ALL_PAIRS + 1, 400))
def test_robots_exactly_one_radius_apart_are_neighbours_whatever_the_cells_are(seed: int, number: int) -> None:
    random = np.random.default_rng(seed)
    x, y = random.integers(-12, 13, (2, number)) * 0.25 + 4096.0 * random.integers(0, 2, number)
    assert listed(pairs_within(x, y, 0.25)) == by_all_pairs(x, y, 0.25)


@pytest.mark.parametrize("number", [0, 1])
def test_nobody_has_neighbours_alone(number: int) -> None:
    neighbours = pairs_within(np.zeros(number), np.zeros(number), 1.0)
    assert listed(neighbours) == [[]] * number
    nowhere = np.zeros(number)
    assert [len(part) for part in range_and_bearing(nowhere, nowhere, nowhere, neighbours)] == [0, 0]


@pytest.mark.parametrize(
    ("x", "y", "radius", "said"),
    [
        ([0.0, np.nan], [0.0, 0.0], 1.0, "x of robot 1 is nan"),
        ([0.0], [-np.inf], 1.0, "y of robot 0 is -inf"),
        ([0.0], [2e12], 1.0, "at most 1e\\+12 m"),
        ([0.0], [0.0, 1.0], 1.0, "same length"),
        ([0.0], [0.0], np.nan, "radius"),
        ([0.0], [0.0], -1.0, "radius"),
    ],
)
def test_what_is_no_position_or_radius_is_refused(x: list[float], y: list[float], radius: float, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        pairs_within(x, y, radius)


def test_range_and_bearing_are_seen_from_the_robot_itself() -> None:
    x, y, theta = np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, -2.0]), np.array([np.pi / 2.0, 0.0, -np.pi])
    distance, bearing = range_and_bearing(x, y, theta, pairs_within(x, y, 2.5))
    assert distance == pytest.approx([np.sqrt(2.0), 2.0, np.sqrt(2.0), 2.0])
    # Robot 0 looks along y: robot 1 is half right of it, robot 2 behind. Robot 2 looks along -x: robot 0 to its right.
    assert bearing == pytest.approx([-np.pi / 4.0, np.pi, -3.0 * np.pi / 4.0, -np.pi / 2.0])


def test_time_grows_with_the_number_of_robots_not_with_its_square() -> None:
    """Ten times the robots at the same density: ten times the pairs tried, however regular or far apart they are."""
    for spread in (1.0, 16.0, 1e5):
        side = np.arange(200.0) * spread
        x, y = (grid.ravel() for grid in np.meshgrid(side, side))
        assert len(pairs_within(x, y, 0.9).index) == 0  # with all pairs in a few bins, 40,000 robots take minutes


@pytest.mark.parametrize("number", [0, 1, 2, 60, 300])
def test_neighbours_of_robots_that_move_are_found_from_lists_and_are_those_of_all_pairs(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = []

    def counted(x: Floats, y: Floats, reach: float) -> object:
        looks.append(reach)
        return close_pairs(x, y, reach)

    monkeypatch.setattr(module, "close_pairs", counted)
    random = np.random.default_rng(number)
    x, y = random.uniform(-5.0, 5.0, (2, number))
    near, members = NearList(1.0), object()
    for step in range(300):
        if step == 100 and number:
            x[0], y[0] = x[-1], y[-1]  # somebody is carried away
        if step == 200:
            members, x, y = object(), x[::-1].copy(), y[::-1].copy()  # others come
        assert listed(near.neighbours(members, x, y)) == by_all_pairs(x, y, 1.0)
        x, y = (places + random.uniform(-0.005, 0.005, number) for places in (x, y))
    assert bool(number) <= len(looks) <= 30
