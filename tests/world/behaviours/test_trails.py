"""The trail behind a leader: where it drove, by few points where it drove straight on."""

from collections.abc import Callable

import numpy as np
import pytest

from cmr.world.behaviours import path_following
from cmr.world.behaviours.path_following import ASIDE, LONGEST_PIECE
from cmr.world.behaviours.paths import ALONG, SHORTEST, Paths, X, Y
from cmr.world.behaviours.team import Floats

ROOM = 400
RADIUS = 0.4  # m

# Where leaders are after so many metres; all start at the origin, where the follower is.
WAYS: dict[str, Callable[[Floats], tuple[Floats, Floats]]] = {
    "straight": lambda s: (s * np.cos(0.3), s * np.sin(0.3)),
    "circle": lambda s: (RADIUS * np.sin(s / RADIUS), RADIUS * (1.0 - np.cos(s / RADIUS))),
    "there and back": lambda s: (1.0 - np.abs(1.0 - s), 0.0 * s),
    "a corner": lambda s: (np.minimum(s, 1.0), np.maximum(s - 1.0, 0.0)),
}


def trail_of(x: Floats, y: Floats) -> Floats:
    """Return the points (n, 4) of the trail of a follower that stays at the origin."""
    paths, nobody = Paths(), np.zeros(1)
    paths.make_room(1, ROOM)
    row, progress, piece, up_to_leader = np.zeros(1, np.int64), np.zeros(1), np.zeros(1, np.int64), np.zeros(1)
    for k in range(len(x)):
        path_following.trail(
            row, row, *paths.arrays, x[k : k + 1], y[k : k + 1], nobody, nobody, progress, piece, up_to_leader
        )
        assert up_to_leader[0] == pytest.approx(paths.length[0], abs=SHORTEST)
    points: Floats = paths.points[0, : paths.count[0]]
    return points


def away_from(points: Floats, x: Floats, y: Floats) -> Floats:
    """Return how far [m] places are from the line through the points."""
    start, way = points[:-1, [X, Y]], np.diff(points[:, [X, Y]], axis=0)
    to = np.stack([x, y], axis=1)[:, None] - start
    share = np.clip(np.sum(to * way, axis=2) / np.sum(way**2, axis=1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(to - share[..., None] * way, axis=2).min(axis=1))


@pytest.mark.parametrize("way", WAYS)
def test_a_trail_goes_where_the_leader_drove(way: str) -> None:
    driven = np.arange(0.0, 2.0, 0.003)
    x, y = WAYS[way](driven)
    points = trail_of(x, y)
    # A point is left out where it is ASIDE of a line; those before it on an arc are up to twice as far.
    # Where the leader turns sharply, or back, the end is cut by no more than the spacing of points makes.
    cut = SHORTEST if way in ("a corner", "there and back") else 0.0
    reached = driven <= points[-1, ALONG]
    assert away_from(points, x[reached], y[reached]).max() < 2.0 * ASIDE + cut + 0.003
    np.testing.assert_allclose(np.diff(points[:, ALONG]), np.hypot(*np.diff(points[:, [X, Y]], axis=0).T))
    assert points[-1, ALONG] == pytest.approx(2.0, abs=2.0 * SHORTEST)


def test_straight_on_few_points_tell_the_way() -> None:
    straight, circle = (trail_of(*WAYS[way](np.arange(0.0, 2.0, 0.003))) for way in ("straight", "circle"))
    assert np.diff(straight[:, ALONG]).max() < LONGEST_PIECE
    assert len(straight) <= 2.0 / (LONGEST_PIECE - 2.0 * SHORTEST) + 2
    assert len(straight) < len(circle) / 2
