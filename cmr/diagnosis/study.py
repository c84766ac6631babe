"""Fit models with effects to recordings by their prediction errors."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cmr.diagnosis.candidates import Scene, effects_of_rolling, lanes_of, step_of
from cmr.diagnosis.noise import Noise
from cmr.diagnosis.prediction import WHEELS, Errors, Predictor
from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.compiled import compiled
from cmr.model.effect import Effect
from cmr.model.observer import MOTION, Gains, Observer
from cmr.recordings.signal import Floats, Mask

BLOCK = 1.5  # s; neighbouring blocks belong to different folds
FOLDS = 5
MOST_STEPS = 7
SETTLED = 0.1  # of the sum of squares: a step that promises less is not taken
KEPT = 0.5  # of what a step promises must come
DAMPINGS, SHARES = (1e-9, 1e-3, 3e-2, 0.5), (1.0, 0.6, 0.25, 0.06)  # of the steps tried at once
LONG_STRIDE = 6.0
LARGE = 4.0  # standard deviations from which an error counts less than its square
X, Y = MOTION.index("x"), MOTION.index("y")
EDGE = 0.06  # of the way: a change that is to be named happens between this and the rest
QUICK_STEPS = 5  # of models fitted side by side,
PROMISED_BESIDE = 1.0  # each as long as its next step promises as much
FAIR_ROUNDS, FAR_BEHIND = 2, 0.3  # steps that each may do; share of the best one's drop below which it may do no more


@dataclass(frozen=True)
class Fit:
    """A model fitted: values of all parameters by name, of which `names` (p) are free.

    `rest` (n,) are the white prediction errors, `slopes` (n, p) their derivatives.
    """

    values: Mapping[str, float]
    names: tuple[str, ...]
    rest: Floats
    slopes: Floats
    noise: Noise

    @property
    def squares(self) -> float:
        """Sum of the squared white errors."""
        return float(self.rest @ self.rest)

    @property
    def covariance(self) -> Floats:
        """Covariance (p, p) of the free parameters."""
        return np.asarray(np.linalg.pinv(self.slopes.T @ self.slopes, hermitian=True))

    def std(self, name: str) -> float:
        """Return the standard deviation of a free parameter, in its unit."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))


class Study:
    """Recordings to be explained, and what is known of their noise.

    `by_moments` tells that errors are those of each moment, made white by their past.
    """

    by_moments = True

    def __init__(self, predictors: Sequence[Predictor], gains: Gains, scene: Scene) -> None:
        self.predictors = tuple(predictors)
        self.gains = gains
        self.scene = scene
        self.folds = _folds(self.predictors)
        self._counted: Mask | None = None

    def part(self, rows: Mask) -> "Study":
        """Return the study in which only the errors count at which `rows` (n,), over all errors, is true."""
        result = copy(self)
        result._counted = rows
        return result

    def errors(self, values: Mapping[str, object]) -> list[Errors]:
        """Return the prediction errors in each piece; `values` are numbers or arrays (C,)."""
        observer = Observer(values, self.gains)
        return [predictor.errors_of(observer) for predictor in self.predictors]

    def white(self, values: Mapping[str, object], noise: Noise) -> Floats:
        """Return all prediction errors made white and tempered, shape (n, C)."""
        white = self.made_white(self.errors(values), noise)
        temper(white.reshape(-1), LARGE)
        return white

    def squares(self, sets: Sequence[Mapping[str, float]], noise: Noise) -> Floats:
        """Return the sum of squared white errors with each of several sets of values; infinite where nothing holds."""
        white = self.white(lanes_of(sets), noise)
        return np.asarray(np.nan_to_num(np.einsum("nc,nc->c", white, white), nan=np.inf))

    def made_white(self, errors: Sequence[Errors], noise: Noise) -> Floats:
        """Return prediction errors made white, shape (n, C), piece by piece and signal by signal."""
        parts = [
            noise.all_white(number, predictor, error)
            for number, (predictor, error) in enumerate(zip(self.predictors, errors, strict=True))
        ]
        white = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if self._counted is not None:
            white[~self._counted] = 0.0
        return white

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """The effects of the catalogue that may show: without commands, not those of the motors."""
        rolls = all(len(predictor.piece.heard.given) for predictor in self.predictors)
        return effects_of_rolling() if rolls else tuple(CATALOGUE.values())

    @cached_property
    def several(self) -> bool:
        """Whether there are several recordings."""
        return len({predictor.piece.recording for predictor in self.predictors}) > 1

    @cached_property
    def moving(self) -> tuple[float, float]:
        """When the robot has turned its wheels by EDGE, and by all but EDGE, of all that it turns them [s]."""
        spans = []
        for predictor in self.predictors:
            heard = predictor.piece.heard
            turned = np.cumsum(np.abs(np.diff(heard.wheel, axis=0, prepend=heard.wheel[:1])).sum(axis=1))
            inside = (turned > EDGE * turned[-1:]) & (turned < (1.0 - EDGE) * turned[-1:])
            spans.append(heard.time + heard.wheel_time[inside])
        times = np.concatenate(spans)
        return (float(times.min()), float(times.max())) if len(times) else (0.0, 0.0)

    @cached_property
    def of_wheels(self) -> Mask:
        """Which white errors are those of wheels, shape (n,)."""
        times = [(name, len(of)) for predictor in self.predictors for name, of in predictor.times.items()]
        return np.concatenate([np.full(count, name in WHEELS) for name, count in times])

    def rows(self, errors: Sequence[Errors]) -> Floats:
        """Return when [s] and where [m] each white error arises, shape (n, 3): time, x, y."""
        parts = []
        for predictor, error in zip(self.predictors, errors, strict=True):
            for name, times in predictor.times.items():
                motion = predictor.motion_at(error.motion, name)
                parts.append(np.stack([times + predictor.piece.heard.time, motion[:, X], motion[:, Y]], axis=1))
        return np.concatenate(parts)

    def masked(self, changes: Sequence[Errors], masks: Mapping[int, Mask]) -> list[Errors]:
        """Let some candidates, by column, change errors only where a mask (n,) over all errors is true.

        The changes are large, and so are written over.
        """
        begin = 0
        for predictor, one in zip(self.predictors, changes, strict=True):
            for name, times in predictor.times.items():
                inside = slice(begin, begin + len(times))
                begin += len(times)
                for column, mask in masks.items():
                    one.of[name][~mask[inside], column] = 0.0
        return list(changes)

    def found(self, errors: Sequence[Errors]) -> Noise:
        """Return the noise that the errors of the first candidate in each piece show."""
        return Noise.found(self.predictors, errors)

    def fit(self, values: Mapping[str, float], names: Sequence[str], noise: Noise, renew: int = 1) -> Fit:
        """Fit the free parameters `names` from `values` on (Levenberg-Marquardt).

        The noise is found anew `renew` times, and the fit repeated with it.
        """
        fit = self._fitted(dict(values), tuple(names), noise)
        for _ in range(renew):
            fit = self._fitted(fit.values, tuple(names), self.found(self.errors(fit.values)))
        return fit

    def doubts(self, fit: Fit) -> dict[str, float]:
        """Return what is to be added to standard deviations of a fit, by name: nothing where errors are white."""
        return dict.fromkeys(fit.names, 0.0)

    def renewed(self, fit: Fit, noise: Noise) -> Fit:
        """Return the fit with another noise."""
        return self.fit(fit.values, fit.names, noise, renew=0)

    def refitted(self, fit: Fit, values: Mapping[str, float]) -> Fit:
        """Return a fit of the same parameters with the same noise from other values on."""
        return self._fitted(values, fit.names, fit.noise)

    def _fitted(self, values: Mapping[str, float], names: tuple[str, ...], noise: Noise) -> Fit:
        """Fit by Gauss and Newton; where a step does not keep its promise, the best of many shorter ones is taken.

        Dry friction makes the sum of squares rough. Where all steps fail, slopes over a longer distance may still do.
        """
        values, stride = dict(values), 1.0
        rest, slopes = self.linear(values, names, noise)
        for _ in range(MOST_STEPS):
            step = _newton_steps(slopes, rest, DAMPINGS[:1])[0]
            promised = float(rest @ rest) - float(np.sum((rest + slopes @ step) ** 2))
            if promised < SETTLED:
                break
            whole = moved(values, names, step)
            there = self.linear(whole, names, noise, stride)
            if float(rest @ rest) - float(there[0] @ there[0]) > KEPT * promised:
                values, (rest, slopes) = whole, there
                continue
            shorter, drop = self._best_step(values, names, noise, rest, slopes)
            values = shorter if drop > 0.0 else values
            if drop < SETTLED:
                if stride > 1.0:
                    break
                stride = LONG_STRIDE
            rest, slopes = self.linear(values, names, noise, stride)
        if stride > 1.0:
            rest, slopes = self.linear(values, names, noise)
        return Fit(values, names, rest, slopes, noise)

    def _best_step(
        self, values: Mapping[str, float], names: Sequence[str], noise: Noise, rest: Floats, slopes: Floats
    ) -> tuple[dict[str, float], float]:
        """Return the best values of many shortened and damped steps, and by how much they drop the sum of squares."""
        steps = [share * step for step in _newton_steps(slopes, rest, DAMPINGS) for share in SHARES]
        tried = [moved(values, names, step) for step in steps]
        squares = self.squares(tried, noise)
        best = int(np.argmin(squares))
        return tried[best], float(rest @ rest) - float(squares[best])

    def fit_beside(
        self, base: Fit, starts: Sequence[Mapping[str, float]], names: Sequence[Sequence[str]]
    ) -> list[tuple[dict[str, float], float]]:
        """Fit several models at once: the free parameters of `base` and, in each, some `names` of its own.

        `starts` are the values that each model's own parameters begin with. What the base's parameters do is taken
        from its fit. Returns each model's values and its sum of squared white errors.
        """
        courses = [
            _Course({**base.values, **start}, (*base.names, *own), tuple(own))
            for start, own in zip(starts, names, strict=True)
        ]
        for _ in range(QUICK_STEPS):
            leader = min(course.squares for course in courses)
            open_ones = [course for course in courses if course.open(base.squares, leader)]
            if not open_ones:
                break
            moves = [self._moves(course.tried, course.own) for course in open_ones]
            sets = [one for course, of in zip(open_ones, moves, strict=True) for one in course.lanes(of)]
            white = self.white(lanes_of(sets), base.noise)
            parts = np.split(white, np.cumsum([1 + len(course.own) for course in open_ones])[:-1], axis=1)
            for course, of, part in zip(open_ones, moves, parts, strict=True):
                course.go_on(part[:, 0], (part[:, 1:] - part[:, :1]) / of, base.slopes)
        return [(course.best, course.squares) for course in courses]

    def _moves(self, values: Mapping[str, float], names: Sequence[str], stride: float = 1.0) -> Floats:
        """Return by how much each parameter (p,) is moved to see what it does, times `stride`."""
        usual = [(name, values[name], step_of(name, values[name], self.scene)) for name in names]
        return np.array([inward(name, value, stride * step) for name, value, step in usual])

    def linear(
        self, values: Mapping[str, float], names: Sequence[str], noise: Noise, stride: float = 1.0
    ) -> tuple[Floats, Floats]:
        """Return white errors (n,) at some values, and their slopes (n, p) by the parameters `names`.

        Slopes are taken over `stride` times the usual distance.
        """
        moves = self._moves(values, names, stride)
        white = self.white(lanes_of([values, *one_by_one(values, names, moves)]), noise)
        lost = ~np.isfinite(white[:, 1:]).all(axis=0)
        if lost.any():  # so far the model no longer holds; it may on the other side
            moves = np.where(lost, -moves, moves)
            white = self.white(lanes_of([values, *one_by_one(values, names, moves)]), noise)
            white[:, 1:] = np.where(np.isfinite(white[:, 1:]), white[:, 1:], white[:, :1])
        with np.errstate(invalid="ignore"):  # where the model does not hold at all the step that led here is not taken
            return white[:, 0], (white[:, 1:] - white[:, :1]) / moves


def one_by_one(values: Mapping[str, float], names: Sequence[str], moves: Floats) -> list[dict[str, float]]:
    """Return the values with one parameter moved in each."""
    return [{**values, name: values[name] + move} for name, move in zip(names, moves, strict=True)]


class _Course:
    """How one of several models, fitted side by side, comes on; `own` are its parameters beside those of the base."""

    def __init__(self, start: dict[str, float], free: Sequence[str], own: Sequence[str]) -> None:
        self.free, self.own = free, own
        self.tried = self.best = start
        self.squares = self.promised = np.inf
        self._step, self._pace, self._rounds = np.zeros(len(free)), 1.0, 0

    def open(self, base: float, leader: float) -> bool:
        """Tell whether more steps may matter; `base` and `leader` are the sums of squares without it and at best."""
        late = self._rounds >= FAIR_ROUNDS and base - self.squares + self.promised < FAR_BEHIND * (base - leader)
        return self.promised > PROMISED_BESIDE and not late

    def lanes(self, moves: Floats) -> list[dict[str, float]]:
        """Return the values to be tried next, and those with each own parameter moved."""
        return [self.tried, *one_by_one(self.tried, self.own, moves)]

    def go_on(self, rest: Floats, slopes: Floats, base: Floats) -> None:
        """Go a step on from white errors (n,), slopes (n, p) of the own parameters, and those of the base."""
        self._rounds += 1
        squares = float(rest @ rest)
        if squares < self.squares:
            self.best, self.squares, self._pace = self.tried, squares, 1.0
            every = np.concatenate([base, slopes], axis=1)
            self._step = _newton_steps(every, rest, DAMPINGS[:1])[0]
            self.promised = squares - float(np.sum((rest + every @ self._step) ** 2))
        else:
            self._pace *= 0.3
        if np.isfinite(self.squares):
            self.tried = moved(self.best, self.free, self._pace * self._step)
        else:
            self.tried = nearer_to_neutral(self.tried, self.own)


def nearer_to_neutral(values: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """Return the values with the effect of parameters `names` made smaller: what it began with made no sense."""
    result = dict(values)
    for known in (definition(name) for name in names):
        if known.switches and known.neutral is not None and np.isfinite(known.neutral):
            result[known.name] = known.neutral + 0.3 * (values[known.name] - known.neutral)
    return result


def tempered(white: Floats) -> Floats:
    """Return white errors (n, C) whose squares grow like Huber's loss: no single moment decides.

    A wheel that sets off half a step earlier than foretold makes errors of a hundred standard deviations for a moment.
    """
    result = np.array(white)
    temper(result.reshape(-1), LARGE)
    return result


@compiled("void(f8[::1], f8)")
def temper(white, largest):  # type: ignore[no-untyped-def]
    """Let what is larger than `largest` grow with its root only."""
    for index in range(len(white)):
        size = abs(white[index])
        if size > largest:
            white[index] = np.copysign(np.sqrt(2.0 * largest * size - largest**2), white[index])


def _newton_steps(slopes: Floats, rest: Floats, dampings: Sequence[float]) -> list[Floats]:
    """Return Gauss-Newton steps with these dampings (Levenberg and Marquardt)."""
    normal, right = slopes.T @ slopes, slopes.T @ rest
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale)
    return [-np.linalg.solve(scaled + damping * np.eye(len(scale)), right / scale) / scale for damping in dampings]


def inward(name: str, value: float, step: float) -> float:
    """Return the step, turned round where it would leave the parameter's bounds."""
    return -step if value + step > definition(name).upper else step


def moved(values: Mapping[str, float], names: Sequence[str], step: Floats) -> dict[str, float]:
    """Return the values with a step added to those named, kept within their bounds."""
    result = dict(values)
    for name, change in zip(names, step, strict=True):
        known = definition(name)
        result[name] = float(np.clip(values[name] + change, known.lower, known.upper))
    return result


def _folds(predictors: Sequence[Predictor]) -> np.typing.NDArray[np.int64]:
    """Return the fold of each white error, (n,): another recording, or with one recording alternating blocks."""
    several = len({predictor.piece.recording for predictor in predictors}) > 1
    return np.concatenate(
        [
            np.full(len(times), predictor.piece.recording)
            if several
            else np.floor((times + predictor.piece.heard.time) / BLOCK).astype(np.int64) % FOLDS
            for predictor in predictors
            for times in predictor.times.values()
        ]
    )
