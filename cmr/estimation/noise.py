"""What the noise of a robot's sensors is like, found from prediction errors; and the errors made white with it.

Each signal's error is first freed of what the other sensors' errors, just before, foretell of it; then of what its own
past foretells (an autoregressive model); then divided by its size, which grows with the wheel speed and with what
the ticks of the encoder leave open.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from cmr.estimation.nonnegative import nonnegative
from cmr.estimation.prediction import POSE_SIGNALS, WHEELS, Batch, Errors, Indices, Predictor
from cmr.model.compiled import compiled
from cmr.model.observer import MOTION
from cmr.recordings.signal import Floats

# The past of a signal in spans of growing length [samples]: few numbers reach back far (Corsi, J. Financial
# Econometrics 7, 2009: heterogeneous autoregression).
SPANS = {
    **dict.fromkeys(("psi_left", "psi_right", "yaw_rate"), (1, 1, 1, 1, 2, 4, 8, 16, 32)),
    **dict.fromkeys(POSE_SIGNALS, (1, 1, 1, 1, 4, 8)),
}
LARGEST_PAST = 1.0 / 6.0  # of the usual segment: what is foretold from the past begins after so much of it
RIDGE = 1e-6  # of the variance: keeps the model of a signal that never errs solvable
LEAST_SIZE = 1e-9
LONGEST_GAP = 10  # readings; in longer ones a wheel is no further off
RARE = 0.01  # of errors: too few to tell of what size such ones are
ROUNDS = 3
FOREIGN = ("psi_left", "psi_right", "yaw_rate")  # whose errors since the pose before foretell those of the pose
PSI_LEFT, PSI_RIGHT, YAW_RATE = (MOTION.index(name) for name in ("psi_left", "psi_right", "yaw_rate"))
STAMP = 1e-3  # s by which a gyro's stamp may be off
LARGE = 2.5  # standard deviations from which an error counts less than in full (Huber, Ann. Math. Statist. 35, 1964)
# The mean square of normal errors of size one, where larger ones count as LARGE.
CUT_OFF = 1.0 - math.sqrt(2.0 / math.pi) * LARGE * math.exp(-0.5 * LARGE**2)
CUT_OFF += (LARGE**2 - 1.0) * math.erfc(LARGE / math.sqrt(2.0))
SETTLING = 20  # rounds in which the size of cut-off errors settles


@dataclass(frozen=True)
class SignalNoise:
    """The noise of one signal: `past` (p,) weighs its own last errors, span by span, `foreign` (3,) those of FOREIGN.

    `sizes` are the standard deviations of what remains, in the signal's unit: one array (n,) for each segment.
    """

    past: Floats
    foreign: Floats
    sizes: tuple[Floats, ...]

    def weights(self, first: int, last: int) -> Floats:
        """Return one over the sizes in the segments from `first` to `last`, the latter not included, (n,)."""
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
    def found(cls, predictors: Sequence[Predictor], errors: Sequence[Errors]) -> "Noise":
        """Find the noise from the errors of the first candidate in each segment."""
        names = [name for name in SPANS if any(name in p.times for p in predictors)]
        batch = Batch(predictors)
        poses = batch.ends[POSE_SIGNALS[0]]
        first = [replace(one, of={name: of[:, :1] for name, of in one.of.items()}) for one in errors]
        sums = np.stack([of[:, 0] for of in _foreign(batch, batch.joined(first))])
        foreign = np.split(sums, poses[1:-1], axis=1)
        return cls({name: _found(name, predictors, errors, foreign) for name in names})

    @classmethod
    def plain(cls, predictors: Sequence[Predictor], errors: Sequence[Errors]) -> "Noise":
        """Return white noise of the size of all errors: what is known before anything is."""
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
        """Return the noise in which large errors of the first candidate are not as exact as others of their kind.

        What a busy computer does to the stamps of a few readings would else count for more than all the others say.
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
        foreign = _foreign(batch, errors) if any(np.any(self.of[name].foreign) for name in batch.signals) else []
        for name in batch.signals:
            noise, own = self.of[name], errors.of[name]
            if name in POSE_SIGNALS and np.any(noise.foreign):
                own = own - sum(weight * other for weight, other in zip(noise.foreign, foreign, strict=True))
            weights = noise.weights(first, first + len(batch.predictors))
            whiten(
                np.ascontiguousarray(own), batch.ends[name], *_sums(noise.past, noise.spans(name)), weights,
                batch.at[name], result,
            )  # fmt: skip
        return result


def _size_of_most(white: Floats) -> float:
    """Return the standard deviation of white errors (n,), large ones cut off; those that have no past are 0."""
    squares = white[white != 0.0] ** 2
    size = 1.0
    for _ in range(SETTLING if len(squares) else 0):
        size = math.sqrt(float(np.mean(np.minimum(squares, (LARGE * size) ** 2))) / CUT_OFF)
    return size


def _found(
    name: str, predictors: Sequence[Predictor], errors: Sequence[Errors], others: Sequence[Floats]
) -> SignalNoise:
    """Find one signal's noise: weighted least squares for what is foretold, then its size, a few times."""
    spans = _spans(name, [len(predictor.times.get(name, ())) for predictor in predictors])
    order = sum(spans)
    rows, growths = [], growth_in_gaps(name, predictors, errors)
    grows = [
        _sizes(name, predictor, error) * growth[:, None] ** 2 if name in predictor.times else np.empty((0, 3))
        for predictor, error, growth in zip(predictors, errors, growths, strict=True)
    ]
    for predictor, error, of_others, own_grows in zip(predictors, errors, others, grows, strict=True):
        if name not in predictor.times or len(predictor.times[name]) <= 2 * order:
            continue
        own = error.of[name][:, 0]
        foreign = of_others if name in POSE_SIGNALS else np.zeros((len(FOREIGN), len(own)))
        rows.append((own, foreign, own_grows))
    if not rows:
        ones = tuple(np.ones(len(p.times.get(name, ()))) for p in predictors)
        return SignalNoise(np.zeros(len(spans)), np.zeros(len(FOREIGN)), ones)
    foreign_weights = np.zeros(len(FOREIGN))
    past = np.zeros(len(spans))
    weights = [np.ones(len(own)) for own, _, _ in rows]
    size = np.zeros(3)
    for _ in range(ROUNDS):
        foreign_weights = _least_squares([(f * w, o * w) for (o, f, _), w in zip(rows, weights, strict=True)])
        freed = [own - foreign_weights @ foreign for own, foreign, _ in rows]
        pasts = [_past(one, spans) for one in freed]
        past = _least_squares(
            [(p * w[order:], one[order:] * w[order:]) for p, one, w in zip(pasts, freed, weights, strict=True)]
        )
        rest = [one[order:] - past @ p for p, one in zip(pasts, freed, strict=True)]
        size = size_found(np.concatenate(rest), np.concatenate([s[order:] for _, _, s in rows]))
        weights = [1.0 / np.sqrt(np.maximum(s @ size, LEAST_SIZE**2)) for _, _, s in rows]
    found = tuple(np.sqrt(np.maximum(own @ size, LEAST_SIZE**2)) for own in grows)
    return SignalNoise(past, foreign_weights, found)


def foretold(name: str, errors: Sequence[Floats]) -> Floats:
    """Return what is left of a signal's errors, one array (n,) a segment, when their past has foretold what it can."""
    spans = _spans(name, [len(one) for one in errors])
    order = sum(spans)
    pairs = [(_past(one, spans), one[order:]) for one in errors if len(one) > 2 * order]
    if not pairs:
        return np.empty(0)
    past = _least_squares(pairs)
    return np.concatenate([b - past @ a for a, b in pairs])


def _spans(name: str, lengths: Sequence[int]) -> tuple[int, ...]:
    """Return the spans of the past that fit into a usual segment: half of all errors are in longer ones."""
    if not any(lengths):
        return ()
    ordered = np.sort(lengths)
    usual = ordered[np.searchsorted(np.cumsum(ordered), 0.5 * np.sum(ordered))]
    return SPANS[name][: np.searchsorted(np.cumsum(SPANS[name]), LARGEST_PAST * usual, side="right")]


def _least_squares(pairs: Sequence[tuple[Floats, Floats]]) -> Floats:
    """Return the weights with which the rows of a explain b, over all pairs (a, b)."""
    normal = sum(a @ a.T for a, _ in pairs)
    right = sum(a @ b for a, b in pairs)
    scale = np.diag(normal) + (np.diag(normal) == 0.0)
    return np.asarray(np.linalg.solve(normal + np.diag(RIDGE * scale), right))


def _past(values: Floats, spans: Sequence[int]) -> Floats:
    """Return the sums over spans of the past of each value, newest first, shape (spans, n - sum of spans)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    order, count = sum(spans), len(values)
    begins = np.concatenate([[0], np.cumsum(spans)])
    rows = [
        total[order - first : count - first] - total[order - last : count - last] for first, last in pairwise(begins)
    ]
    return np.stack(rows) if rows else np.empty((0, count))


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


def _sizes(name: str, predictor: Predictor, errors: Errors) -> Floats:
    """Return what the variance of a signal's noise may grow with, shape (n, 3): 1, doubt squared, wheel speeds squared.

    The doubt of a wheel is what its ticks leave open [rad]; that of the gyro is what its time leaves open where the yaw
    rate changes [rad/s]. Doubts that are rarely as small count as larger: on a steady drive nearly all are the same,
    and nothing tells how much of the noise is theirs. The few errors of a wheel that rolls to a stop would then count
    far too much.
    """
    motion = predictor.motion_at(errors.motion, name)
    speed = motion[:, PSI_LEFT] ** 2 + motion[:, PSI_RIGHT] ** 2
    if name == "yaw_rate":
        doubt = STAMP * predictor.motion_at(_acceleration(errors.motion, predictor.segment.observations.dt), name)[:, 0]
    else:
        doubt = predictor.doubt[name]
    return np.stack([np.ones(len(speed)), np.maximum(doubt, np.quantile(doubt, RARE)) ** 2, speed], axis=1)


def growth_in_gaps(name: str, predictors: Sequence[Predictor], errors: Sequence[Errors]) -> list[Floats]:
    """Return by how much errors of a wheel that come after a gap are larger, one array (n,) a segment; of others 1.

    A wheel that rolls to a stop passes its last ticks ever more slowly, and meanwhile nobody corrects its speed. How
    far off it is after a gap of some readings is known from those without: it is what they corrected on the way.
    """
    times = [predictor.times.get(name, np.empty(0)) for predictor in predictors]
    steps = np.concatenate([np.diff(one) for one in times])
    if name not in WHEELS or not len(steps):
        return [np.ones(len(one)) for one in times]
    usual = float(np.median(steps))
    sizes = []
    for missed in range(LONGEST_GAP):
        parts = [_after_gap(error, name, usual, missed) for error in errors if name in error.of]
        sizes.append(float(np.median(np.concatenate(parts))))
    growth = np.maximum.accumulate(np.array(sizes) / sizes[0]) if sizes[0] > 0.0 else np.ones(LONGEST_GAP)
    gaps = [np.round(np.diff(one, prepend=one[:1]) / usual).astype(np.int64) for one in times]
    return [growth[np.clip(gap - 1, 0, LONGEST_GAP - 1)] for gap in gaps]


def _after_gap(errors: Errors, name: str, interval: float, missed: int) -> Floats:
    """Return how far off a wheel would be [rad] after each gap, had the observer `missed` so many readings before."""
    own = errors.of[name][:, 0]
    result = own[missed:].copy()
    for back in range(1, missed + 1):
        result += (errors.followed.angle + errors.followed.psi * back * interval) * own[missed - back : len(own) - back]
    return np.abs(result)


def _acceleration(motion: Floats, dt: float) -> Floats:
    """Return how fast the yaw rate changes about each border [rad/s^2], shape (T + 1, 1)."""
    rate = motion[:, YAW_RATE]
    change = np.abs(np.diff(rate, prepend=rate[:1], append=rate[-1:])) / dt
    return np.maximum(change[1:], change[:-1])[:, None]


def _foreign(batch: Batch, errors: Errors) -> list[Floats]:
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


def _sums(past: Floats, spans: Sequence[int]) -> tuple[Floats, Indices]:
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

    Segments end at the rows `ends`. Subtracted are `shares` of the sums of all errors of the segment up to so many
    `before` each, and what remains is weighed. The first, which have no past, become 0.
    """
    candidates = errors.shape[1]
    longest = np.max(before)
    kept = 1
    while kept <= longest:  # a power of two: its remainders are the last bits
        kept *= 2
    last_bits = kept - 1
    sums = np.empty((kept, candidates))  # in turn: that up to `row`, itself not included, stands at its remainder
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
