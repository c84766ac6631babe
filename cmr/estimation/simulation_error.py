"""Fit models by simulation error (free runs), for robots whose one-step errors are not informative.

Wheels that are driven by their own controller, stick, or rattle have one-step errors that are hardly related to errors
of the model. A model that never moves predicts the next reading best, and the robot worst. Here the wheel speeds are
simulated freely from the commands; gyro and pose follow the measured wheels. Errors are not whitened by their past;
instead their weights are reduced for autocorrelation (effective sample size; Bayley and Hammersley, J. R. Stat. Soc.
Suppl. 8, 1946). They also come in bursts, after commands; standard deviations allow for that by blocks of time (Liang
and Zeger, Biometrika 73, 1986), and for undetected effects (averaging.py).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cmr.estimation.averaging import averaged
from cmr.estimation.candidates import AS_THE_RADIUS, Excitation, driving_parameters, lanes_of, wheel_parameters
from cmr.estimation.gains import interval_of
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import FOREIGN, SPANS, Noise, SignalNoise, size_found
from cmr.estimation.prediction import SIGNALS, WHEELS, Batch, Errors, Predictor
from cmr.estimation.problem import Problem, nearer_to_neutral
from cmr.model.observer.observer import MOTION, Gains, Observer
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import Quantity
from cmr.parameters.file import MOTOR
from cmr.recordings.signal import Floats, Mask

MEMORY = 0.1  # s; time constant with which a free-running wheel angle follows its encoder, so that only speed matters
STILL, TICKS = 0.5, 3.0  # s to either side in which a standing wheel turns by no more than so many ticks
SMALLER = 2  # number of smaller start sizes tested per fit
MOVING = 1e-3  # rad/s; a slower wheel stands still
QUIET = 0.25  # s before and after a motion in which a gyro is not quiet
PSI = [MOTION.index("psi_left"), MOTION.index("psi_right")]
BURST = 3.0  # s; errors of one burst lie within a block, or two
UNCORRELATED = 0.05  # correlation below which errors are independent
FREE_RUN_INFLATION = 1.5  # because the effective sample size is only approximate
FINEST = 1e-6  # rad, m, rad/s: floor of the noise: no sensor is more accurate, and without noise no fit would converge


class SimulationErrorProblem(Problem):
    """Recordings to be explained by free runs."""

    one_step = False

    def __init__(self, predictors: Sequence[Predictor], gains: Gains, excitation: Excitation) -> None:
        super().__init__(predictors, gains, excitation)
        self._rolling = Batch([Predictor(predictor.segment.rolling) for predictor in predictors])
        self._free = Gains(min(1.0, interval_of(predictors) / MEMORY), 0.0, gains.position, gains.theta)

    def _observed(self, values: Mapping[str, Quantity]) -> Errors:
        """Return the errors of free-running wheels, and of gyro and pose given the measured wheels."""
        sets = _sets(values)
        of_motors = driving_parameters()
        without_motors = [{name: one for name, one in of.items() if name not in of_motors} for of in sets]
        rolled = _observed_once(self._rolling, without_motors, without_motors, self.gains)
        if not any(name in self.batch.signals for name in WHEELS):
            return rolled
        of_wheels = [{name: of[name] for name in wheel_parameters(of)} for of in sets]
        driven = _observed_once(self.batch, sets, of_wheels, self._free, WHEELS)
        both = {**driven.of, **rolled.of}
        return Errors({name: both[name] for name in self.batch.signals}, rolled.motion)

    def one_step_of(self, fit: Fit) -> tuple[Problem, Fit]:
        """Return the problem of the body's motion given the measured wheels, with the same model fitted to it.

        It does not judge the motors.
        """
        body = Problem(self._rolling.predictors, self.gains, self.excitation)
        values = {name: value for name, value in fit.values.items() if name not in driving_parameters()}
        names = [name for name in fit.names if name in values]
        return body, body.fit(values, names, body.found(body.errors(values)))

    def found(self, errors: Sequence[Errors]) -> Noise:
        """Return the noise of the errors of the first candidate in each segment: its size and correlation length.

        Both wheels get equal weight; otherwise the one with the worse fit would soon be ignored.
        """
        result: dict[str, SignalNoise] = {}
        for group in (WHEELS, *((name,) for name in SPANS if name not in WHEELS)):
            result |= self._group([name for name in group if any(name in p.times for p in self.predictors)], errors)
        return Noise(result)

    def _group(self, names: Sequence[str], errors: Sequence[Errors]) -> dict[str, SignalNoise]:
        """Return the noise of signals that share size and correlation length."""
        pairs = [(n, p, e) for n in names for p, e in zip(self.predictors, errors, strict=True) if n in p.times]
        if not pairs:
            return {}
        own = [error.of[name][:, 0] for name, _, error in pairs]
        bases = [_sizes(name, predictor, error) for name, predictor, error in pairs]
        shares = size_found(np.concatenate(own), np.concatenate(bases))
        sizes = [np.sqrt(np.maximum(base @ shares, FINEST**2)) for base in bases]
        count = lasting([error / size for error, size in zip(own, sizes, strict=True)])
        found = iter(np.sqrt(count) * size for size in sizes)
        return {
            name: SignalNoise(
                np.zeros(0),
                np.zeros(len(FOREIGN)),
                tuple(next(found) if name in predictor.times else np.empty(0) for predictor in self.predictors),
            )
            for name in names
        }

    def extra_stds(self, fit: Fit) -> dict[str, float]:
        """Return additional standard deviations, by name, due to bursts of errors and undetected effects."""
        bursts, hidden = self._bursts(fit), self._hidden(fit)
        return {name: float(np.hypot(bursts[name], hidden[name])) for name in fit.names}

    def _hidden(self, fit: Fit) -> dict[str, float]:
        """Return the uncertainty of a fit's parameters due to undetected effects, by name.

        Stepwise selection misses effects that are visible only together, such as those of sticking wheels; an average
        over all effects includes them. For the body, free runs are less informative than one-step errors given the
        measured wheels; the larger uncertainty is used.
        """
        extra_stds = _left_in_doubt(self, fit, fit, FREE_RUN_INFLATION)
        body, beside = self.one_step_of(fit)
        names = [name for name in beside.names if name not in MOTOR]
        if names and "forward" in body.batch.signals and not set(names) & {"wheel_radius", *AS_THE_RADIUS}:
            names = ["wheel_radius", *names]  # no effect represents it beside measured wheels
        if names:
            of_body = _left_in_doubt(body, body.fit(beside.values, names, beside.noise), fit, 1.0)
            extra_stds |= {name: max(doubt, extra_stds[name]) for name, doubt in of_body.items()}
        return extra_stds

    def _bursts(self, fit: Fit) -> dict[str, float]:
        """Return additional standard deviations due to bursts of errors, by name."""
        blocks = [
            np.stack(
                [np.full(len(times), p.segment.recording), np.floor((times + p.segment.observations.time) / BURST)],
                axis=1,
            )
            for p in self.predictors
            for times in p.times.values()
        ]
        lacking = np.diag(covariance_by_blocks(fit, np.concatenate(blocks)) - fit.covariance)
        return dict(zip(fit.names, np.sqrt(np.maximum(lacking, 0.0)).tolist(), strict=True))

    def renewed(self, fit: Fit, noise: Noise) -> Fit:
        """Return the fit with another noise; the paper's model stays as fitted where the wheels turn."""
        if set(fit.names) <= set(PAPER):
            return Fit(fit.values, fit.names, *self.linear(fit.values, fit.names, noise), noise)
        return super().renewed(fit, noise)

    def fit_beside(
        self, base: Fit, starts: Sequence[Mapping[str, float]], names: Sequence[Sequence[str]]
    ) -> list[tuple[dict[str, float], float]]:
        """Fit several models at once; see `Problem`. Each starts with the best of several sizes of its effect."""
        nearer = [[{**base.values, **start} for start in starts]]
        for _ in range(SMALLER):
            pairs = zip(nearer[-1], names, strict=True)
            nearer.append([nearer_to_neutral(values, own, self.excitation) for values, own in pairs])
        white = self.white(lanes_of([values for step in nearer for values in step]), base.noise)
        best = np.argmin(np.sum(white**2, axis=0).reshape(len(nearer), len(starts)), axis=0)
        return super().fit_beside(base, [nearer[step][model] for model, step in enumerate(best)], names)

    def base(self, values: Mapping[str, float], names: Sequence[str]) -> Fit:
        """Fit the paper's model where the wheels turn, since it has no friction that holds a driven wheel."""
        turning = self.part(np.concatenate([_turning(p, name) for p in self.predictors for name in p.times]))
        fit = turning.fit(values, names, self.found(self.errors(values)))
        return self.renewed(fit, self.found(self.errors(fit.values)))


def _left_in_doubt(problem: Problem, about: Fit, fit: Fit, inflation: float) -> dict[str, float]:
    """Return the uncertainty of one fit's parameters from an average about another, including their difference."""
    named = [effect.name for effect in problem.effects if problem.excitation.departs(effect, about.values)]
    average = averaged(problem, about, inflation, named)
    known = [name for name in fit.names if name in average.names]
    return {name: float(np.hypot(average.std(name), average.values[name] - fit.values[name])) for name in known}


def covariance_by_blocks(fit: Fit, blocks: Floats) -> Floats:
    """Return the covariance (p, p) of the free parameters if errors of one block may have one cause.

    Rows of `blocks`, shape (n, k), say which block each error belongs to.
    """
    _, number = np.unique(blocks, axis=0, return_inverse=True)
    scores = np.zeros((int(number.max()) + 1, len(fit.names)))
    np.add.at(scores, number.ravel(), fit.slopes * fit.rest[:, None])
    return np.asarray(fit.covariance @ (scores.T @ scores) @ fit.covariance, np.float64)


def _sets(values: Mapping[str, Quantity]) -> list[dict[str, float]]:
    """Return the values of each candidate, by name."""
    columns = np.broadcast_arrays(*(np.atleast_1d(value) for value in values.values()))
    return [dict(zip(values, one, strict=True)) for one in np.stack(columns, axis=1).tolist()]


def _observed_once(
    batch: Batch,
    sets: Sequence[Mapping[str, float]],
    matters: Sequence[Mapping[str, float]],
    gains: Gains,
    signals: Sequence[str] = SIGNALS,
) -> Errors:
    """Return the errors of these signals; candidates with equal `matters` are observed once."""
    keys = [tuple(sorted(of.items())) for of in matters]
    number = {key: index for index, key in enumerate(dict.fromkeys(keys))}
    different = [sets[keys.index(key)] for key in number]
    errors = batch.errors(Observer(lanes_of(different), gains))
    columns = [number[key] for key in keys]
    of = {name: np.take(of, columns, axis=1) for name, of in errors.of.items() if name in signals}
    return replace(errors, of=of)


def _sizes(name: str, predictor: Predictor, errors: Errors) -> Floats:
    """Return the regressors of a signal's error variance, shape (n, 3); a gyro is quiet while nothing moves."""
    columns = np.zeros((len(predictor.times[name]), 3))
    columns[:, 0] = 1.0
    if name == "yaw_rate":
        dt = predictor.segment.observations.dt
        moves = np.any(np.abs(errors.motion[:, PSI]) > MOVING, axis=1)
        near = np.convolve(moves, np.ones(2 * round(QUIET / dt) + 1), "same") > 0.0
        index = np.minimum(np.round(predictor.times[name] / dt).astype(np.int64), len(near) - 1)
        columns[near[index], :2] = [0.0, 1.0]
        columns[:, 2] = np.sum(predictor.motion_at(errors.motion, name)[:, PSI] ** 2, axis=1)
    return columns


def _turning(predictor: Predictor, name: str) -> Mask:
    """Return a mask, (n,), that is false while the signal's wheel stands still."""
    observations, times = predictor.segment.observations, predictor.times[name]
    if name not in WHEELS:
        return np.ones(len(times), np.bool_)
    angle = observations.wheel[:, WHEELS.index(name)]
    turned = np.interp(times + STILL, observations.wheel_time, angle) - np.interp(
        times - STILL, observations.wheel_time, angle
    )
    return np.asarray(np.abs(turned) > TICKS * predictor.segment.tick)


def lasting(errors: Sequence[Floats]) -> float:
    """Return how many samples of errors, one array (n,) per segment, count as one: at least 1."""
    longest = max(len(one) for one in errors)
    length = 1 << int(np.ceil(np.log2(2 * longest)))
    spectrum = sum(np.abs(np.fft.rfft(one, length)) ** 2 for one in errors)
    covariance = np.fft.irfft(spectrum, length)[:longest]
    if covariance[0] <= 0.0:
        return 1.0
    correlation = covariance[1:] / covariance[0]
    ends = np.flatnonzero(correlation < UNCORRELATED)
    together = correlation[: ends[0]] if len(ends) else correlation
    return float(1.0 + 2.0 * np.sum(together))
