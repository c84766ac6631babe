"""The range sensor sees what geometry says, and what trying every ray against everything says."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cmr.world.interaction.range_sensor import RangeSensor

Floats = NDArray[np.float64]
FOUR = RangeSensor(rays=4, first=0.0, step=math.pi / 2.0)  # ahead, left, behind, right
NO_DISCS, NO_WALLS, NOT_SEEN = np.zeros((3, 0)), np.zeros((4, 0)), [-1]


def at(x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> Floats:
    return np.array([[x], [y], [theta]])


def every_ray(sensor: RangeSensor, pose: Floats, own: list[int], discs: Floats, walls: Floats) -> Floats:
    """Try every ray against everything, by the textbook's formulas."""
    ranges = np.full((pose.shape[1], sensor.rays), np.inf)
    for i, (x, y, theta) in enumerate(pose.T):
        for k in range(sensor.rays):
            c, s = math.cos(theta + sensor.first + k * sensor.step), math.sin(theta + sensor.first + k * sensor.step)
            for d, (u, v, radius) in enumerate(discs.T):
                along, squared = (u - x) * c + (v - y) * s, (u - x) ** 2 + (v - y) ** 2 - radius**2
                if d != own[i] and (squared <= 0.0 or (along > 0.0 and along**2 >= squared)):
                    distance = 0.0 if squared <= 0.0 else along - math.sqrt(along**2 - squared)
                    ranges[i, k] = min(ranges[i, k], distance) if distance <= sensor.reach else ranges[i, k]
            for x1, y1, x2, y2 in walls.T:
                slope = c * (y2 - y1) - s * (x2 - x1)
                distance = ((x1 - x) * (y2 - y1) - (y1 - y) * (x2 - x1)) / slope if slope else -1.0
                share = ((x1 - x) * s - (y1 - y) * c) / slope if slope else -1.0
                if 0.0 <= share <= 1.0 and 0.0 <= distance <= sensor.reach:
                    ranges[i, k] = min(ranges[i, k], distance)
    return ranges


@settings(max_examples=40)
@given(st.integers(0, 2**32), st.integers(0, 12), st.integers(0, 4), st.sampled_from([1, 7, 90]), st.booleans())
def test_it_sees_what_every_ray_against_everything_sees(
    seed: int, discs: int, walls: int, rays: int, half: bool
) -> None:
    random = np.random.default_rng(seed)
    sensor = RangeSensor(rays, random.uniform(-7.0, 7.0), (1.0 + (not half)) * math.pi / rays, 5.0)
    pose = np.vstack([random.uniform(-4.0, 4.0, (2, 3)), random.uniform(-9.0, 9.0, 3)])
    things = np.vstack([random.uniform(-6.0, 6.0, (2, discs)), random.uniform(0.05, 1.5, discs)])
    own = [-1, 0, discs - 1]
    segments = random.uniform(-8.0, 8.0, (4, walls))
    seen = sensor.scan(pose, own, things, segments)
    assert seen == pytest.approx(every_ray(sensor, pose, own, things, segments), abs=1e-6)


@pytest.mark.parametrize("side", [20.0, 200.0, 1e4, 1e6])
def test_among_many_discs_each_sensor_sees_those_around_it_wherever_they_are(side: float) -> None:
    """Each sensor, one of the discs itself, has some of them around it; how far the others are depends."""
    random = np.random.default_rng(round(side))
    sensor = RangeSensor(180, -math.pi, 2.0 * math.pi / 180, 5.0)
    discs = np.vstack([random.uniform(-side, side, (2, 400)), random.uniform(0.05, 0.5, 400)])
    discs[:2, 100:] = discs[:2, np.arange(300) % 100] + random.uniform(-4.0, 4.0, (2, 300))
    discs[2, 7], discs[0, 8] = np.nan, np.inf
    own = [0, 50, 99, 399]
    pose = np.vstack([discs[:2, own], random.uniform(-9.0, 9.0, 4)])
    seen = sensor.scan(pose, own, discs, NO_WALLS)
    for i, k in enumerate(own):
        near = np.hypot(*(discs[:2] - discs[:2, [k]])) < 5.6
        near[k] = False
        expected = every_ray(sensor, pose[:, [i]], NOT_SEEN, discs[:, near], NO_WALLS)
        assert seen[i] == pytest.approx(expected[0], abs=1e-6)
        assert np.isfinite(seen[i]).any()  # so that there is something to agree on


def test_ranges_to_a_disc_and_a_wall_are_those_of_geometry() -> None:
    seen = FOUR.scan(at(1.0, 1.0), NOT_SEEN, [[4.0], [1.0], [0.5]], [[-1.0], [-1.0], [-1.0], [6.0]])
    assert seen[0] == pytest.approx([2.5, np.inf, 2.0, np.inf])
    turned = FOUR.scan(at(1.0, 1.0, math.pi / 2.0), NOT_SEEN, [[4.0], [1.0], [0.5]], [[-1.0], [-1.0], [-1.0], [6.0]])
    assert turned[0] == pytest.approx([np.inf, 2.0, np.inf, 2.5])


def test_a_disc_is_met_by_the_rays_between_its_tangents_and_by_no_other() -> None:
    sensor = RangeSensor()
    seen = sensor.scan(at(), NOT_SEEN, [[2.0], [0.0], [0.5]], NO_WALLS)[0]
    angles = sensor.first + sensor.step * np.arange(360)
    inside = np.abs(angles) <= math.asin(0.25)
    assert np.array_equal(np.isfinite(seen), inside)
    expected = 2.0 * np.cos(angles[inside]) - np.sqrt(0.25 - (2.0 * np.sin(angles[inside])) ** 2)
    assert seen[inside] == pytest.approx(expected, abs=1e-12)


def test_nothing_is_seen_beyond_the_reach_nor_of_the_own_robot() -> None:
    assert np.all(np.isinf(FOUR.scan(at(), NOT_SEEN, [[6.0], [0.0], [0.5]], [[5.1], [-1.0], [5.1], [1.0]])))
    assert FOUR.scan(at(), NOT_SEEN, [[5.5], [0.0], [0.5]], NO_WALLS)[0, 0] == 5.0
    assert np.all(np.isinf(FOUR.scan(at(), [0], [[0.0], [0.0], [0.5]], NO_WALLS)))
    assert np.all(FOUR.scan(at(), NOT_SEEN, [[0.1], [0.0], [0.5]], NO_WALLS) == 0.0)


def test_who_is_nowhere_sees_nobody_and_is_not_seen() -> None:
    nowhere = np.array([[np.nan, 0.0], [0.0, 0.0], [0.0, 0.0]])
    seen = FOUR.scan(nowhere, [-1, -1], [[np.nan], [0.0], [0.5]], [[1.0], [-1.0], [1.0], [1.0]])
    assert np.all(np.isinf(seen[0]))
    assert seen[1, 0] == pytest.approx(1.0)
    assert np.all(np.isinf(seen[1, 1:]))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"rays": 0}, "1 to"),
        ({"step": 0.0}, "counter-clockwise"),
        ({"rays": 400}, "one turn"),
        ({"reach": np.nan}, "reach"),
    ],
)
def test_a_sensor_that_cannot_be_is_refused(settings: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        RangeSensor(**settings)  # type: ignore[arg-type]
