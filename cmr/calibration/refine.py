"""Refine parameters by least squares, and tell how well the data determine them.

Three signals are compared with the model: the measured positions, which the paper's calibration minimises, the
measured headings and, where the commands are driven, the wheel speeds. Positions fix how far and how tightly the
robot goes (k1, base_width), but of short drives they also show where on the robot the pose is taken; the headings
fix base_width wherever that is. Positions say little about how fast the motors answer, because every small
disturbance of the drive adds up in them. The wheel speeds fix just that. A free factor between measured and modelled
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

RELATIVE_STEP = 1e-5  # of the central differences; errors of the derivative stay near 1e-10
START_COORDINATES = 3  # x, y, theta of a segment's start are fitted along with the parameters
ROUNDS = 3  # fits, each with the noise that the one before left; it settles in two
BATCHES = 16  # per series; each then lasts some seconds of a figure-eight, longer than disturbances last
SMALLEST_NOISE = 1e-12  # keeps perfect, made-up data from dividing by zero


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
    Unknowns are the logarithms of the parameters (they are positive and differ by decades), the logarithm of the
    wheel factor, then a shift (m, m) and a rotation (rad) of the start pose of each segment with poses enough.
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
        found = [
            Estimate(float(np.exp(value)), float(np.exp(value) * std))
            for value, std in zip(unknowns[: self._start_column], spread[: self._start_column], strict=True)
        ]
        count = len(self.names)
        return Refined(
            dict(zip(self.names, found[:count], strict=True)), found[count] if self._fits_wheel_factor else None
        )

    @property
    def _start_column(self) -> int:
        """Where the start poses begin among the unknowns."""
        return len(self.names) + self._fits_wheel_factor

    @property
    def _fits_wheel_factor(self) -> bool:
        """Whether there are wheel speeds to compare with the driven commands."""
        return not self.by_wheels and any(len(segment.wheels_at) > 1 for segment in self.segments)

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
            shift = np.zeros(START_COORDINATES)
            if segment.fits_start:
                shift = unknowns[column : column + START_COORDINATES]
            x, y = _placed(path, segment, shift)
            residual = np.concatenate([x - segment.x[:, np.newaxis], y - segment.y[:, np.newaxis]])
            jacobian = self._parameter_columns(residual, len(unknowns))
            if segment.fits_start:
                jacobian[:, column : column + START_COORDINATES] = _start_columns(x[:, 0], y[:, 0], segment, shift)
                column += START_COORDINATES
            half = len(segment.x)
            blocks.append(_Block("position", residual[:half, 0], jacobian[:half]))
            blocks.append(_Block("position", residual[half:, 0], jacobian[half:]))
            if "base_width" in self.names:
                blocks.append(self._heading_block(path, segment, len(unknowns)))
            if not self.by_wheels and len(segment.wheels_at) > 1:
                blocks += self._wheel_blocks(path, segment, unknowns)
        return blocks

    def _heading_block(self, path: Trajectory, segment: Segment, unknowns: int) -> _Block:
        """Return the residuals of the heading [rad], about their mean: markers need not point forward exactly."""
        residual = path.theta[segment.at] - segment.theta[:, np.newaxis]
        residual = residual - residual.mean(axis=0)
        return _Block("heading", residual[:, 0], self._parameter_columns(residual, unknowns))

    def _wheel_blocks(self, path: Trajectory, segment: Segment, unknowns: Floats) -> list[_Block]:
        """Return the residuals of each side's speed [rad/s], averaged between measurements."""
        factor = np.exp(unknowns[len(self.names)])
        at = segment.wheels_at
        time = np.concatenate([[0.0], np.cumsum(segment.dt)])[at]
        blocks = []
        for modelled, measured in ((path.angle_left, segment.angle_left), (path.angle_right, segment.angle_right)):
            speed = factor * np.diff(modelled[at], axis=0) / np.diff(time)[:, np.newaxis]
            residual = speed - (np.diff(measured[at]) / np.diff(time))[:, np.newaxis]
            jacobian = self._parameter_columns(residual, len(unknowns))
            jacobian[:, len(self.names)] = speed[:, 0]
            blocks.append(_Block("wheel speed", residual[:, 0], jacobian))
        return blocks

    def _candidates(self, logarithms: Floats) -> RobotParameters:
        """Return 1 + 2 len(names) candidates: the point itself, then each of `names` a step up and a step down."""
        values = {name: np.full(1 + 2 * len(self.names), self.values[name]) for name in RobotParameters._fields}
        for index, name in enumerate(self.names):
            values[name][:] = np.exp(logarithms[index])
            values[name][1 + 2 * index] *= np.exp(RELATIVE_STEP)
            values[name][2 + 2 * index] *= np.exp(-RELATIVE_STEP)
        return RobotParameters.of(values)

    def _parameter_columns(self, residual: Floats, unknowns: int) -> Floats:
        """Return a Jacobian whose first columns are the derivatives by the parameters, the others zero."""
        jacobian = np.zeros((len(residual), unknowns))
        jacobian[:, : len(self.names)] = (residual[:, 1::2] - residual[:, 2::2]) / (2.0 * RELATIVE_STEP)
        return jacobian


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
    noise = {}
    for signal in {block.signal for block in blocks}:
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
    """Return the path at the poses' times, rotated by shift[2] about the segment's start and moved by shift[:2]."""
    x, y = path.x[segment.at] - segment.start.x, path.y[segment.at] - segment.start.y
    cos, sin = np.cos(shift[2]), np.sin(shift[2])
    return (segment.start.x + shift[0] + cos * x - sin * y, segment.start.y + shift[1] + sin * x + cos * y)


def _start_columns(x: Floats, y: Floats, segment: Segment, shift: Floats) -> Floats:
    """Return the derivatives of the placed positions with respect to the three start coordinates, shape (2 M, 3)."""
    one, zero = np.ones_like(x), np.zeros_like(x)
    along_x = np.column_stack([one, zero, -(y - segment.start.y - shift[1])])
    along_y = np.column_stack([zero, one, x - segment.start.x - shift[0]])
    return np.concatenate([along_x, along_y])
