"""Refine parameters by least squares, with standard deviations.

Three signals are compared with the model, if recorded: the measured positions, which the paper's calibration minimises;
the measured headings; and, where the commands are driven, the angles through which the wheels have turned. Positions
fix how far and how tightly the robot goes (k1, base_width). They hardly determine how fast the motors respond, because
small disturbances accumulate in them; wheel angles determine exactly that. A free factor between measured and modelled
wheel angles makes this independent of a wrong wheel radius, or a wrong number of ticks per turn.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cmr.calibration.linear import COMMAND_TIME, OWN, POSE_TIME, TIMES, WHEEL_FACTOR, Candidates, Linear, Unknowns
from cmr.calibration.noise import ORDER, Noise, Series, noise_of
from cmr.calibration.normal import NormalEquations
from cmr.calibration.segments import Segment
from cmr.estimation.estimates import Estimate
from cmr.model.motion import Trajectory
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Floats

PREFIXES = (5.0, 15.0, 40.0)  # s; fitting longer and longer beginnings leads a bad initial guess to the optimum
SMALLEST_PSI_STD = 1e-3  # rad/s; of a wheel that rests while the other one turns
GUESS_STD = float(np.log(2.0))  # of a parameter's logarithm, while a beginning is not informative
COARSE = 1000  # measurements of each signal suffice for the first fits
ROUNDS = 6  # fits, each with the noise estimated from the previous one; most converge in two or three
SETTLED = 0.1  # standard deviations; smaller changes count as converged
ITERATIONS = 40
LONGEST_STEP = 1.0  # of a parameter's logarithm; the linearisation is invalid beyond
NEGLIGIBLE = 1e-3  # of the cost function; parameters are then some hundredths of a standard deviation from the optimum
NEAR = 0.01  # share of the cost; sufficient if a better fit follows
FIRST_DAMPING, LEAST_RAISED_DAMPING, HOPELESS_DAMPING = 1e-6, 1e-3, 1e6


@dataclass(frozen=True)
class Refined:
    """Estimates of the parameters with their covariance, in their units and order, and those of the other unknowns.

    The covariance is the inverse of the Fisher information of the data with the noise as estimated: the Cramer-Rao
    bound. `cost` is half the sum of squared residuals in units of their noise.
    """

    estimates: dict[str, Estimate]
    covariance: Floats
    nuisance: dict[str, Estimate]
    cost: float


@dataclass(frozen=True)
class _Point:
    """The current point of the fit: shared unknowns (m,), and those of each segment (segments, len(OWN))."""

    shared: Floats
    own: Floats


@dataclass
class Refinement:
    """Least squares fit of the parameters `names` to all segments.

    `values` holds all four parameters: a first guess of those in `names`, and the fixed value of the others.
    `pose_clock_std` [s] is the prior uncertainty of the offset between the clocks of wheels and poses,
    `command_clock_std` [s] that of the time at which a command takes effect, `guess_std` that of the initial guess, in
    logarithms.
    """

    segments: list[Segment]
    names: tuple[str, ...]
    values: Mapping[str, float]
    pose_clock_std: float = 0.1
    command_clock_std: float = 0.1
    guess_std: float = np.inf
    # The newest linearisation; noise and normal equations are often requested at the same point.
    _last: tuple[_Point, list[tuple[int, str, Series]]] | None = field(default=None, init=False, repr=False)

    def solve(self, *, far: bool = False, rounds: int = ROUNDS) -> Refined:
        """Return the estimates of `names`; a standard deviation is infinite if the data do not determine it.

        `far` says that the initial guess may be off by a factor of two. With fewer `rounds` the result is approximate.
        """
        point = self._first_point()
        for seconds in PREFIXES if far else ():
            beginnings = self._coarse(seconds)
            point = replace(point, shared=beginnings._fit(point, beginnings._noise(point, 0), NEAR).shared)
        # Far from the optimum, residuals show the error of the initial guess; only near it do they show the noise.
        coarse = self._coarse()
        point = coarse._fit(point, coarse._noise(point, 0), NEAR)
        for _round in range(rounds):
            noise, before = self._noise(point, ORDER), point
            point = self._fit(point, noise)
            equations = self._equations(point, noise)
            moved = np.abs(point.shared - before.shared) / np.sqrt(np.diag(equations.covariance()))
            if np.max(moved[: len(self.names)]) < SETTLED:
                break
        return self._refined(point, equations)

    def _coarse(self, seconds: float = np.inf) -> "Refinement":
        """Return a fit of the segments' beginnings to some of their measurements, near the initial guess."""
        coarse = [segment.beginning(seconds).thinned(COARSE) for segment in self.segments]
        return replace(self, segments=coarse, guess_std=GUESS_STD if np.isfinite(seconds) else np.inf)

    @property
    def unknowns(self) -> Unknowns:
        """The other unknowns depend on what was recorded."""
        if self._has_wheels:
            return Unknowns((*self.names, COMMAND_TIME, POSE_TIME, WHEEL_FACTOR), len(self.names))
        return Unknowns((*self.names, COMMAND_TIME), len(self.names))

    @property
    def _has_wheels(self) -> bool:
        return any(len(segment.left_at) + len(segment.right_at) > 2 for segment in self.segments)

    @property
    def _logarithms(self) -> list[int]:
        return [column for column, name in enumerate(self.unknowns.shared) if name not in TIMES]

    def _first_point(self) -> _Point:
        shared = np.zeros(len(self.unknowns.shared))
        shared[: len(self.names)] = [np.log(self.values[name]) for name in self.names]
        return _Point(shared, np.zeros((len(self.segments), len(OWN))))

    def _refined(self, point: _Point, equations: NormalEquations) -> Refined:
        covariance = equations.covariance()
        # Convert logarithms to values; times stay times.
        shared = self.unknowns.shared
        scale = np.array([1.0 if name in TIMES else np.exp(x) for name, x in zip(shared, point.shared, strict=True)])
        values = np.where([name in TIMES for name in shared], point.shared, scale)
        spread = scale * np.sqrt(np.diag(covariance))
        found = {n: Estimate(float(v), float(s)) for n, v, s in zip(shared, values, spread, strict=True)}
        count = len(self.names)
        return Refined(
            {name: found.pop(name) for name in self.names},
            np.outer(scale, scale)[:count, :count] * covariance[:count, :count],
            found,
            equations.cost,
        )

    def _noise(self, point: _Point, order: int) -> dict[str, Noise]:
        series: dict[str, list[Series]] = {}
        for _segment, signal, one in self._linearised(point):
            series.setdefault(signal, []).append(one)
        starts = 3 * sum(segment.fits_start for segment in self.segments)
        return {signal: noise_of(ones, order, len(point.shared) + starts) for signal, ones in series.items()}

    def _fit(self, point: _Point, noise: Mapping[str, Noise], enough: float = 0.0) -> _Point:
        """Return the least-squares solution for this noise (Levenberg-Marquardt).

        It ends when a step gains next to nothing, or less than the share `enough` of the cost.
        """
        equations, damping = self._equations(point, noise), FIRST_DAMPING
        for _iteration in range(ITERATIONS):
            shared, own = equations.step(damping)
            if np.max(np.abs(shared[self._logarithms]), initial=0.0) > LONGEST_STEP:
                damping = max(damping * 10.0, LEAST_RAISED_DAMPING)
                if damping > HOPELESS_DAMPING:
                    break
                continue
            trial = _Point(point.shared + shared, point.own + own)
            attempt = self._equations(trial, noise)
            gained = equations.cost - attempt.cost
            if gained > 0.0:
                point, equations, damping = trial, attempt, damping / 10.0
            else:
                damping = max(damping * 10.0, LEAST_RAISED_DAMPING)
            if 0.0 <= gained < max(NEGLIGIBLE, enough * equations.cost) or damping > HOPELESS_DAMPING:
                break
        return point

    def _equations(self, point: _Point, noise: Mapping[str, Noise]) -> NormalEquations:
        """Return the normal equations at a point; prior knowledge of times counts as one more sample."""
        unknowns = self.unknowns
        equations = NormalEquations.empty(len(self.segments), len(unknowns.shared), len(OWN))
        for segment, signal, series in self._linearised(point):
            equations.add(segment, noise[signal].products(series), series.columns)
        known = [(COMMAND_TIME, 0.0, self.command_clock_std), (POSE_TIME, 0.0, self.pose_clock_std)]
        known += [(name, float(np.log(self.values[name])), self.guess_std) for name in self.names]
        for name, value, std in known:
            column = unknowns.column(name)
            if column is not None and np.isfinite(std):
                row = np.array([point.shared[column] - value, 1.0]) / std
                equations.add(0, np.outer(row, row), [column])
        self._know_start_speeds(equations, point)
        return equations

    def _know_start_speeds(self, equations: NormalEquations, point: _Point) -> None:
        """Add the encoders' wheel speeds at the start of each segment as measurements."""
        for index, segment in enumerate(self.segments):
            for name, std in zip(("psi left", "psi right"), segment.start_psi_std, strict=True):
                if segment.fits_start_psi:
                    own = OWN.index(name)
                    row = np.array([point.own[index, own], 1.0]) / max(std, SMALLEST_PSI_STD)
                    equations.add(index, np.outer(row, row), [len(self.unknowns.shared) + own])

    def _linearised(self, point: _Point) -> list[tuple[int, str, Series]]:
        """Return the residuals and derivatives of every signal: (segment, name of the signal, series)."""
        if self._last is None or self._last[0] is not point:
            self._last = point, list(self._series(point))
        return self._last[1]

    def _series(self, point: _Point) -> Iterator[tuple[int, str, Series]]:
        for index, segment in enumerate(self.segments):
            path = self._path(segment, point.shared[: len(self.names)], point.own[index])
            linear = Linear(self.unknowns, segment, path, point.shared, point.own[index])
            yield from ((index, signal, one) for signal, one in linear.series())

    def _path(self, segment: Segment, logarithms: Floats, own: Floats) -> Trajectory:
        """Return the path of the point itself and of its neighbours, from which derivatives are taken."""
        around = Candidates.around(len(self.names), segment.fits_start_psi)
        values = np.exp(logarithms) * around.factors
        parameters = RobotParameters.of({**self.values, **dict(zip(self.names, values.T, strict=True))})
        left, right = (around.psi + own[OWN.index("psi left") :]).T
        return segment.simulate(parameters, (segment.start.psi_left + left, segment.start.psi_right + right))
