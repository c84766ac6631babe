"""The paper's grid search: every candidate drives the whole path; the one nearest to the real path wins."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from cmr.calibration.segments import Segment, travelled, turned_angle
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.model.motion import parts_of
from cmr.model.parameters import DEFINITIONS
from cmr.recordings.signal import Floats, Times

# Motors of wheeled robots respond with time constants from that of a toy to that of a loaded tractor.
TIME_CONSTANTS = (0.02, 1.0)  # s
POINTS = (32, 40, 40)  # of k2_over_k3, k1, base_width
K1_SPREAD = 1.5  # the grid spans the rough value of k1, found from distance over command, times and over this
BASE_WIDTH_SPREAD = 1.7  # the same for base_width, found from turn over command

Axes: TypeAlias = tuple[Floats, Floats, Floats]  # values of k2_over_k3, k1 and base_width


@dataclass(frozen=True)
class Grid:
    """A full grid over the three parameters and its error surface.

    `mean_square` [m^2] has shape (len(k2_over_k3), len(k1), len(base_width)): the mean squared distance between the
    real and the simulated position over all time steps.
    """

    k2_over_k3: Floats
    k1: Floats
    base_width: Floats
    mean_square: Floats

    @property
    def best(self) -> dict[str, float]:
        """The grid point with the smallest error."""
        return _point((self.k2_over_k3, self.k1, self.base_width), int(np.argmin(self.mean_square)))

    @property
    def at_the_edge(self) -> tuple[str, ...]:
        """The parameters whose best value is at the edge of the grid, so that the minimum may lie outside."""
        axes: dict[str, Floats] = {name: getattr(self, name) for name in NAMES}
        return tuple(n for n, axis in axes.items() if len(axis) > 1 and self.best[n] in (axis[0], axis[-1]))


def search(segments: list[Segment], wheel_radius: float, axes: Axes) -> Grid:
    """Integrate every grid point over the whole path; `axes` are the values of the three parameters."""
    path = _path(segments, wheel_radius, axes)
    shape = tuple(len(axis) for axis in axes)
    squares = np.concatenate([_squares(path, motors, axes[2], np.inf) for motors in _blocks(axes)])
    surface = squares[: shape[0] * shape[1]].reshape(shape[1], shape[0], shape[2]).swapaxes(0, 1)
    return Grid(*axes, (surface + path.squares_at_start) / sum(len(segment.x) for segment in segments))


def minimum(segments: list[Segment], wheel_radius: float, axes: Axes) -> dict[str, float]:
    """Return the best point of `search` faster, by abandoning candidates that can no longer win.

    This is exact, because a candidate's error only grows along the path. A coarse part of the grid is driven first to
    get a good error early; then the rest, starting with neighbours of the best point.
    """
    path = _path(segments, wheel_radius, axes)
    blocks = _blocks(axes)
    coarse = range(0, len(blocks), max(int(np.sqrt(len(blocks))), 1))
    best = _Best(np.inf, 0, 0)
    for part in (coarse, set(range(len(blocks))).difference(coarse)):
        for block in sorted(part, key=lambda index, centre=best.block: abs(index - centre)):
            squares = _squares(path, blocks[block], axes[2], best.squares)
            best = min(best, _best_of(squares, block, axes))
    return _point(axes, best.point)


class _Best(NamedTuple):
    """The smallest sum of squares [m^2], the flat index of its grid point (the first of equals), and its block."""

    squares: float
    point: int
    block: int


class _Path(NamedTuple):
    """All segments in sequence, as arrays for `add_squared_distances` in cmr.calibration.sweep.

    The poses before a segment moves have the same errors for all candidates: `squares_at_start` [m^2].
    """

    left: Floats
    right: Floats
    dt: Floats
    pose_from: Times
    x: Floats
    y: Floats
    first_spans: Times
    starts: Floats
    wheel_radius: float
    squares_at_start: float


def _path(segments: list[Segment], wheel_radius: float, axes: Axes) -> _Path:
    """Join the segments; spans in which a candidate may turn far are split as in the model's own drive."""
    spans, ends, positions, starts = [], [], [], []
    first_spans, squares_at_start = [0], 0.0
    for segment in segments:
        parts = parts_of(segment.dt, wheel_radius, np.min(axes[2]), _fastest(segment, axes))
        spans.append(np.repeat([segment.left, segment.right, segment.dt / parts], parts, axis=1))
        borders = first_spans[-1] + np.concatenate([[0], np.cumsum(parts)])
        moved = segment.at > 0
        ends.append(borders[segment.at[moved]] - 1)
        from_start = np.array([segment.x - segment.start.x, segment.y - segment.start.y])
        positions.append(from_start[:, moved])
        squares_at_start += float(np.sum(from_start[:, ~moved] ** 2))
        starts.append((segment.start.theta, segment.start.psi_left, segment.start.psi_right))
        first_spans.append(borders[-1])
    left, right, dt = np.concatenate(spans, axis=1)
    x, y = np.ascontiguousarray(np.concatenate(positions, axis=1))
    pose_from = np.searchsorted(np.concatenate(ends), np.arange(len(dt) + 1))
    return _Path(
        left,
        right,
        dt,
        pose_from,
        x,
        y,
        np.array(first_spans),
        np.array(starts, dtype=float),
        wheel_radius,
        squares_at_start,
    )


def _fastest(segment: Segment, axes: Axes) -> float:
    """Return a bound [rad/s] of the wheel speeds of all candidates."""
    duty = max(float(np.max(np.abs(values), initial=0.0)) for values in (segment.left, segment.right))
    return float(max(abs(segment.start.psi_left), abs(segment.start.psi_right), duty / np.min(axes[1])))


def _blocks(axes: Axes) -> Floats:
    """Return the motors of the grid in blocks that are simulated together, shape (blocks, 2, MOTORS).

    k2_over_k3 changes fastest: it has the least influence, so motors of a block follow similar paths. The last block
    repeats the last motor.
    """
    # Imports Numba, which is slow and not needed by commands that do not calibrate.
    from cmr.calibration.sweep import MOTORS

    k2_over_k3, k1, _ = axes
    motors = np.array([np.tile(k2_over_k3, len(k1)), np.repeat(k1, len(k2_over_k3))])
    padded = np.pad(motors, ((0, 0), (0, -motors.shape[1] % MOTORS)), mode="edge")
    return np.ascontiguousarray(padded.reshape(2, -1, MOTORS).swapaxes(0, 1))


def _squares(path: _Path, motors: Floats, base_width: Floats, bound: float) -> Floats:
    """Return the sum of squared distances [m^2] of a block of motors times all base widths, shape (MOTORS, widths).

    Infinite if it certainly exceeds `bound`.
    """
    from cmr.calibration import sweep

    widths = np.pad(base_width, (0, -len(base_width) % sweep.LANES), mode="edge").reshape(-1, sweep.LANES)
    lanes = np.zeros((sweep.MOTORS, len(widths), sweep.BLOCK // sweep.LANES, sweep.LANES))
    lanes[:, :, sweep.INVERSE_WIDTH // sweep.LANES] = 1.0 / widths
    alive = np.ones(lanes.shape[:2], np.bool_)
    largest_turn = sweep.LARGEST_TURN * np.min(base_width)
    sweep.add_squared_distances(*path[:9], motors, largest_turn, bound, lanes.reshape(sweep.MOTORS, -1), alive)
    squares = np.where(alive[..., np.newaxis], lanes[:, :, sweep.ERROR // sweep.LANES], np.inf)
    return squares.reshape(sweep.MOTORS, -1)[:, : len(base_width)]


def _best_of(squares: Floats, block: int, axes: Axes) -> _Best:
    """Return the best candidate of a block."""
    shape = tuple(len(axis) for axis in axes)
    motor, width = np.nonzero(squares == np.min(squares))
    k1, k2_over_k3 = np.divmod(np.minimum(motor + block * len(squares), shape[0] * shape[1] - 1), shape[0])
    points = np.ravel_multi_index((k2_over_k3, k1, width), shape)
    return _Best(float(np.min(squares)), int(np.min(points)), block)


def _point(axes: Axes, index: int) -> dict[str, float]:
    """Return the grid point with this index in the flattened grid."""
    at = np.unravel_index(index, tuple(len(axis) for axis in axes))
    names = ("k2_over_k3", "k1", "base_width")
    return {name: float(axis[i]) for name, axis, i in zip(names, axes, at, strict=True)}


def axes_for(segments: list[Segment], wheel_radius: float, base_width: float | None) -> tuple[Floats, Floats, Floats]:
    """Choose the grid's axes from the data alone, so that wrong nominal values do not matter.

    `base_width` fixes that axis if the robot did not turn. Raises EstimationError when commands and motion are
    inconsistent.
    """
    commanded, distance, difference, angle = 0.0, 0.0, 0.0, 0.0
    for segment in segments:
        commanded += float(np.sum(np.abs(segment.left + segment.right) / 2.0 * segment.dt))
        difference += float(np.sum(np.abs(segment.right - segment.left) * segment.dt))
        distance += travelled(segment.x, segment.y)
        angle += turned_angle(segment.theta)
    if distance == 0.0 or commanded == 0.0:
        raise EstimationError("The robot did not travel while it was commanded: nothing to compare.")
    k1 = wheel_radius * commanded / distance
    k1_axis = k1 * np.geomspace(1.0 / K1_SPREAD, K1_SPREAD, POINTS[1])
    gain_axis = 1.0 / (k1 * np.geomspace(TIME_CONSTANTS[1], TIME_CONSTANTS[0], POINTS[0]))
    if base_width is not None or angle == 0.0:
        return gain_axis, k1_axis, np.array([base_width or 1.0])
    rough = wheel_radius / k1 * difference / angle
    return gain_axis, k1_axis, rough * np.geomspace(1.0 / BASE_WIDTH_SPREAD, BASE_WIDTH_SPREAD, POINTS[2])


NAMES = ("k2_over_k3", "k1", "base_width")  # the axes of a grid
ALIKE = 1.1  # factor to the least path error below which errors count as equal
AT_THE_EDGE = (
    "the error surface does not determine it: from {low:.4g} to {high:.4g} {unit}, the edge of the grid, the path "
    "error is within 10 % of the least, which is at {best:.4g}"
)


def told_by_surface(grid: Grid, names: Sequence[str]) -> tuple[dict[str, Estimate], dict[str, str]]:
    """Return the estimates that the error surface determines, and why it does not determine the others, by name.

    A value is that of the least error. Its standard deviation is half the range of values with nearly equal error, over
    all other parameters; if that reaches the edge of the grid, the range is unknown.
    """
    estimates, untold = {}, {}
    for name in names:
        values: Floats = getattr(grid, name)
        others = tuple(axis for axis, other in enumerate(NAMES) if other != name)
        alike = np.sqrt(grid.mean_square.min(axis=others)) <= ALIKE * np.sqrt(grid.mean_square.min())
        low, high = values[alike].min(), values[alike].max()
        if alike[0] or alike[-1]:
            unit = DEFINITIONS[name].unit
            untold[name] = AT_THE_EDGE.format(low=low, high=high, unit=unit, best=grid.best[name])
        else:
            estimates[name] = Estimate(grid.best[name], max(float(high - low), _step(values, grid.best[name])) / 2.0)
    return estimates, untold


def _step(values: Floats, at: float) -> float:
    """Return the spacing of the grid's values around one of them."""
    index = int(np.searchsorted(values, at))
    return float(values[min(index + 1, len(values) - 1)] - values[max(index - 1, 0)])
