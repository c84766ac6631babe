"""Scores of terms: how much of the prediction errors each explains beside a fitted model, and how reliably.

Three numbers with different weaknesses judge a term: the drop of the sum of squares, which relies on the estimated
noise; the agreement between blocks of time, which does not, but needs many blocks; and the drop on left-out folds.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.prediction import SIGNALS, Batch, Errors, Predictor
from cmr.estimation.problem import BLOCK, LARGE, Problem
from cmr.estimation.unexplained.terms import Column, Drive, Term, terms_for
from cmr.estimation.unexplained.traces import DISTURBED, SEEN_IN, Disturbances, only, traces
from cmr.model.observer.observer import MOTION
from cmr.recordings.signal import Floats, Mask

MOST_NUMBERS = 4_000_000  # white errors times columns that are held at once
FEWEST_COLUMNS, MOST_COLUMNS = 12, 64  # whitened at once
OWN = 0.03  # share of a disturbance's traces that must be orthogonal to the model
ALIKE = 1e-2  # of the largest: directions of a term that hardly differ from its others do not count
NOTHING = 1e-6  # least sum of squared white errors that a term must cause
FEW_BLOCKS = 3  # blocks of time without which a term must still hold
JERKY = 2.0  # standard deviations by which a yaw rate may jump between two steps
DROP_PER_COEFFICIENT, LEAST_DROP = 1.0, 12.0  # a smaller drop may be chance, whatever else supports the term

Indices = np.typing.NDArray[np.int64]


@dataclass(frozen=True)
class Score:
    """The score of a term.

    `drop` is that of the sum of squared white errors, `freedom` the number of its free coefficients. The others are
    computed only for a promising term: `agreement`, the drop tested by the variation between `blocks` of time;
    `steady`, the drop without the few blocks that support the term most; `held_out`, the drop on left-out folds, and
    the `signal` with most of it.
    """

    term: Term
    drop: float
    freedom: int
    agreement: float = 0.0
    blocks: int = 0
    steady: float = 0.0
    held_out: float = 0.0
    signal: str = ""

    def chance(self, spread: float) -> float:
        """Return the p-value: the larger of the two tests of the drop.

        `spread` is the inflation of drops of irrelevant terms.
        """
        from scipy.special import chdtrc, fdtrc

        if self.blocks <= self.freedom:
            return 1.0
        left = max(self.blocks - self.agreement, 1e-9 * self.blocks)
        ratio = self.agreement / self.freedom / (left / (self.blocks - self.freedom))
        by_blocks = fdtrc(self.freedom, self.blocks - self.freedom, ratio)
        return float(max(by_blocks, chdtrc(self.freedom, self.drop / spread)))


@dataclass(frozen=True)
class Remainder:
    """The residuals of a fit, per white error (n,).

    `loud` are the errors, 0 where large ones are expected; `white` the same with large ones clipped, so that outliers
    do not dominate, and orthogonal to the traces of the model's parameters (`basis` (n, p), orthonormal). `signal` is
    the number of the signal, `time` [s] is relative to its `recording`, `fold` is that of the problem.
    """

    loud: Floats
    white: Floats
    basis: Floats
    signal: Indices
    time: Floats
    recording: Indices
    fold: Indices

    def blocks(self, seconds: float) -> Indices:
        """Return the number of each error's block of time."""
        return np.asarray(np.floor(self.time / seconds).astype(np.int64) + 10**9 * self.recording, np.int64)


def remainder(problem: Problem, fit: Fit, errors: Sequence[Errors]) -> Remainder:
    """Return the residuals of a fit; the first column of `errors` are those at its values."""
    basis = np.linalg.qr(fit.slopes)[0]
    signals, times, recordings, jerks = [], [], [], []
    for number, (predictor, error) in enumerate(zip(problem.predictors, errors, strict=True)):
        for name, moments in predictor.times.items():
            signals.append(np.full(len(moments), SIGNALS.index(name)))
            times.append(moments + predictor.segment.observations.time)
            recordings.append(np.full(len(moments), predictor.segment.recording))
            sizes = fit.noise.of[name].sizes[number]
            jerks.append(jerky(predictor, error.motion, fit.values, sizes) if name == "yaw_rate" else sizes < 0.0)
    loud = np.where(np.concatenate(jerks), 0.0, problem.made_white(errors, fit.noise)[:, 0])
    calm = np.clip(loud, -LARGE, LARGE)
    return Remainder(
        loud=loud,
        white=calm - basis @ (basis.T @ calm),
        basis=basis,
        signal=np.concatenate(signals),
        time=np.concatenate(times),
        recording=np.concatenate(recordings),
        fold=problem.folds,
    )


def jerky(predictor: Predictor, motion: Floats, values: Mapping[str, float], sizes: Floats) -> Mask:
    """Return which gyro readings (n,) coincide with a jump of the acceleration.

    Within a step the model knows only the mean yaw rate, so the errors of such readings exceed their noise.
    """
    difference = motion[:, MOTION.index("psi_right")] - motion[:, MOTION.index("psi_left")]
    jumps = np.abs(np.diff(difference, n=2, prepend=difference[:1], append=difference[-1:]))
    jumps = np.maximum(jumps, np.maximum(np.roll(jumps, 1), np.roll(jumps, -1)))
    at = np.minimum(
        np.round(predictor.times["yaw_rate"] / predictor.segment.observations.dt).astype(np.int64), len(jumps) - 1
    )
    return np.asarray(jumps[at] * values["wheel_radius"] / values["base_width"] > JERKY * sizes)


def scores(
    problem: Problem, fit: Fit, errors: Sequence[Errors], rest: Remainder, drives: Sequence[Drive]
) -> list[Score]:
    """Return the scores of all terms beside a fit with residuals `rest`, in the `drives` of a problem."""
    predicted = all(len(predictor.segment.observations.given) == 0 for predictor in problem.predictors)
    result = []
    terms = terms_for(drives, predicted)
    for signals in dict.fromkeys(SEEN_IN.values()):
        some = [term for term in terms if SEEN_IN[term.disturbed] == signals]
        rows = _rows(rest, signals)
        if not len(rows.order):
            continue
        views = [only(predictor, signals) for predictor in problem.predictors]
        for chunk in _chunks(some, drives, len(rows.order)):
            moves = _moves(problem, fit, errors, views, [columns for _, columns in chunk])
            result += _scored([term for term, _ in chunk], [len(one[0]) for _, one in chunk], moves, rows)
    return result


def predicted_by(
    term: Term, problem: Problem, fit: Fit, errors: Sequence[Errors], rest: Remainder, drives: Sequence[Drive]
) -> Floats:
    """Return a term's prediction of each white error (n,), fitted on the other folds.

    `drives` are those of the term's columns.
    """
    signals = SEEN_IN[term.disturbed]
    views, rows = [only(predictor, signals) for predictor in problem.predictors], _rows(rest, signals)
    columns = [term.columns(drive) for drive in drives]
    moves = _moves(problem, fit, errors, views, [columns])
    along = rows.basis.T @ moves
    mixing = _mixing(moves, along)
    own = (moves @ mixing - rows.basis @ (along @ mixing))[rows.order]
    result = np.zeros(len(rest.white))
    result[rows.there] = _predicted(own, _of_blocks(own, rows), rows)
    return result


def _moves(
    problem: Problem,
    fit: Fit,
    errors: Sequence[Errors],
    views: Sequence[Predictor],
    columns: Sequence[list[list[Column]]],
) -> Floats:
    """Return the white traces (n, columns) of terms, side by side, whose `columns` are given in each drive."""
    errors_of = [
        traces(view, error.motion, fit.values, problem.gains, _stacked([of_term[number] for of_term in columns]))
        for number, (view, error) in enumerate(zip(views, errors, strict=True))
    ]
    batch = Batch(views)
    return fit.noise.all_white(batch, batch.joined(errors_of))


@dataclass(frozen=True)
class _Rows:
    """White errors of some signals, and the `order` that sorts them by fold and block.

    In that order are `signal`, and `there`, the index of each among all errors; blocks begin at `begins`, and `folds`
    are slices by number.
    """

    white: Floats
    basis: Floats
    order: Indices
    there: Indices
    signal: Indices
    begins: Indices
    fold_of_block: Indices
    folds: Mapping[int, slice]


def _rows(rest: Remainder, signals: Sequence[str]) -> _Rows:
    inside = np.flatnonzero(np.isin(rest.signal, [SIGNALS.index(name) for name in signals]))
    order = np.lexsort((rest.time[inside], rest.fold[inside]))
    there = inside[order]
    block, fold = rest.blocks(BLOCK)[there], rest.fold[there]
    begins = np.flatnonzero(np.diff(block, prepend=-1))
    borders = [*np.flatnonzero(np.diff(fold, prepend=-1)), len(fold)]
    folds = {int(fold[first]): slice(int(first), int(last)) for first, last in pairwise(borders)}
    return _Rows(
        white=rest.white[inside],
        basis=rest.basis[inside],
        order=order,
        there=there,
        signal=rest.signal[there],
        begins=begins,
        fold_of_block=fold[begins],
        folds=folds,
    )


def _chunks(
    terms: Sequence[Term], drives: Sequence[Drive], rows: int
) -> Iterator[list[tuple[Term, list[list[Column]]]]]:
    """Yield terms with their columns in each drive, in chunks that fit in memory."""
    most = int(np.clip(MOST_NUMBERS / max(rows, 1), FEWEST_COLUMNS, MOST_COLUMNS))
    chunk: list[tuple[Term, list[list[Column]]]] = []
    count = 0
    for term in terms:
        columns = [term.columns(drive) for drive in drives]
        if chunk and count + len(columns[0]) > most:
            yield chunk
            chunk, count = [], 0
        chunk.append((term, columns))
        count += len(columns[0])
    if chunk:
        yield chunk


def _stacked(columns: Sequence[Sequence[Column]]) -> Disturbances:
    """Return the columns of several terms in one drive side by side."""
    every = [column for of_term in columns for column in of_term]
    shares = np.zeros((len(DISTURBED), len(every)))
    for index, (acts, _) in enumerate(every):
        for name, share in acts.items():
            shares[DISTURBED.index(name), index] = share
    return Disturbances(np.stack([course for _, course in every], axis=1), shares)


def _scored(terms: Sequence[Term], counts: Sequence[int], moves: Floats, rows: _Rows) -> list[Score]:
    """Return the scores of terms whose white traces (n, columns) are `moves`, side by side."""
    along = rows.basis.T @ moves
    last = np.cumsum(counts)
    return [
        _score(term, moves[:, first:end], along[:, first:end], rows)
        for term, first, end in zip(terms, last - counts, last, strict=True)
    ]


def _score(term: Term, moves: Floats, along: Floats, rows: _Rows) -> Score:
    """Return the score of a term with these traces (n, k), of which the model can imitate `along` (p, k)."""
    mixing = _mixing(moves, along)
    if not mixing.shape[1]:
        return Score(term, 0.0, 0)
    pull = (rows.white @ moves) @ mixing
    drop = float(pull @ pull)
    if drop < DROP_PER_COEFFICIENT * len(pull) + LEAST_DROP:
        return Score(term, drop, len(pull))
    return _judged(term, pull, moves @ mixing - rows.basis @ (along @ mixing), rows)


def _mixing(moves: Floats, along: Floats) -> Floats:
    """Return a mixing (k, m) of traces (n, k) whose parts orthogonal to the model are orthonormal.

    `along` (p, k) are their components within the model's basis. m = 0 if nothing is orthogonal.
    """
    normal = moves.T @ moves
    before, imitated = np.diag(normal), np.einsum("pk,pk->k", along, along)
    own = np.flatnonzero((before - imitated > OWN * before) & (before > NOTHING))
    if not len(own):
        return np.zeros((len(before), 0))
    size = np.sqrt(before - imitated)[own]
    free = (normal - along.T @ along)[np.ix_(own, own)] / np.outer(size, size)
    values, vectors = np.linalg.eigh(free)
    kept = values > ALIKE * values[-1]
    mixing = np.zeros((len(before), np.count_nonzero(kept)))
    mixing[own] = vectors[:, kept] / np.sqrt(values[kept]) / size[:, None]
    return mixing


def _judged(term: Term, pull: Floats, moves: Floats, rows: _Rows) -> Score:
    """Return the score of a term with orthonormal traces (n, k), orthogonal to the model's, and with these pulls."""
    moves, white = moves[rows.order], rows.white[rows.order]
    of_blocks = _of_blocks(moves, rows)
    steady = pull - of_blocks[np.argsort(of_blocks @ pull)[-FEW_BLOCKS:]].sum(axis=0)
    predicted = _predicted(moves, of_blocks, rows)
    drops = np.bincount(rows.signal, (2.0 * white - predicted) * predicted, len(SIGNALS))
    best = int(np.argmax(drops))
    return Score(
        term,
        drop=float(pull @ pull),
        freedom=len(pull),
        agreement=float(pull @ np.linalg.lstsq(of_blocks.T @ of_blocks, pull, rcond=1e-10)[0]),
        blocks=len(rows.begins),
        steady=float(steady @ steady),
        held_out=float(drops.sum()),
        signal=SIGNALS[best],
    )


def _of_blocks(moves: Floats, rows: _Rows) -> Floats:
    """Return the pull of each block, (blocks, k), at traces (n, k) in the order of the blocks."""
    return np.asarray(np.add.reduceat(moves * rows.white[rows.order][:, None], rows.begins, axis=0))


def _predicted(moves: Floats, of_blocks: Floats, rows: _Rows) -> Floats:
    """Return each fold's white errors (n,) as the others predict them; `moves` (n, k) are orthonormal over all."""
    pull, whole = of_blocks.sum(axis=0), np.eye(moves.shape[1])
    result = np.empty(len(moves))
    for fold, inside in rows.folds.items():
        normal = moves[inside].T @ moves[inside]
        elsewhere = pull - of_blocks[rows.fold_of_block == fold].sum(axis=0)
        result[inside] = moves[inside] @ np.linalg.lstsq(whole - normal, elsewhere, rcond=1e-6)[0]
    return result
