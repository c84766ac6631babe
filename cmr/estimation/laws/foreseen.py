"""Foresee what laws explain, without observing any: only the promising ones need be observed.

A law's gain is its pull at the white errors, squared, over the square of its own traces: those freed of what the
model's parameters do. Pulls come from one transposed recursion for all laws (`transposed.py`). So do the products with
random vectors of signs, freed in the same way; their mean square estimates the square of the law's own traces
(M. F. Hutchinson, Communications in Statistics - Simulation and Computation 19, 1990).
"""

from collections.abc import Sequence
from functools import cached_property
from itertools import groupby

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

VECTORS = 24  # of signs: a gain is foreseen to 30 %
SURELY = 3.0  # times the gain that is foreseen: a law explains more in one case of ten thousand
MOST = 256  # laws that are observed
ABREAST = 64  # formulas multiplied side by side


class Foreseen:
    """What laws will explain beside a model that leaves `rest`."""

    def __init__(self, model: Linearised, rest: Rest) -> None:
        self.model, self.rest = model, rest

    def promising(self, laws: Sequence[Candidate], most: int = MOST) -> list[Candidate]:
        """Return the laws with the best scores that they may have, so many at most, in their order."""
        if len(laws) <= most:
            return list(laws)
        sized = [self.model.sized(one) for one in laws]
        by_place = sorted(range(len(sized)), key=lambda number: sized[number].place)
        scores = np.empty(len(sized))
        for place, group in groupby(by_place, key=lambda number: sized[number].place):
            numbers = list(group)
            scores[numbers] = _scores_at(place, [sized[n] for n in numbers], self.model, self.rest, self.pulled)
        best = np.sort(np.argsort(-scores, kind="stable")[:most])
        return [sized[number] for number in best.tolist()]

    @cached_property
    def pulled(self) -> list[Floats]:
        """What each of DISTURBED pulls at the white errors, and at vectors of signs, in each segment, (T, 14, V)."""
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
    """Transpose `foreign_sums`: what a pose's errors owe to other signals' weighs these, too."""
    ends = batch.ends[name]
    for weight, other in zip(rest.noise.of[name].foreign.tolist(), FOREIGN, strict=True):
        if not weight or other not in batch.signals:
            continue
        at = batch.before_poses[other]
        for begin, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            if end - begin > 1:
                rows = np.diff(at[begin:end])
                of[other][at[begin] : at[end - 1]] -= weight * np.repeat(of[name][begin + 1 : end], rows, axis=0)


def _scores_at(
    place: str, laws: Sequence[Candidate], model: Linearised, rest: Rest, pulled: Sequence[Floats]
) -> Floats:
    """Return the scores that laws of one place surely do not exceed, (L,)."""
    acts = [
        [sum(share * one[:, DISTURBED.index(name)] for name, share in act.items()) for one in pulled]
        for act in shares_of(place, model.values)
    ]
    formulas = [(factors, law.constants) for law in laws for factors in law.all_factors]
    products = np.empty((len(acts), len(formulas), VECTORS + 1))
    for first in range(0, len(formulas), ABREAST):
        some = formulas[first : first + ABREAST]
        for side, act in enumerate(acts):
            parts = [
                np.stack([model.course(k, side if len(acts) > 1 else -1, *one) for one in some]) @ weights
                for k, weights in enumerate(act)
            ]
            products[side, first : first + ABREAST] = np.sum(parts, axis=0)
    scores, end = [], 0
    for law in laws:
        begin, end = end, end + len(law.all_factors)
        gain = max(_gain(product) for product in _on_sides(law, products[:, begin:end]))
        scores.append(SURELY * gain / rest.inflation - penalty(law, rest.samples))
    return np.array(scores)


def _on_sides(law: Candidate, products: Floats) -> list[Floats]:
    """Return the products (k, V) of a law on each side that it may have, from those of the left and the right."""
    if not is_of_wheels(law.place):
        return [products[0]]
    return [np.tensordot(share, products, 1) for side, share in SIDES.items() if law.side in ("", side)]


def _gain(products: Floats) -> float:
    """Return the likelihood ratio that a law's products (k, V) with the errors and with random vectors foresee."""
    pull, signs = products[:, 0], products[:, 1:]
    if len(pull) == 1:
        own = float(np.mean(signs**2))
        return float(pull[0] ** 2) / own if own > 0.0 else 0.0
    own_of_all = signs @ signs.T / VECTORS
    return float(pull @ np.linalg.pinv(own_of_all, hermitian=True) @ pull)
