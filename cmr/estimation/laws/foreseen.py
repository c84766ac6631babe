"""Predict the gains of laws without running the observer, so that it runs only for promising ones.

A law's gain is the squared product of its traces with the white errors, over the squared norm of its own traces, after
projecting out those of the model's parameters. The products come from one transposed recursion for all laws
(`transposed.py`), and so do the products with random sign vectors, whose mean square estimates the squared norm (M. F.
Hutchinson, Communications in Statistics - Simulation and Computation 19, 1990).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.linearised import SIDES, Linearised, is_of_wheels, shares_of
from cmr.estimation.laws.rest import Rest
from cmr.estimation.laws.scan import penalty
from cmr.estimation.noise import FOREIGN, SignalNoise, sums_of_past
from cmr.estimation.prediction import POSE_SIGNALS, Batch
from cmr.estimation.unexplained.traces import DISTURBED
from cmr.estimation.unexplained.transposed import pulls
from cmr.recordings.signal import Floats

VECTORS = 24  # random sign vectors: a gain is predicted to 30 %
SURELY = 3.0  # times the predicted gain: exceeded in one case of ten thousand
MOST = 128  # laws for which the observer runs
SIMD_WIDTH = 64  # formulas multiplied in one batch
Formula = tuple[tuple[str, ...], tuple[tuple[str, float], ...]]  # its factors, and the constants in them
Kind = tuple[tuple[str, ...], bool]  # of formulas: the places that use them, and whether they are of wheels


@dataclass(frozen=True)
class Expected:
    """Predicted `gains` (L, S) of laws on each possible side, else NaN, and their `penalties` (L,).

    `inflation` is the factor by which gains exceed chance.
    """

    laws: Sequence[Candidate]
    gains: Floats
    penalties: Floats
    inflation: float

    def best(self, most: int = MOST) -> list[Candidate]:
        """Return up to `most` laws with the best possible scores, in their order."""
        scores = SURELY * np.nanmax(self.gains, axis=1) / self.inflation - self.penalties
        return [self.laws[number] for number in np.sort(np.argsort(-scores, kind="stable")[:most]).tolist()]

    def of_one_coefficient(self, place: str = "") -> Floats:
        """Return the gains on each side of laws with one coefficient, at one place or all places."""
        own = [one.count == 1 and place in ("", one.place) for one in self.laws]
        return self.gains[own][np.isfinite(self.gains[own])]


class Foreseen:
    """Predicts the gains of laws beside a model with the residuals `rest`."""

    def __init__(self, model: Linearised, rest: Rest) -> None:
        self.model, self.rest = model, rest

    def promising(self, laws: Sequence[Candidate], most: int = MOST) -> list[Candidate]:
        """Return up to `most` laws with the best possible scores, in their order."""
        return list(laws) if len(laws) <= most else self.expected(laws).best(most)

    def expected(self, laws: Sequence[Candidate]) -> Expected:
        """Return the predictions for all laws."""
        sized = [self.model.sized(one) for one in laws]
        products, gains = self._products(sized), np.full((len(sized), len(SIDES)), np.nan)
        for of_wheels, count in {(is_of_wheels(one.place), one.count) for one in sized}:
            numbers = [n for n, one in enumerate(sized) if (is_of_wheels(one.place), one.count) == (of_wheels, count)]
            own = np.stack(
                [[products[of, of_wheels, sized[n].place] for of in _formulas_of(sized[n])] for n in numbers]
            )
            if of_wheels:
                on_sides = np.einsum("sw,lkwv->lskv", np.stack([*SIDES.values()]), own)
                allowed = [[sized[n].side in ("", side) for side in SIDES] for n in numbers]
                gains[numbers] = np.where(allowed, _gains(on_sides), np.nan)
            else:
                gains[numbers, 0] = _gains(own[:, None, :, 0])[:, 0]
        penalties = np.array([penalty(one, self.rest.samples) for one in sized])
        return Expected(sized, gains, penalties, self.rest.inflation)

    def _products(self, laws: Sequence[Candidate]) -> Mapping[tuple[Formula, bool, str], Floats]:
        """Return the products of formulas at places, of wheels or not: (1 or 2 sides, V + 1).

        Products shared by several places are computed once.
        """
        places: dict[tuple[Formula, bool], dict[str, None]] = {}
        for law in laws:
            for formula in _formulas_of(law):
                places.setdefault((formula, is_of_wheels(law.place)), {})[law.place] = None
        kinds: dict[Kind, list[Formula]] = {}
        for (formula, of_wheels), asking in places.items():
            kinds.setdefault((tuple(asking), of_wheels), []).append(formula)
        result = {}
        for kind, formulas in kinds.items():
            for formula, products in zip(formulas, self._products_of(kind, formulas), strict=True):
                for place, product in zip(kind[0], products, strict=True):
                    result[formula, kind[1], place] = product
        return result

    def _products_of(self, kind: Kind, formulas: Sequence[Formula]) -> Floats:
        """Return the products of formulas of one kind, (formulas, places, sides, V + 1)."""
        places, of_wheels = kind
        sides = (0, 1) if of_wheels else (-1,)
        result = np.zeros((len(formulas), len(sides), len(places) * (VECTORS + 1)))
        for number, side in enumerate(sides):
            for k, weights in enumerate(self._weights(places, number)):
                courses = np.empty((SIMD_WIDTH, len(weights)), np.float32)
                for first in range(0, len(formulas), SIMD_WIDTH):
                    some = formulas[first : first + SIMD_WIDTH]
                    for row, (factors, constants) in enumerate(some):
                        courses[row] = self.model.course(k, side, factors, dict(constants))
                    result[first : first + len(some), number] += courses[: len(some)] @ weights
        return result.reshape(len(formulas), len(sides), len(places), -1).swapaxes(1, 2)

    def _weights(self, places: Sequence[str], side: int) -> list[Floats]:
        """Return the transposed traces of each segment at some places, on a side, in each step, (T, places (V + 1))."""
        acts = [shares_of(place, self.model.values)[side] for place in places]
        return [np.concatenate([_acting(act, one) for act in acts], axis=1, dtype=np.float32) for one in self.pulled]

    @cached_property
    def pulled(self) -> list[Floats]:
        """The products of each of DISTURBED with the white errors and sign vectors, in each segment, (T, 14, V)."""
        model, rest, batch = self.model, self.rest, self.model.problem.batch
        signs = np.random.default_rng(model.problem.seed).choice((-1.0, 1.0), (len(rest.white), VECTORS))
        signs *= rest.mask[:, None]
        signs -= rest.basis @ (rest.basis.T @ signs)
        vectors = np.column_stack([rest.white, signs]) * rest.mask[:, None]
        of = {name: _blackened(name, vectors, rest, batch) for name in batch.signals}
        for name in POSE_SIGNALS:
            if name in batch.signals and np.any(rest.noise.of[name].foreign):
                _lend_to_others(name, of, rest, batch)
        result = []
        for k, (predictor, error) in enumerate(zip(batch.predictors, model.errors, strict=True)):
            own = {name: of[name][batch.ends[name][k] : batch.ends[name][k + 1]] for name in predictor.times}
            result.append(pulls(predictor, error.motion, model.values, model.problem.gains, own))
        return result


def _blackened(name: str, vectors: Floats, rest: Rest, batch: Batch) -> Floats:
    """Transpose `whiten`: return weights (m, V) of a signal's errors from those of its white errors."""
    noise: SignalNoise = rest.noise.of[name]
    ends = batch.ends[name]
    weights = noise.weights(0, len(batch.predictors))
    shares, before = sums_of_past(noise.past, noise.spans(name))
    longest = int(before.max(initial=0))
    result = np.zeros((int(ends[-1]), vectors.shape[1]))
    for rows, begin, end in zip(batch.white_rows(name), ends[:-1], ends[1:], strict=True):
        weighed = vectors[rows] * weights[begin:end, None]
        weighed[:longest] = 0.0
        from_here = np.cumsum(weighed[::-1], axis=0)[::-1]  # the sum of all rows from each one on
        own = weighed
        for share, back in zip(shares.tolist(), before.tolist(), strict=True):
            if share and back + 1 < len(own):
                own[: -back - 1] -= share * from_here[back + 1 :]
        result[begin:end] = own
    return result


def _lend_to_others(name: str, of: dict[str, Floats], rest: Rest, batch: Batch) -> None:
    """Transpose `foreign_sums`: the weights of pose errors also act on other signals through it."""
    ends = batch.ends[name]
    for weight, other in zip(rest.noise.of[name].foreign.tolist(), FOREIGN, strict=True):
        if not weight or other not in batch.signals:
            continue
        at = batch.before_poses[other]
        for begin, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            if end - begin > 1:
                rows = np.diff(at[begin:end])
                of[other][at[begin] : at[end - 1]] -= weight * np.repeat(of[name][begin + 1 : end], rows, axis=0)


def _formulas_of(law: Candidate) -> list[Formula]:
    return [
        (factors, tuple((n, value) for n, value in law.constants.items() if any(n in text for text in factors)))
        for factors in law.all_factors
    ]


def _acting(shares: Mapping[str, float], pulled: Floats) -> Floats:
    """Return the weighted sum of the responses to DISTURBED, (T, V + 1)."""
    return np.asarray(sum(share * pulled[:, DISTURBED.index(name)] for name, share in shares.items()))


def _gains(products: Floats) -> Floats:
    """Return the predicted likelihood ratios (L, S) from products (L, S, k, V + 1) with errors and random vectors."""
    pull, signs = products[..., :1], products[..., 1:]
    own = signs @ signs.swapaxes(-1, -2) / VECTORS
    if own.shape[-1] == 1:
        return np.divide(pull**2, own, out=np.zeros_like(pull), where=own > 0.0)[..., 0, 0]
    return np.asarray((pull.swapaxes(-1, -2) @ np.linalg.pinv(own, hermitian=True) @ pull)[..., 0, 0])
