"""Estimate the noise of a robot's sensors from prediction errors, and whiten the errors with it.

Three steps whiten each signal's errors: subtract the part predicted by the latest errors of other sensors, subtract the
part predicted by the signal's own past errors (an autoregressive model), and divide by the standard deviation, which
grows with wheel speed and with encoder quantisation.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, pairwise

import numpy as np

from cmr.estimation.prediction import POSE_SIGNALS, WHEELS, Batch, Errors, Indices, Predictor
from cmr.model.compiled import compiled
from cmr.model.observer.drives import ends_of
from cmr.model.observer.observer import MOTION
from cmr.recordings.signal import Floats, Mask

# The past of a signal in spans of growing length [samples]: few numbers reach back far (Corsi, J. Financial
# Econometrics 7, 2009: heterogeneous autoregression).
SPANS = {
    **dict.fromkeys(("psi_left", "psi_right", "yaw_rate"), (1, 1, 1, 1, 2, 4, 8, 16, 32)),
    **dict.fromkeys(POSE_SIGNALS, (1, 1, 1, 1, 4, 8)),
}
LARGEST_PAST = 1.0 / 6.0  # of the usual segment: errors are predicted from at most so long a past
RIDGE = 1e-6  # of the variance: keeps the model of an error-free signal solvable
LEAST_SIZE = 1e-9  # smallest noise, also of an error-free signal
LONGEST_GAP = 10  # readings; beyond this, the error of a wheel does not grow further
RARE = 0.01  # of errors: too few to estimate their size
ROUNDS = 3  # of reweighted least squares
FOREIGN = ("psi_left", "psi_right", "yaw_rate")  # whose errors since the pose before predict those of the pose
PSI_LEFT, PSI_RIGHT, YAW_RATE = (MOTION.index(name) for name in ("psi_left", "psi_right", "yaw_rate"))
STAMP = 1e-3  # s of uncertainty of a gyro's stamp
LARGE = 2.5  # standard deviations from which an error counts less than in full (Huber, Ann. Math. Statist. 35, 1964)
# The mean square of normal errors of size one, with larger ones counted as LARGE.
CUT_OFF = 1.0 - math.sqrt(2.0 / math.pi) * LARGE * math.exp(-0.5 * LARGE**2)
CUT_OFF += (LARGE**2 - 1.0) * math.erfc(LARGE / math.sqrt(2.0))
SETTLING = 20  # rounds in which the size of cut-off errors settles


@dataclass(frozen=True)
class SignalNoise:
    """The noise of one signal: `past` (p,) weighs its own last errors, span by span, `foreign` (3,) those of FOREIGN.

    `sizes` are the standard deviations of the innovations, in the signal's unit: one array (n,) per segment.
    """

    past: Floats
    foreign: Floats
    sizes: tuple[Floats, ...]

    def weights(self, first: int, last: int) -> Floats:
        """Return the reciprocal sizes in the segments from `first` up to but not including `last`, (n,)."""
        inverse, ends = self._weights
        return inverse[ends[first] : ends[last]]

    @cached_property
    def _weights(self) -> tuple[Floats, Indices]:
        ends = np.cumsum([0, *(len(size) for size in self.sizes)])
        return 1.0 / np.concatenate(self.sizes), ends

    def spans(self, name: str) -> tuple[int, ...]:
        """Return the spans [samples] of the past that are weighed, newest first; `name` is the signal's."""
        return SPANS[name][: len(self.past)]


@dataclass(frozen=True)
class Noise:
    """The noise of all signals, by name."""

    of: Mapping[str, SignalNoise]

    @classmethod
    def found(cls, batch: Batch, errors: Errors, largest_past: float = LARGEST_PAST) -> "Noise":
        """Estimate the noise from the errors of the first candidate in all segments of a batch.

        `largest_past` limits the autoregression, as a share of the usual segment.
        """
        first = replace(errors, of={name: of[:, :1] for name, of in errors.of.items()})
        sums = np.stack([of[:, 0] for of in foreign_sums(batch, first)])
        return cls({name: _found(name, batch, first, sums, largest_past) for name in SPANS if name in batch.signals})

    @classmethod
    def plain(cls, predictors: Sequence[Predictor], errors: Sequence[Errors]) -> "Noise":
        """Return white noise with the size of all errors, as an initial estimate."""
        result = {}
        for name in SPANS:
            own = [error.of[name][:, 0] for error in errors if name in error.of]
            spans = _spans(name, [len(one) for one in own])
            if own:
                size = max(float(np.sqrt(np.mean(np.concatenate(own) ** 2))), LEAST_SIZE)
                sizes = tuple(np.full(len(p.times.get(name, ())), size) for p in predictors)
                result[name] = SignalNoise(np.zeros(len(spans)), np.zeros(len(FOREIGN)), sizes)
        return cls(result)

    def with_outliers(self, predictors: Sequence[Predictor], errors: Sequence[Errors]) -> "Noise":
        """Return the noise with larger sizes for readings at which the first candidate's errors are large.

        A busy computer corrupts the time stamps of a few readings, which would otherwise dominate.
        """
        batch = Batch(predictors)
        white = self.all_white(batch, batch.joined(errors))[:, 0]
        result = {}
        for name, noise in self.of.items():
            own = [white[rows] for rows in batch.white_rows(name)]
            size = _size_of_most(np.concatenate(own))
            doubted = [np.sqrt(np.maximum(1.0, np.abs(one) / (LARGE * size))) for one in own]
            sizes = tuple(size * doubt * before for doubt, before in zip(doubted, noise.sizes, strict=True))
            result[name] = replace(noise, sizes=sizes)
        return Noise(result)

    @property
    def log_size(self) -> float:
        """Twice the sum of the logarithms of all sizes: the log-determinant term of -2 log likelihood."""
        return 2.0 * sum(float(np.sum(np.log(size))) for noise in self.of.values() for size in noise.sizes)

    def white(self, number: int, predictor: Predictor, errors: Errors) -> dict[str, Floats]:
        """Return the errors of segment `number` made white, (n, C) by signal; the first, which have no past, are 0."""
        ends = np.cumsum([len(times) for times in predictor.times.values()])
        white = self.all_white(Batch([predictor]), errors, number)
        return dict(zip(predictor.times, np.split(white, ends[:-1]), strict=True))

    def all_white(self, batch: Batch, errors: Errors, first: int = 0) -> Floats:
        """Return the errors of a batch made white, shape (n, C): segment by segment and signal by signal.

        Its segments are those from number `first` on.
        """
        candidates = next(iter(errors.of.values())).shape[1]
        result = np.empty((batch.rows, candidates))
        foreign = foreign_sums(batch, errors) if any(np.any(self.of[name].foreign) for name in batch.signals) else []
        for name in batch.signals:
            noise, own = self.of[name], errors.of[name]
            if name in POSE_SIGNALS and np.any(noise.foreign):
                own = own - sum(weight * other for weight, other in zip(noise.foreign, foreign, strict=True))
            weights = noise.weights(first, first + len(batch.predictors))
            whiten(
                np.ascontiguousarray(own), batch.ends[name], *sums_of_past(noise.past, noise.spans(name)), weights,
                batch.at[name], result,
            )  # fmt: skip
        return result


def _size_of_most(white: Floats) -> float:
    """Return the standard deviation of white errors (n,), large ones cut off; errors without a past are 0."""
    squares = white[white != 0.0] ** 2
    size = 1.0
    for _ in range(SETTLING if len(squares) else 0):
        size = math.sqrt(float(np.mean(np.minimum(squares, (LARGE * size) ** 2))) / CUT_OFF)
    return size


def _found(name: str, batch: Batch, errors: Errors, others: Floats, largest_past: float) -> SignalNoise:
    """Estimate one signal's noise: weighted least squares for the predictable part, then the size of the rest,
    iterated.

    `others` (3, poses) are sums of the errors of FOREIGN before each pose.
    """
    ends = batch.ends[name]
    spans = _spans(name, np.diff(ends).tolist(), largest_past)
    grows = _sizes(name, batch, errors) * growth_in_gaps(name, batch, errors)[:, None] ** 2
    used, ends_of_used = _long_enough(ends, sum(spans))
    foreign_weights, past, size = np.zeros(len(FOREIGN)), np.zeros(len(spans)), np.zeros(3)
    if not len(used):
        return SignalNoise(past, foreign_weights, _by_segment(np.ones(len(grows)), ends))
    own, basis = errors.of[name][used, 0], grows[used]
    foreign = np.take(others, used, axis=1) if name in POSE_SIGNALS else None
    rows, weights, freed = _with_past(ends_of_used, sum(spans)), np.ones(len(used)), own
    for _ in range(ROUNDS):
        if foreign is not None:
            foreign_weights = _least_squares(foreign * weights, own * weights)
            freed = own - foreign_weights @ foreign
        before, now = _past(freed, rows, spans), freed[rows]
        past = _least_squares(before * weights[rows], now * weights[rows])
        size = size_found(now - past @ before, basis[rows])
        weights = 1.0 / np.sqrt(np.maximum(basis @ size, LEAST_SIZE**2))
    return SignalNoise(past, foreign_weights, _by_segment(np.sqrt(np.maximum(grows @ size, LEAST_SIZE**2)), ends))


def _by_segment(rows: Floats, ends: Indices) -> tuple[Floats, ...]:
    return tuple(np.split(rows, ends[1:-1]))


def predicted(name: str, errors: Floats, ends: Indices) -> Floats:
    """Return a signal's errors (n,), whose segments end at the rows `ends`, minus their prediction from the past.

    Errors at the beginning of a segment, which have no past, are omitted.
    """
    spans = _spans(name, np.diff(ends).tolist())
    used, ends = _long_enough(ends, sum(spans))
    if not len(used):
        return np.empty(0)
    own, rows = errors[used], _with_past(ends, sum(spans))
    before, now = _past(own, rows, spans), own[rows]
    return np.asarray(now - _least_squares(before, now) @ before)


def _long_enough(ends: Indices, order: int) -> tuple[Indices, Indices]:
    """Return the rows in segments that are more than twice as long as the past, and the new ends of the segments."""
    counts = np.diff(ends)
    enough = counts > 2 * order
    return np.flatnonzero(np.repeat(enough, counts)), ends_of(counts[enough])


def _with_past(ends: Indices, order: int) -> Indices:
    """Return the rows that have a past of so many rows in their segment."""
    rows = np.arange(ends[-1])
    return rows[rows - np.repeat(ends[:-1], np.diff(ends)) >= order]


def _spans(name: str, lengths: Sequence[int], largest_past: float = LARGEST_PAST) -> tuple[int, ...]:
    """Return the spans of the past that fit into a usual segment: half of all errors are in longer ones."""
    if not any(lengths):
        return ()
    ordered = np.sort(lengths)
    usual = ordered[np.searchsorted(np.cumsum(ordered), 0.5 * np.sum(ordered))]
    return SPANS[name][: np.searchsorted(np.cumsum(SPANS[name]), largest_past * usual, side="right")]


def _least_squares(rows: Floats, right: Floats) -> Floats:
    """Return the weights (k,) with which the `rows` (k, n) explain `right` (n,)."""
    normal = rows @ rows.T
    scale = np.diag(normal) + (np.diag(normal) == 0.0)
    return np.asarray(np.linalg.solve(normal + np.diag(RIDGE * scale), rows @ right))


def _past(values: Floats, rows: Indices, spans: Sequence[int]) -> Floats:
    """Return the sums over spans of the past of the values at some `rows`, newest first, shape (spans, rows)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    begins = np.concatenate([[0], np.cumsum(spans)]).astype(np.int64)
    result = np.empty((len(spans), len(rows)))
    for index, (first, last) in enumerate(pairwise(begins.tolist())):
        result[index] = total[rows - first] - total[rows - last]
    return result


def size_found(rest: Floats, sizes: Floats) -> Floats:
    """Return shares (3,) with which `sizes` (n, 3) explain the squares of `rest` best (gamma likelihood)."""
    squares = rest**2
    weights = np.ones(len(rest)) / max(float(np.mean(squares)), LEAST_SIZE**2)
    rows = np.ascontiguousarray(sizes.T)
    result = np.zeros(len(rows))
    scale = np.sqrt(np.mean(rows**2, axis=1)) + 1e-300
    for _ in range(ROUNDS):
        scaled = rows / scale[:, None] * weights
        normal, right = scaled @ scaled.T, scaled @ (squares * weights)
        result = nonnegative(normal + 1e-12 * np.trace(normal) * np.eye(len(normal)), right) / scale
        fitted = np.maximum(result @ rows, 1e-3 * np.mean(squares) + LEAST_SIZE**2)
        weights = 1.0 / fitted
    result[0] = max(result[0], 1e-3 * float(np.mean(squares)))
    return np.asarray(result)


def nonnegative(normal: Floats, right: Floats) -> Floats:
    """Return the x >= 0 (n,) that minimises x N x / 2 - x r; N (n, n) is positive definite, r (n,).

    All subsets of zero unknowns are tried at once, for two or three unknowns. SciPy's `nnls` handles many, but
    importing it takes longer than a typical fit.
    """
    free = _choices(len(right))
    systems = np.where(free[:, :, None] & free[:, None, :], normal, np.eye(len(right)))
    pulls = np.where(free, right, 0.0)
    parts = np.linalg.solve(systems, pulls[:, :, None])[:, :, 0]
    values = np.where(np.all(parts >= 0.0, axis=1), -0.5 * np.sum(parts * pulls, axis=1), np.inf)
    best = int(np.argmin(values))
    return np.asarray(parts[best]) if values[best] < 0.0 else np.zeros(len(right))


@cache
def _choices(count: int) -> Mask:
    """Return all non-empty subsets of `count` unknowns as rows, (choices, unknowns)."""
    chosen = [one for size in range(1, count + 1) for one in combinations(range(count), size)]
    return np.array([[number in one for number in range(count)] for one in chosen])


def _sizes(name: str, batch: Batch, errors: Errors) -> Floats:
    """Return the regressors of a signal's noise variance, shape (n, 3): 1, doubt squared, wheel speeds squared.

    The doubt of a wheel is the standard deviation due to quantisation [rad]; that of the gyro is due to uncertain
    stamps while the yaw rate changes [rad/s]. In each segment, the smallest 1 % of these are raised to that quantile.
    On a steady drive nearly all are equal, so their share of the noise cannot be estimated, and the few errors with a
    small one, of a wheel that rolls to a stop, would get far too much weight.
    """
    rows = batch.motion_rows[name]
    speed = errors.motion[rows, PSI_LEFT] ** 2 + errors.motion[rows, PSI_RIGHT] ** 2
    doubt = np.zeros(len(rows))
    if name == "yaw_rate":
        doubt = STAMP * _acceleration(errors.motion[:, YAW_RATE], batch)[rows]
    elif name in WHEELS:
        doubt = np.concatenate([one.doubt[name] for one in batch.predictors if name in one.times])
    if name not in POSE_SIGNALS:
        least = [np.quantile(one, RARE) if len(one) else 0.0 for one in _by_segment(doubt, batch.ends[name])]
        doubt = np.maximum(doubt, np.repeat(least, np.diff(batch.ends[name])))
    return np.stack([np.ones(len(speed)), doubt**2, speed], axis=1)


def growth_in_gaps(name: str, batch: Batch, errors: Errors) -> Floats:
    """Return the factor by which errors grow after a gap in a wheel's readings, (n,).

    It is 1 without a gap, and for other signals. A wheel that rolls to a stop passes its last ticks ever more slowly,
    and no reading corrects its speed meanwhile. The error after a gap of some readings is estimated from stretches
    without a gap, by adding up the corrections of so many readings.
    """
    ends = batch.ends[name]
    counts, own = np.diff(ends), errors.of[name][:, 0]
    number = np.arange(len(own)) - np.repeat(ends[:-1], counts)  # index of each reading in its segment
    if name not in WHEELS or not np.any(number):
        return np.ones(len(own))
    times = np.concatenate([one.times.get(name, np.empty(0)) for one in batch.predictors])
    steps = np.where(number > 0, np.diff(times, prepend=times[:1]), 0.0)
    usual = float(np.median(steps[number > 0]))
    missing, sizes = own.copy(), [float(np.median(np.abs(own)))]
    for missed in range(1, LONGEST_GAP):
        missing[missed:] += (errors.followed.angle + errors.followed.psi * missed * usual) * own[:-missed]
        sizes.append(float(np.median(np.abs(missing[number >= missed]))))
    growth = np.maximum.accumulate(np.array(sizes) / sizes[0]) if sizes[0] > 0.0 else np.ones(LONGEST_GAP)
    gaps = np.round(steps / usual).astype(np.int64)
    return np.asarray(growth[np.clip(gaps - 1, 0, LONGEST_GAP - 1)])


def _acceleration(rate: Floats, batch: Batch) -> Floats:
    """Return the yaw acceleration at each step boundary of the batch's segments [rad/s^2], (n,)."""
    change = np.abs(np.diff(rate, prepend=rate[:1], append=rate[-1:])) / batch.dt
    change[batch.borders] = 0.0
    return np.maximum(change[1:], change[:-1])


def foreign_sums(batch: Batch, errors: Errors) -> list[Floats]:
    """Return the sums of other signals' errors since the pose before, (poses, C) each; 0 for a segment's first pose."""
    candidates = next(iter(errors.of.values())).shape[1]
    poses = batch.ends[POSE_SIGNALS[0]]
    result = []
    for name in FOREIGN:
        sums = np.zeros((int(poses[-1]), candidates))
        if name in batch.signals and len(sums):
            add_between(np.ascontiguousarray(errors.of[name]), batch.before_poses[name], poses, sums)
        result.append(sums)
    return result


@compiled("void(f8[:, ::1], i8[::1], i8[::1], f8[:, ::1])")
def add_between(errors, at, ends, result):  # type: ignore[no-untyped-def]
    """Add the rows of errors between each row number `at` and the one before, within segments that end at `ends`."""
    for segment in range(len(ends) - 1):
        for index in range(ends[segment] + 1, ends[segment + 1]):
            for row in range(at[index - 1], at[index]):
                for column in range(errors.shape[1]):
                    result[index, column] += errors[row, column]


def sums_of_past(past: Floats, spans: Sequence[int]) -> tuple[Floats, Indices]:
    """Return shares of sums of all errors up to so many before each, which weigh its `past`; see `whiten`."""
    # A sum over a span is the difference of the sums of all errors up to its ends. Four ends are taken at once.
    count = len(spans) + 1
    shares, before = np.zeros(count + -count % 4), np.zeros(count + -count % 4, np.int64)
    shares[: count - 1] = past
    shares[1:count] -= past
    before[1:count] = np.cumsum(spans)
    return shares, before


@compiled("void(f8[:, ::1], i8[::1], f8[::1], i8[::1], f8[::1], i8[::1], f8[:, ::1])")
def whiten(errors, ends, shares, before, weights, at, result):  # type: ignore[no-untyped-def]
    """Write the errors (n, C) of one signal made white, those of each segment from row `at` of the result on.

    Segments end at the rows `ends`. Subtracts `shares` times the running sums of the segment up to `before` rows
    earlier, and multiplies by `weights`. The first errors, which have no past, become 0.
    """
    candidates = errors.shape[1]
    longest, kept = 0, 1
    for rows in before:
        longest = max(longest, rows)
    while kept <= longest:  # a power of two: its remainders are the last bits
        kept *= 2
    last_bits = kept - 1
    sums = np.empty((kept, candidates))  # ring buffer of running sums, indexed by row modulo its length
    for segment in range(len(ends) - 1):
        begin, count = ends[segment], ends[segment + 1] - ends[segment]
        sums[:] = 0.0
        for row in range(count):
            there = at[segment] + row
            weight = weights[begin + row] if row >= longest else 0.0
            for column in range(candidates):
                result[there, column] = weight * errors[begin + row, column]
            if row >= longest:
                for index in range(0, len(before), 4):
                    one, two = weight * shares[index], weight * shares[index + 1]
                    three, four = weight * shares[index + 2], weight * shares[index + 3]
                    first, second = sums[(row - before[index]) & last_bits], sums[(row - before[index + 1]) & last_bits]
                    third = sums[(row - before[index + 2]) & last_bits]
                    fourth = sums[(row - before[index + 3]) & last_bits]
                    for i in range(candidates):
                        result[there, i] -= one * first[i] + two * second[i] + three * third[i] + four * fourth[i]
            last, newest = sums[row & last_bits], sums[(row + 1) & last_bits]
            for column in range(candidates):
                newest[column] = last[column] + errors[begin + row, column]
