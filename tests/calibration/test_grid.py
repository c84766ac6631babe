"""What the grid search promises: every point of the grid, driven over the whole path, as a plain loop would."""

import itertools
import tracemalloc
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.calibration.grid import Axes, _blocks, _path, _squares, axes_for, minimum, search
from cmr.calibration.segments import Segment
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats, Times

RADIUS = 0.04  # m
TRUTH = RobotParameters(RADIUS, 118.0, 0.054, 0.16)
NOISE = 0.01  # m
# The series leave out less than 1e-14 of a leg's way. A leg is at most 30 times as long as the noise of its poses, so
# that sums of squared distances agree to 30^2 * 1e-14 and the rounding of some hundred spans.
ROUNDING = 1e-10


def axes_around(gains: int, k1s: int, widths: int, spread: float = 1.6) -> Axes:
    """A grid around the truth that does not hold it."""
    return (
        110.0 * np.geomspace(1.0 / 5.0, 5.0, gains),
        0.055 * np.geomspace(1.0 / spread, spread, k1s),
        0.165 * np.geomspace(1.0 / spread, spread, widths),
    )


def segment_of(left: Floats, right: Floats, dt: Floats, at: Times, start: RobotState, seed: int = 0) -> Segment:
    """A drive as a robot with the parameters TRUTH would be recorded, with noisy poses at the borders `at`."""
    path = drive(left, right, dt, TRUTH, start)
    noise = np.random.default_rng(seed).normal(scale=NOISE, size=(2, len(at)))
    driven = {
        "dt": dt,
        "left": left,
        "right": right,
        "at": at,
        "utime": np.round(np.concatenate([[0.0], np.cumsum(dt)])[at] * 1e6).astype(np.int64),
        "x": path.x[at] + noise[0],
        "y": path.y[at] + noise[1],
        "theta": path.theta[at],
        "start": start,
    }
    return Segment(**{field.name: driven.get(field.name, np.empty(0)) for field in fields(Segment)})  # no wheels


def random_drive(seed: int, spans: int = 300, longest: float = 0.04) -> Segment:
    """A drive with duties that jump, spans of any length up to `longest` [s], and poses here and there."""
    rng = np.random.default_rng(seed)
    hold = rng.integers(1, 40)
    left, right = np.repeat(rng.uniform(-0.8, 0.8, (2, spans // hold + 1)), hold, axis=1)[:, :spans]
    dt = rng.uniform(1e-4, longest, spans)
    at = np.sort(rng.choice(spans + 1, size=rng.integers(1, spans), replace=False))
    x, y, theta, psi_left, psi_right = rng.uniform(-3.0, 3.0, 5)
    start = RobotState(x, y, theta, psi_left, psi_right, 0.0, 0.0)
    return segment_of(left, right, dt, at, start, seed)


def figure_eight(spans: int = 800) -> Segment:
    """A figure-eight at 100 Hz, after a rest."""
    turning = 0.09 * np.sin(2.0 * np.pi * np.arange(spans) / spans)
    moving = np.arange(spans) > 50
    dt = np.full(spans, 0.01)
    at = np.arange(spans + 1)
    return segment_of((0.42 - turning) * moving, (0.42 + turning) * moving, dt, at, RobotState.at_rest(1.0, 2.0, 0.5))


def naive(segments: list[Segment], axes: Axes) -> Floats:
    """The mean squared distance of every grid point, by a loop over the grid."""
    result = np.empty(tuple(len(axis) for axis in axes))
    for index in itertools.product(*(range(len(axis)) for axis in axes)):
        gain, k1, width = (float(axis[i]) for axis, i in zip(axes, index, strict=True))
        parameters = RobotParameters(RADIUS, gain, k1, width)
        squares = []
        for segment in segments:
            path = segment.simulate(parameters)
            squares.append((path.x[segment.at] - segment.x) ** 2 + (path.y[segment.at] - segment.y) ** 2)
        result[index] = np.mean(np.concatenate(squares))
    return result


def test_the_grid_is_the_loop_over_all_its_points() -> None:
    axes = axes_around(5, 7, 9)
    segment = figure_eight()
    grid = search([segment], RADIUS, axes)
    np.testing.assert_allclose(grid.mean_square, naive([segment], axes), rtol=ROUNDING)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 5), st.integers(1, 10))
def test_any_drive_gives_what_the_loop_gives(seed: int, gains: int, k1s: int, widths: int) -> None:
    axes = axes_around(gains, k1s, widths)
    segment = random_drive(seed)
    np.testing.assert_allclose(search([segment], RADIUS, axes).mean_square, naive([segment], axes), rtol=ROUNDING)


@pytest.mark.parametrize("longest", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_long_gaps_are_driven_as_the_model_drives_them(longest: float, seed: int) -> None:
    axes = axes_around(3, 4, 5)
    segment = random_drive(seed, longest=longest)
    # The model splits long spans alike for all candidates of one call, so that all are driven by one.
    gains, k1s, widths = np.meshgrid(*axes, indexing="ij")
    candidates = RobotParameters(RADIUS, gains, k1s, widths)
    path = drive(segment.left, segment.right, segment.dt, candidates, segment.start, segment.at)
    squares = (path.x - segment.x[:, None, None, None]) ** 2 + (path.y - segment.y[:, None, None, None]) ** 2
    np.testing.assert_allclose(search([segment], RADIUS, axes).mean_square, squares.mean(axis=0), rtol=ROUNDING)


def test_a_spin_on_the_spot_is_what_the_loop_gives() -> None:
    spans = 400
    left = np.full(spans, -0.5)
    axes = axes_around(3, 4, 17)
    segment = segment_of(left, -left, np.full(spans, 0.01), np.arange(spans + 1), RobotState.at_rest())
    np.testing.assert_allclose(search([segment], RADIUS, axes).mean_square, naive([segment], axes), rtol=ROUNDING)


def test_several_poses_at_one_moment_all_count() -> None:
    segment = figure_eight(200)
    twice = replace(segment, at=np.repeat(segment.at, 2), x=np.repeat(segment.x, 2), y=np.repeat(segment.y, 2))
    twice.x[1::2] += 0.1
    axes = axes_around(2, 3, 4)
    np.testing.assert_allclose(search([twice], RADIUS, axes).mean_square, naive([twice], axes), rtol=ROUNDING)


def test_where_the_origin_lies_does_not_matter() -> None:
    here = figure_eight(200)
    x, y = 4096.0, -8192.0  # m; positions there are rounded by less than 1e-12 m
    there = replace(here, x=here.x + x, y=here.y + y, start=here.start._replace(x=here.start.x + x, y=here.start.y + y))
    axes = axes_around(2, 3, 4)
    near, far = (search([segment], RADIUS, axes).mean_square for segment in (here, there))
    np.testing.assert_allclose(far, near, rtol=2.0 * 1e-12 / NOISE)


def test_segments_are_summed_pose_by_pose() -> None:
    segments = [random_drive(1), figure_eight(100), random_drive(2, spans=40)]
    axes = axes_around(3, 4, 5)
    np.testing.assert_allclose(search(segments, RADIUS, axes).mean_square, naive(segments, axes), rtol=ROUNDING)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 12), st.integers(1, 20))
def test_giving_candidates_up_early_finds_the_same_minimum(seed: int, gains: int, k1s: int, widths: int) -> None:
    segments = [random_drive(seed), random_drive(seed // 2)]
    axes = axes_around(gains, k1s, widths)
    assert minimum(segments, RADIUS, axes) == search(segments, RADIUS, axes).best


def test_candidates_are_given_up_only_when_their_error_exceeds_the_bound() -> None:
    axes = axes_around(8, 2, 24)
    path = _path([figure_eight()], RADIUS, axes)
    (motors,) = _blocks(axes)
    whole = _squares(path, motors, axes[2], np.inf)
    bound = float(np.quantile(whole, 0.3))
    early = _squares(path, motors, axes[2], bound)
    given_up = np.isinf(early)
    assert given_up.any()
    assert np.all(whole[given_up] > bound)
    np.testing.assert_array_equal(early[~given_up], whole[~given_up])


def test_of_equal_candidates_both_ways_name_the_first() -> None:
    spans = 300
    duty = np.full(spans, 0.4)
    straight = segment_of(duty, duty, np.full(spans, 0.01), np.arange(spans + 1), RobotState.at_rest())
    axes = axes_around(20, 6, 12)
    best = search([straight], RADIUS, axes).best
    assert best["base_width"] == axes[2][0]  # a robot that goes straight does so with any base width
    assert minimum([straight], RADIUS, axes) == best


def test_memory_does_not_grow_with_candidates_times_samples() -> None:
    axes = axes_around(8, 8, 8)
    segment = figure_eight(60_000)
    tracemalloc.start()
    try:
        search([segment], RADIUS, axes)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    recorded = sum(values.nbytes for values in (segment.dt, segment.left, segment.right, segment.x, segment.y))
    assert peak < 10 * recorded  # 512 candidates' paths would take 200 times as much


def test_the_chosen_axes_hold_the_truth_and_the_grid_finds_its_neighbourhood() -> None:
    segment = figure_eight(3000)
    axes = axes_for([segment], RADIUS, None)
    truth = (TRUTH.k2_over_k3, TRUTH.k1, TRUTH.base_width)
    for axis, value in zip(axes, truth, strict=True):
        assert axis[0] < value < axis[-1] or axis[-1] < value < axis[0]
    best = search([segment], RADIUS, axes).best
    # The best point of a grid need not be the nearest to the truth, but lies within two of its steps.
    for name, axis, value in zip(("k1", "base_width"), axes[1:], truth[1:], strict=True):
        assert abs(np.log(best[name] / value)) < 2.0 * np.log(axis[1] / axis[0])
