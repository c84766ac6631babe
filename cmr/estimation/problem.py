"""Fit models with effects to recordings by their prediction errors."""

import zlib
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from functools import cached_property

import numpy as np

from cmr.estimation.candidates import Excitation, effects_of_rolling, lanes_of
from cmr.estimation.gauss_newton import (
    DAMPINGS,
    Asking,
    Fit,
    T,
    fitted,
    linear,
    moved,
    moves_of,
    newton_steps,
    one_by_one,
    room,
    sums_of_squares,
)
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import WHEELS, Batch, Errors, Predictor, recorded
from cmr.model.catalogue import CATALOGUE, LAWS, definition
from cmr.model.compiled import compiled
from cmr.model.effect import Effect
from cmr.model.observer.observer import MOTION, Gains, Observer
from cmr.model.parameters import Quantity
from cmr.recordings.signal import Floats, Mask

BLOCK = 1.5  # s; neighbouring blocks belong to different folds
FOLDS = 5  # of the blocks, each left out of one fit
LARGE = 4.0  # standard deviations from which an error counts less than its square
X, Y = MOTION.index("x"), MOTION.index("y")
SAME_POSE, NEARLY_SAME_POSE, MOST_ALIKE = 1e-6, 0.05, 0.8  # m and rad; share of the pieces
SEVERAL, COMING = 3, 0.2  # pieces; rad/s of a wheel of a robot in motion
EDGE = 0.06  # of the wheels' rotation: a nameable change happens between this and the remainder
QUICK_STEPS = 5  # of models fitted side by side,
PROMISED_BESIDE = 1.0  # each as long as its next step promises as much
MORE_STEPS, MUCH_PROMISED = 6, 0.05  # further ones, if the next one promises this share of the best one's drop
FAIR_ROUNDS, FAR_BEHIND = 2, 0.3  # steps that each may take; share of the best one's drop below which it is stopped


class Problem:
    """An estimation problem: recordings, and their noise.

    `one_step`: errors are one-step prediction errors, whitened by their past, not those of free runs.
    """

    one_step = True

    def __init__(self, predictors: Sequence[Predictor], gains: Gains, excitation: Excitation) -> None:
        self.predictors = tuple(predictors)
        self.gains = gains
        self.excitation = excitation
        self.folds = _folds(self.predictors)
        self._counted: Mask | None = None
        self._latest: tuple[Mapping[str, float], Errors] | None = None  # single candidate observed, its errors

    def part(self, rows: Mask) -> "Problem":
        """Return the problem restricted to the errors where `rows` (n,), over all errors, is true."""
        result = copy(self)
        result._counted = rows
        return result

    def errors(self, values: Mapping[str, Quantity]) -> list[Errors]:
        """Return the prediction errors in each segment; `values` are numbers or arrays (C,)."""
        return self.batch.split(self.joint_errors(values))

    def joint_errors(self, values: Mapping[str, Quantity]) -> Errors:
        """Return the prediction errors in all segments of the batch; read-only for a single candidate.

        A single candidate is often evaluated again: first judged, then used as the next base.
        """
        if any(np.asarray(value).size > 1 for value in values.values()):
            return self._observed(values)
        asked = {name: np.asarray(value, np.float64).item() for name, value in values.items()}
        if self._latest is None or self._latest[0] != asked:
            self._latest = asked, self._observed(values)
        return self._latest[1]

    def _observed(self, values: Mapping[str, Quantity]) -> Errors:
        return self.batch.told_once(self.batch.errors(Observer(values, self.gains)), self.gains)

    def white(self, values: Mapping[str, Quantity], noise: Noise) -> Floats:
        """Return all prediction errors, whitened and tempered, shape (n, C)."""
        white = self._counted_white(self.joint_errors(values), noise)
        temper(white.reshape(-1), LARGE)
        return white

    def squares(self, sets: Sequence[Mapping[str, float]], noise: Noise) -> Floats:
        """Return the sum of squared white errors with each of several sets of values; infinite if the model is
        invalid.
        """
        return sums_of_squares(self.white(lanes_of(sets), noise))

    def made_white(self, errors: Sequence[Errors], noise: Noise) -> Floats:
        """Return prediction errors made white, shape (n, C), segment by segment and signal by signal."""
        return self._counted_white(self.batch.joined(errors), noise)

    def _counted_white(self, errors: Errors, noise: Noise) -> Floats:
        white = noise.all_white(self.batch, errors)
        if self._counted is not None:
            white[~self._counted] = 0.0
        return white

    @cached_property
    def batch(self) -> Batch:
        """All segments, to be predicted together."""
        return Batch(self.predictors)

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that can be detected: without commands, not those of the motors."""
        read, framed = recorded(self.predictors), self._set_to_one_pose
        effects = self.possible if "commands" in read else effects_of_rolling(self.excitation.laws)
        return tuple(one for one in effects if not one.same_with(read) and not (one.of_one_frame and framed))

    def same_as(self, name: str) -> tuple[str, ...]:
        """Return the effects that these recordings cannot distinguish from another one."""
        read = recorded(self.predictors)
        return tuple(effect.name for effect in CATALOGUE.values() if name in effect.same_with(read))

    @cached_property
    def _set_to_one_pose(self) -> bool:
        """Whether the poses are those of pieces that each begin at the same pose: in a frame of its own.

        Exactly equal poses must have been set; nearly equal ones count as set if the robot was moving.
        """
        observations = [predictor.segment.observations for predictor in self.predictors]
        segments = [predictor.segment for predictor in self.predictors if len(predictor.segment.observations.pose)]
        begins = np.array([*{(one.recording, one.piece): one.piece_pose for one in segments}.values()])
        if len(begins) < 2:
            return False
        apart = np.max(np.abs(begins - np.median(begins, axis=0)), axis=1)
        coming = sum(np.max(np.abs(one.start[3:])) > COMING for one in observations)
        alike = float(np.mean(apart < NEARLY_SAME_POSE)) > MOST_ALIKE
        return bool(np.all(apart < SAME_POSE) or (coming >= SEVERAL and alike))

    @cached_property
    def possible(self) -> tuple[Effect, ...]:
        """The effects of the catalogue that are possible with the robot's kind of commands.

        Only laws of the given robot are included: others belong to other robots.
        """
        kinds = {predictor.segment.observations.kind for predictor in self.predictors}
        known = (effect for name, effect in CATALOGUE.items() if name not in LAWS or name in self.excitation.laws)
        return tuple(effect for effect in known if kinds & {*effect.with_commands})

    @cached_property
    def seed(self) -> int:
        """A random seed derived from the recordings, the same on every computer."""
        angles = [np.ascontiguousarray(predictor.segment.observations.wheel) for predictor in self.predictors]
        return zlib.crc32(b"".join(angle.tobytes() for angle in angles))

    @cached_property
    def several(self) -> bool:
        """Whether there are several recordings."""
        return len({predictor.segment.recording for predictor in self.predictors}) > 1

    @cached_property
    def moving(self) -> tuple[float, float]:
        """The times [s] at which the wheels have made EDGE, and all but EDGE, of their total rotation."""
        spans = []
        for predictor in self.predictors:
            observations = predictor.segment.observations
            turned = np.cumsum(np.abs(np.diff(observations.wheel, axis=0, prepend=observations.wheel[:1])).sum(axis=1))
            inside = (turned > EDGE * turned[-1:]) & (turned < (1.0 - EDGE) * turned[-1:])
            spans.append(observations.time + observations.wheel_time[inside])
        times = np.concatenate(spans)
        return (float(times.min()), float(times.max())) if len(times) else (0.0, 0.0)

    @cached_property
    def of_wheels(self) -> Mask:
        """Which white errors are those of wheels, shape (n,)."""
        return self.rows_of(WHEELS)

    def rows_of(self, signals: Collection[str]) -> Mask:
        """Return which white errors are those of some signals, shape (n,)."""
        times = [(name, len(of)) for predictor in self.predictors for name, of in predictor.times.items()]
        return np.concatenate([np.full(count, name in signals) for name, count in times])

    def rows(self, errors: Sequence[Errors]) -> Floats:
        """Return time [s] and position [m] of each white error, shape (n, 3): time, x, y."""
        parts = []
        for predictor, error in zip(self.predictors, errors, strict=True):
            for name, times in predictor.times.items():
                motion = predictor.motion_at(error.motion, name)
                parts.append(
                    np.stack([times + predictor.segment.observations.time, motion[:, X], motion[:, Y]], axis=1)
                )
        return np.concatenate(parts)

    def masked(self, changes: Sequence[Errors], masks: Mapping[int, Mask]) -> list[Errors]:
        """Zero the changes of some candidates, by column, where a mask (n,) over all errors is false.

        The changes are large and modified in place.
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
        """Estimate the noise from the errors of the first candidate in each segment."""
        return Noise.found(self.batch, self.batch.joined(errors))

    def fit(self, values: Mapping[str, float], names: Sequence[str], noise: Noise, renew: int = 1) -> Fit:
        """Fit the free parameters `names` from `values` on (Levenberg-Marquardt).

        The noise is estimated again `renew` times from the fit's errors, and the fit repeated with it.
        """
        fit = self.fits([(values, names)], noise)[0]
        for _ in range(renew):
            fit = self.fits([(fit.values, names)], self.found(self.errors(fit.values)))[0]
        return fit

    def fits(self, models: Sequence[tuple[Mapping[str, float], Sequence[str]]], noise: Noise) -> list[Fit]:
        """Fit several models side by side, each from some values on with some free parameters: faster than in turn."""
        return self._answered([fitted(values, tuple(names), noise, self.excitation) for values, names in models], noise)

    def one_step_of(self, fit: Fit) -> tuple["Problem", Fit]:
        """Return the problem, and a fit of it, whose errors are one-step prediction errors: these."""
        return self, fit

    def extra_stds(self, fit: Fit) -> dict[str, float]:
        """Return additional standard deviations of a fit, by name; none if errors are white."""
        return dict.fromkeys(fit.names, 0.0)

    def renewed(self, fit: Fit, noise: Noise) -> Fit:
        """Return the fit with another noise."""
        return self.fit(fit.values, fit.names, noise, renew=0)

    def refitted(self, fit: Fit, starts: Sequence[Mapping[str, float]]) -> list[Fit]:
        """Return fits of the same parameters with the same noise from other values on."""
        return self.fits([(values, fit.names) for values in starts], fit.noise)

    def without(self, fit: Fit, effects: Sequence[Sequence[Effect]]) -> list[Fit]:
        """Return the fit without some effects, and without others, ...; the remaining parameters are refitted to first
        order.
        """
        own = [{parameter.name for effect in some for parameter in effect.parameters} for some in effects]
        sets = [self.excitation.without(fit.values, names) for names in own]
        white = self.white(lanes_of(sets), fit.noise)
        return [_refitted(fit, *one, white[:, index]) for index, one in enumerate(zip(sets, own, strict=True))]

    def linear(
        self, values: Mapping[str, float], names: Sequence[str], noise: Noise, stride: float | Floats = 1.0
    ) -> tuple[Floats, Floats]:
        """Return white errors (n,) at some values, and their slopes (n, p) by the parameters `names`."""
        return self._answered([linear(values, names, self.excitation, stride)], noise)[0]

    def _answered(self, askings: Sequence[Asking[T]], noise: Noise) -> list[T]:
        """Run several fits side by side, evaluating their requests together, until each has returned its result."""
        asked = {number: next(asking) for number, asking in enumerate(askings)}
        results: dict[int, T] = {}
        while asked:
            white = self.white(lanes_of([one for sets in asked.values() for one in sets]), noise)
            ends = np.cumsum([len(sets) for sets in asked.values()])
            for number, part in zip(list(asked), np.split(white, ends[:-1], axis=1), strict=True):
                try:
                    asked[number] = askings[number].send(part)
                except StopIteration as stop:
                    results[number] = stop.value
                    del asked[number]
        return [results[number] for number in range(len(askings))]

    def fit_beside(
        self, base: Fit, starts: Sequence[Mapping[str, float]], names: Sequence[Sequence[str]]
    ) -> list[tuple[dict[str, float], float]]:
        """Fit several models at once: the free parameters of `base` and, in each, some `names` of its own.

        `starts` are the values that each model's own parameters begin with. The slopes of the base's parameters are
        taken from its fit. Returns each model's values and its sum of squared white errors.
        """
        courses = [
            _Course({**base.values, **start}, (*base.names, *own), tuple(own), self.excitation)
            for start, own in zip(starts, names, strict=True)
        ]
        for step in range(QUICK_STEPS + MORE_STEPS):
            leader = min(course.squares for course in courses)
            least = PROMISED_BESIDE if step < QUICK_STEPS else MUCH_PROMISED * (base.squares - leader)
            open_ones = [course for course in courses if course.open(base.squares, leader, least)]
            if not open_ones:
                break
            moves = [moves_of(course.candidate, course.own, self.excitation) for course in open_ones]
            sets = [one for course, of in zip(open_ones, moves, strict=True) for one in course.lanes(of)]
            white = self.white(lanes_of(sets), base.noise)
            parts = np.split(white, np.cumsum([1 + len(course.own) for course in open_ones])[:-1], axis=1)
            for course, of, part in zip(open_ones, moves, parts, strict=True):
                course.go_on(part[:, 0], (part[:, 1:] - part[:, :1]) / of, base.slopes)
        return [(course.best, course.squares) for course in courses]


def _refitted(fit: Fit, values: Mapping[str, float], gone: Collection[str], rest: Floats) -> Fit:
    """Return the fit without the parameters `gone`, moved along its slopes to the least squares of `rest`."""
    kept = [index for index, name in enumerate(fit.names) if name not in gone]
    names, slopes = tuple(fit.names[index] for index in kept), np.ascontiguousarray(fit.slopes[:, kept])
    if not np.isfinite(rest).all():  # the model without these effects diverges
        return Fit(values, names, rest, slopes, fit.noise)
    step = newton_steps(slopes, rest, DAMPINGS[:1], room(values, names))[0]
    return Fit(moved(values, names, step), names, rest + slopes @ step, slopes, fit.noise)


class _Course:
    """The progress of one of several models fitted side by side; `own` are its parameters besides the base's."""

    def __init__(
        self, start: dict[str, float], free: Sequence[str], own: Sequence[str], excitation: Excitation
    ) -> None:
        self.free, self.own, self._excitation = free, own, excitation
        self.candidate = self.best = start
        self.squares = self.promised = np.inf
        self._step, self._pace, self._rounds = np.zeros(len(free)), 1.0, 0

    def open(self, base: float, leader: float, least: float) -> bool:
        """Return whether more steps may matter: the next predicts a reduction of at least `least`, and the best model
        is not far ahead.

        `base` and `leader` are the sums of squares of the base and of the best model.
        """
        late = self._rounds >= FAIR_ROUNDS and base - self.squares + self.promised < FAR_BEHIND * (base - leader)
        return self.promised > max(least, PROMISED_BESIDE) and not late

    def lanes(self, moves: Floats) -> list[dict[str, float]]:
        """Return the values to be tested next, and those with each own parameter moved."""
        return [self.candidate, *one_by_one(self.candidate, self.own, moves)]

    def go_on(self, rest: Floats, slopes: Floats, base: Floats) -> None:
        """Take a step from white errors (n,), slopes (n, p) of the own parameters, and those of the base."""
        self._rounds += 1
        squares = float(rest @ rest)
        if squares < self.squares:
            self.best, self.squares, self._pace = self.candidate, squares, 1.0
            every = np.concatenate([base, slopes], axis=1)
            self._step = newton_steps(every, rest, DAMPINGS[:1], room(self.best, self.free))[0]
            self.promised = squares - float(np.sum((rest + every @ self._step) ** 2))
        else:
            self._pace *= 0.3
        if np.isfinite(self.squares):
            self.candidate = moved(self.best, self.free, self._pace * self._step)
        else:
            self.candidate = nearer_to_neutral(self.candidate, self.own, self._excitation)


def nearer_to_neutral(values: Mapping[str, float], names: Sequence[str], excitation: Excitation) -> dict[str, float]:
    """Return the values with the effect of parameters `names` made smaller, because the model was invalid at its
    start.
    """
    result = dict(values)
    for known in (definition(name) for name in names):
        neutral = excitation.neutral(known.name)
        if known.switches and known.neutral is not None and np.isfinite(neutral):
            result[known.name] = neutral + 0.3 * (values[known.name] - neutral)
    return result


def tempered(white: Floats) -> Floats:
    """Return white errors (n, C) whose squares grow like Huber's loss, so that outliers do not dominate.

    A wheel that starts half a step early causes errors of a hundred standard deviations for an instant.
    """
    result = np.array(white)
    temper(result.reshape(-1), LARGE)
    return result


@compiled("void(f8[::1], f8)")
def temper(white, largest):  # type: ignore[no-untyped-def]
    """Let errors above `largest` grow only with their square root."""
    for index in range(len(white)):
        size = abs(white[index])
        if size > largest:
            white[index] = np.copysign(np.sqrt(2.0 * largest * size - largest**2), white[index])


def _folds(predictors: Sequence[Predictor]) -> np.typing.NDArray[np.int64]:
    """Return the fold of each white error, (n,): another recording, or with one recording alternating blocks."""
    several = len({predictor.segment.recording for predictor in predictors}) > 1
    return np.concatenate(
        [
            np.full(len(times), predictor.segment.recording)
            if several
            else np.floor((times + predictor.segment.observations.time) / BLOCK).astype(np.int64) % FOLDS
            for predictor in predictors
            for times in predictor.times.values()
        ]
    )
