"""Robots that meet: nobody overlaps, nobody is pushed who cannot be, nobody gains energy, and order does not matter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cmr.geometry.obstacles import Obstacles
from cmr.world.interaction.contacts import LARGEST_PUSH, SKIN, TOLERANCE, Contacts

Floats = NDArray[np.float64]
RADIUS, WHEEL = 0.1, 0.04
NOBODY = np.zeros((3, 0))
NO_OBSTACLES = Obstacles.none()
MOST_STEPS = 400  # until a heap has parted: its robots have some metres to go, at most 2.5 cm each step


def standing(x: Floats, y: Floats, theta: float = 0.0, psi: float = 0.0) -> Floats:
    """Robots at places, all with one heading and one speed of both wheels."""
    return np.array([x, y, np.full(len(x), theta), np.full(len(x), psi), np.full(len(x), psi)])


def radii(n: int) -> tuple[Floats, Floats]:
    return np.full(n, RADIUS), np.full(n, WHEEL)


def resolve(state: Floats, obstacles: Obstacles = NO_OBSTACLES, others: Floats = NOBODY) -> Floats:
    """Return the state after one step's contacts."""
    after = state.copy()
    Contacts(obstacles).resolve(after, *radii(state.shape[1]), others)
    return after


def overlap(state: Floats) -> float:
    """By how much [m] the worst pair overlaps."""
    x, y = state[:2]
    distance = np.hypot(x[:, None] - x, y[:, None] - y)[np.triu_indices(len(x), 1)]
    return float(np.max(2.0 * RADIUS - distance, initial=0.0))


@st.composite
def heaps(draw: st.DrawFn) -> Floats:
    """Up to 40 moving robots, crowded up to all in one place."""
    n = draw(st.integers(1, 40))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    size = draw(st.sampled_from([0.0, 0.2, 1.0, 3.0]))
    return np.vstack(
        [random.uniform(-size, size, (2, n)), random.uniform(-9.0, 9.0, n), random.uniform(-20, 20, (2, n))]
    )


@pytest.mark.slow
@settings(max_examples=40)
@given(heaps())
def test_however_robots_are_heaped_up_they_part(state: Floats) -> None:
    contacts, (radius, wheel) = Contacts(NO_OBSTACLES), radii(state.shape[1])
    for _ in range(MOST_STEPS):
        before = state[:2].copy()
        changed = contacts.resolve(state, radius, wheel, NOBODY)
        furthest = np.max(np.hypot(*(state[:2] - before)))
        assert furthest <= LARGEST_PUSH * SKIN * RADIUS * (1.0 + 1e-9)
        if not changed:
            break
    assert overlap(state) <= TOLERANCE


def test_two_robots_part_in_one_step_by_half_each_along_the_line_of_their_centres() -> None:
    after = resolve(standing(np.array([0.0, 0.12]), np.array([0.0, 0.16])))
    assert np.hypot(after[0, 1] - after[0, 0], after[1, 1] - after[1, 0]) == pytest.approx(2.0 * RADIUS, abs=1e-9)
    assert after[:2].mean(axis=1) == pytest.approx([0.06, 0.08], abs=1e-15)
    assert after[1, 1] / after[0, 1] == pytest.approx(0.16 / 0.12 - 0.0, abs=1e-1)


@settings(max_examples=40)
@given(heaps(), st.integers(0, 2**32))
def test_the_order_of_robots_makes_no_difference(state: Floats, seed: int) -> None:
    state = state + 0.0
    state[:2] += np.random.default_rng(seed).normal(
        0.0, 1e-3, state[:2].shape
    )  # who stands in one place parts by order
    order = np.random.default_rng(seed).permutation(state.shape[1])
    assert resolve(state[:, order]) == pytest.approx(resolve(state)[:, order], abs=1e-9)


@settings(max_examples=40)
@given(heaps())
def test_no_robot_gains_energy_and_none_turns_otherwise(state: Floats) -> None:
    others = np.array([[0.3], [0.1], [0.2]])
    after = resolve(state, Obstacles(discs=[(-0.5, 0.0, 0.3)], walls=[(-1.0, 0.4, 1.0, 0.4)]), others)
    assert np.all(after[3] ** 2 + after[4] ** 2 <= (state[3] ** 2 + state[4] ** 2) * (1.0 + 1e-12))
    assert after[4] - after[3] == pytest.approx(state[4] - state[3], abs=1e-12)
    assert np.array_equal(after[2], state[2])


@settings(max_examples=40)
@given(heaps())
def test_free_robots_that_meet_keep_their_common_centre(state: Floats) -> None:
    state[:2] = 0.15 * np.round(state[:2] / 0.15) + 0.2 * state[:2]  # overlaps, none so deep that a push is cut short
    after = resolve(state)
    pushed = np.hypot(*(after[:2] - state[:2]))
    if np.all(pushed < LARGEST_PUSH * SKIN * RADIUS * 0.999):
        assert after[:2].mean(axis=1) == pytest.approx(state[:2].mean(axis=1), abs=1e-12)


@pytest.mark.parametrize(("heading", "left_over"), [(0.0, 0.0), (np.pi / 3.0, 0.75), (np.pi / 2.0, 1.0), (np.pi, 1.0)])
def test_a_wall_takes_the_speed_that_leads_into_it(heading: float, left_over: float) -> None:
    """The wall is ahead of heading 0: of the speed the square of the sine of the angle to its normal is left."""
    state = standing(np.array([-0.09]), np.zeros(1), heading, psi=10.0)
    after = resolve(state, Obstacles(walls=[(0.0, -1.0, 0.0, 1.0)]))
    assert after[0, 0] == pytest.approx(-RADIUS, abs=1e-12)
    assert after[3:, 0] == pytest.approx([10.0 * left_over] * 2, abs=1e-9)


def test_who_drives_away_loses_nothing_and_who_follows_as_fast_neither() -> None:
    state = standing(np.array([0.0, 0.19]), np.zeros(2), psi=10.0)
    assert resolve(state)[3:] == pytest.approx(state[3:], rel=1e-12)
    state[3:, 1] = 4.0
    assert resolve(state)[3, 0] == pytest.approx(4.0)  # no faster than who is ahead
    assert resolve(state)[3, 1] == 4.0


def test_a_real_robot_and_obstacles_do_not_give_way_at_all() -> None:
    state = standing(np.array([0.0]), np.array([0.0]), psi=5.0)
    real = np.array([[0.15], [0.0], [0.08]])
    before = real.copy()
    after = resolve(state, others=real)
    assert np.array_equal(real, before)
    assert after[:2, 0] == pytest.approx([0.15 - 0.18, 0.0], abs=1e-2)
    assert after[3, 0] == 0.0


def test_robots_of_no_size_and_robots_that_are_nowhere_touch_nobody() -> None:
    state = standing(np.array([0.0, 0.05, np.nan, 0.1, 1e300]), np.zeros(5), psi=3.0)
    after = state.copy()
    radius, wheel = radii(5)
    radius[[0, 1]] = 0.0
    assert not Contacts(NO_OBSTACLES).resolve(after, radius, wheel, NOBODY)
    assert np.array_equal(after, state, equal_nan=True)


def test_what_moves_is_met_wherever_it_comes_from() -> None:
    """Lists of who is near whom are made again in time, also for real robots and those put somewhere else."""
    contacts, (radius, wheel) = Contacts(NO_OBSTACLES), radii(2)
    state = standing(np.array([0.0, 5.0]), np.zeros(2))
    for x in np.arange(-3.0, 1.0, 0.004):
        contacts.resolve(state, radius, wheel, np.array([[x], [0.01], [0.1]]))
        assert np.hypot(state[0, 0] - x, state[1, 0] - 0.01) >= 0.2 - 1e-9
    state[:2, 1] = state[:2, 0] + 0.19
    state[:2, 1] -= [0.0, 0.19]
    assert contacts.resolve(state, radius, wheel, np.array([[9.0], [0.0], [0.1]]))
    assert overlap(state) <= TOLERANCE


def test_robots_that_press_into_a_corner_stay_inside_the_walls() -> None:
    random = np.random.default_rng(1)
    walls = Obstacles(walls=[(0.0, 0.0, 2.0, 0.0), (2.0, 0.0, 2.0, 2.0), (2.0, 2.0, 0.0, 2.0), (0.0, 2.0, 0.0, 0.0)])
    state = standing(*random.uniform(0.2, 1.8, (2, 25)))
    contacts, (radius, wheel) = Contacts(walls), radii(25)
    for _ in range(300):
        state[:2] += 0.006  # each drives 0.85 m/s towards the corner
        contacts.resolve(state, radius, wheel, NOBODY)
    assert np.all((state[:2] > RADIUS - 2.0 * 0.006) & (state[:2] < 2.0 - RADIUS + 2.0 * 0.006))
