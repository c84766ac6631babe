"""Refine parameters by least squares, and tell how well the data determine them.

Three signals are compared with the model: the measured positions, which the paper's calibration minimises; the
measured headings of short drives; and, where the commands are driven, the wheel speeds. Positions fix how far and how
tightly the robot goes (k1, base_width), but in short drives they also show where on the robot the pose is taken, so
that there the headings fix base_width. Positions say little about how fast the motors answer, because every small
disturbance of the drive adds up in them; the wheel speeds fix just that. A free factor between measured and modelled
wheel speeds keeps a wrong wheel radius, or a wrong number of ticks per turn, out of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cmr.calibration.result import Estimate
from cmr.calibration.segments import Segment
from cmr.model.motion import Trajectory
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Floats

COMMAND_TIME_STD = 1e-3  # s; how well it is known when a command takes effect: a serial line takes about as long
RELATIVE_STEP = 1e-5  # of the central differences; errors of the derivative stay near 1e-10
START_COORDINATES = 3  # x, y, theta of a segment's start are fitted along with the parameters
ROUNDS = 3  # fits, each with the noise that the one before left; it settles in two
BATCHES = 16  # per series; each then lasts some seconds of a figure-eight, longer than disturbances last
SMALLEST_NOISE = 1e-12  # keeps perfect, made-up data from dividing by zero


PRIOR = "prior"  # the signal of what is known beforehand
WHEEL_FACTOR, COMMAND_TIME = "wheel factor", "command time"  # names of unknowns beside the model's parameters


@dataclass(frozen=True)
class Refined:
    """The estimates, and the factor by which measured wheel speeds exceed the modelled ones (None: not fitted)."""

    estimates: dict[str, Estimate]
    wheel_factor: Estimate | None


@dataclass(frozen=True)
class _Block:
    """The residuals of one signal in one segment, in its own unit, with their Jacobian (residuals, unknowns)."""

    signal: str
    residuals: Floats
    jacobian: Floats


@dataclass(frozen=True)
class Refinement:
    """Least squares fit of the parameters `names` to all segments.

    `values` holds all four parameters: a first guess of those in `names`, and the fixed value of the others.
    `by_wheels` follows the recorded wheel angles instead of driving the recorded commands.
    Unknowns are the logarithms of the parameters (they are positive and differ by decades); where commands are
    driven, the time [s] by which they take effect later than stamped, known beforehand to COMMAND_TIME_STD; the
    logarithm of the wheel factor; then a shift (m, m) and a rotation (rad) of the start pose of each segment with
    poses enough.
    """

    segments: list[Segment]
    names: tuple[str, ...]
    values: Mapping[str, float]
    by_wheels: bool = False

    def solve(self) -> Refined:
        """Return the estimates of `names`; a standard deviation is infinite where the data say nothing."""
        unknowns = np.zeros(self._start_column + START_COORDINATES * sum(s.fits_start for s in self.segments))
        unknowns[: len(self.names)] = [np.log(self.values[name]) for name in self.names]
        for _round in range(ROUNDS):
            unknowns = self._fit(unknowns, _effective_noise(self.linearise(unknowns), len(unknowns)))
        noise = _effective_noise(self.linearise(unknowns), len(unknowns))
        _residuals, jacobian = _stack(self.linearise(unknowns), noise)
        spread = np.sqrt(np.diag(_covariance(jacobian)))
        found = {
            name: Estimate(float(np.exp(unknowns[column])), float(np.exp(unknowns[column]) * spread[column]))
            for column, name in enumerate(self._columns)
        }
        return Refined({name: found[name] for name in self.names}, found.get(WHEEL_FACTOR))

    @property
    def _columns(self) -> tuple[str, ...]:
        """The unknowns before the start poses, in order."""
        if self.by_wheels:
            return self.names
        has_wheels = any(len(segment.wheels_at) > 1 for segment in self.segments)
        return (*self.names, COMMAND_TIME, *((WHEEL_FACTOR,) if has_wheels else ()))

    @property
    def _start_column(self) -> int:
        """Where the start poses begin among the unknowns."""
        return len(self._columns)

    def _fit(self, first: Floats, noise: Mapping[str, float]) -> Floats:
        last: dict[bytes, tuple[Floats, Floats]] = {}

        def evaluate(unknowns: Floats) -> tuple[Floats, Floats]:
            key = unknowns.tobytes()
            if key not in last:
                last.clear()
                last[key] = _stack(self.linearise(unknowns), noise)
            return last[key]

        solution = least_squares(
            lambda unknowns: evaluate(unknowns)[0], first, jac=lambda unknowns: evaluate(unknowns)[1], x_scale="jac"
        )
        return np.asarray(solution.x)

    def linearise(self, unknowns: Floats) -> list[_Block]:
        """Return the residuals and Jacobians of every signal in every segment."""
        candidates = self._candidates(unknowns[: len(self.names)])
        blocks = []
        column = self._start_column
        for segment in self.segments:
            path = segment.follow_wheels(candidates) if self.by_wheels else segment.simulate(candidates)
            starts = slice(column, column + START_COORDINATES) if segment.fits_start else None
            blocks += self._path_blocks(path, segment, unknowns, starts)
            if WHEEL_FACTOR in self._columns and len(segment.wheels_at) > 1:
                blocks += self._wheel_blocks(path, segment, unknowns)
            column += START_COORDINATES * segment.fits_start
        if COMMAND_TIME in self._columns:
            blocks.append(self._prior_block(unknowns))
        return blocks

    def _path_blocks(self, path: Trajectory, segment: Segment, unknowns: Floats, starts: slice | None) -> list[_Block]:
        """Return the residuals of positions [m] and headings [rad]; `starts` are the columns of the start pose.

        Headings are compared in short segments only (in long ones they repeat what the positions say), and about
        their mean: markers need not point forward exactly.
        """
        shift = np.zeros(START_COORDINATES) if starts is None else unknowns[starts]
        time = segment.border_times
        x, y = _placed(path, segment, shift)
        blocks = []
        columns = _start_columns(x[segment.at, 0], y[segment.at, 0], segment, shift)
        for axis, (modelled, measured) in enumerate(((x, segment.x), (y, segment.y))):
            residual = modelled[segment.at] - measured[:, np.newaxis]
            block = self._block("position", residual, np.gradient(modelled[:, 0], time)[segment.at], unknowns)
            if starts is not None:
                block.jacobian[:, starts] = columns[axis]
            blocks.append(block)
        if "base_width" in self.names and starts is None:
            residual = path.theta[segment.at] - segment.theta[:, np.newaxis]
            rate = np.gradient(path.theta[:, 0], time)[segment.at]
            blocks.append(self._block("heading", residual - residual.mean(axis=0), rate - rate.mean(), unknowns))
        return blocks

    def _wheel_blocks(self, path: Trajectory, segment: Segment, unknowns: Floats) -> list[_Block]:
        """Return the residuals of each side's speed [rad/s], averaged between measurements."""
        column = self._columns.index(WHEEL_FACTOR)
        factor = np.exp(unknowns[column])
        at = segment.wheels_at
        span = np.diff(segment.border_times[at])
        blocks = []
        for psi, modelled, measured in (
            (path.psi_left, path.angle_left, segment.angle_left),
            (path.psi_right, path.angle_right, segment.angle_right),
        ):
            speed = factor * np.diff(modelled[at], axis=0) / span[:, np.newaxis]
            residual = speed - (np.diff(measured[at]) / span)[:, np.newaxis]
            block = self._block("wheel speed", residual, factor * np.diff(psi[at, 0]) / span, unknowns)
            block.jacobian[:, column] = speed[:, 0]
            blocks.append(block)
        return blocks

    def _block(self, signal: str, residual: Floats, rate: Floats, unknowns: Floats) -> _Block:
        """Return the residuals of the first candidate with their derivatives by the parameters and the command time.

        `residual` has shape (n, candidates); `rate` is the modelled signal's derivative by time, shape (n,): what
        happens later by a little is less by that much of it.
        """
        jacobian = np.zeros((len(residual), len(unknowns)))
        jacobian[:, : len(self.names)] = (residual[:, 1::2] - residual[:, 2::2]) / (2.0 * RELATIVE_STEP)
        first = residual[:, 0]
        if COMMAND_TIME in self._columns:
            column = self._columns.index(COMMAND_TIME)
            jacobian[:, column] = -rate
            first = first - rate * unknowns[column]
        return _Block(signal, first, jacobian)

    def _prior_block(self, unknowns: Floats) -> _Block:
        """Return what is known beforehand of the command time, in units of its standard deviation."""
        column = self._columns.index(COMMAND_TIME)
        jacobian = np.zeros((1, len(unknowns)))
        jacobian[0, column] = 1.0 / COMMAND_TIME_STD
        return _Block(PRIOR, unknowns[column : column + 1] / COMMAND_TIME_STD, jacobian)

    def _candidates(self, logarithms: Floats) -> RobotParameters:
        """Return 1 + 2 len(names) candidates: the point itself, then each of `names` a step up and a step down."""
        values = {name: np.full(1 + 2 * len(self.names), self.values[name]) for name in RobotParameters._fields}
        for index, name in enumerate(self.names):
            values[name][:] = np.exp(logarithms[index])
            values[name][1 + 2 * index] *= np.exp(RELATIVE_STEP)
            values[name][2 + 2 * index] *= np.exp(-RELATIVE_STEP)
        return RobotParameters.of(values)


def _stack(blocks: list[_Block], noise: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Return all residuals and Jacobians in units of their noise."""
    return (
        np.concatenate([block.residuals / noise[block.signal] for block in blocks]),
        np.concatenate([block.jacobian / noise[block.signal] for block in blocks]),
    )


def _effective_noise(blocks: list[_Block], unknowns: int) -> dict[str, float]:
    """Return each signal's noise, enlarged where residuals follow one another in time.

    The means of batches of n independent residuals scatter with a variance n times smaller than the residuals do.
    Where slow disturbances make the batch means scatter more, that many times more counts as noise (method of batch
    means for the variance of a correlated series).
    """
    noise = {PRIOR: 1.0}
    for signal in {block.signal for block in blocks} - {PRIOR}:
        series = [block.residuals for block in blocks if block.signal == signal]
        batches = [batch for values in series for batch in np.array_split(values, min(BATCHES, len(values)))]
        count = sum(len(values) for values in series)
        freedom = max(count - unknowns, 1) / count
        white = sum(float(values @ values) for values in series) / count
        slow = sum(float(np.sum(batch)) ** 2 for batch in batches) / count
        noise[signal] = max(float(np.sqrt(max(white, slow) / freedom)), SMALLEST_NOISE)
    return noise


def _covariance(jacobian: Floats) -> Floats:
    """Return the unknowns' covariance from a Jacobian in units of the noise; infinite where it is silent."""
    scale = np.linalg.norm(jacobian, axis=0)
    silent = scale == 0.0
    scale = np.where(silent, 1.0, scale)
    normal = jacobian / scale
    covariance = np.linalg.pinv(normal.T @ normal) / np.outer(scale, scale)
    covariance[silent, silent] = np.inf
    return np.asarray(covariance)


def _placed(path: Trajectory, segment: Segment, shift: Floats) -> tuple[Floats, Floats]:
    """Return the path rotated by shift[2] about the segment's start and moved by shift[:2]."""
    x, y = path.x - segment.start.x, path.y - segment.start.y
    cos, sin = np.cos(shift[2]), np.sin(shift[2])
    return (segment.start.x + shift[0] + cos * x - sin * y, segment.start.y + shift[1] + sin * x + cos * y)


def _start_columns(x: Floats, y: Floats, segment: Segment, shift: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives of the placed positions x and y by the three start coordinates, each of shape (M, 3)."""
    one, zero = np.ones_like(x), np.zeros_like(x)
    return (
        np.column_stack([one, zero, -(y - segment.start.y - shift[1])]),
        np.column_stack([zero, one, x - segment.start.x - shift[0]]),
    )
