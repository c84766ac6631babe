"""Score all laws beside a model: the gain of each on the residuals, to first order.

With white errors w (n,), an orthonormal basis Q (n, p) of the parameters' traces, and the traces M (n, k) of a law,

    pull  = M' (w - Q Q' w),    size = M' M - M' Q Q' M
    LR    = pull' size^-1 pull
    score = LR / inflation - k ln n - 2 (K + 1) ln 2 - 2 ln N_K - c ln n

with K the size of the formula, N_K the number of formulas of that size, and c its inner constants: Schwarz's penalty
for the fitted coefficients, and twice the log of the number of laws tried (G. Schwarz, Annals of Statistics 6, 1978).
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from cmr.estimation.laws.candidates import Candidate, candidates
from cmr.estimation.laws.linearised import SIDES, Linearised, is_of_wheels, seen_in
from cmr.estimation.laws.rest import Indices, Rest
from cmr.recordings.signal import Floats

SIMD_WIDTH = 32  # traces observed in one batch
LEAST_OWN = 3e-4  # share of a trace's square orthogonal to the model's parameters; with less, they can imitate it
NOTHING = 1e-9  # white errors squared: a smaller change means that a law has no effect


@dataclass(frozen=True)
class Score:
    """A law with its likelihood ratio `gain`, to first order, its `score`, and its coefficients (k,)."""

    candidate: Candidate
    gain: float
    score: float
    coefficients: tuple[float, ...]


def scan(model: Linearised, rest: Rest, laws: Sequence[Candidate] | None = None) -> list[Score]:
    """Return the scores of laws beside a model with residuals `rest`, the best first; by default of all laws."""
    chosen = [model.sized(one) for one in (candidates() if laws is None else laws)]
    result: list[Score] = []
    for place in dict.fromkeys(one.place for one in chosen):
        signals = seen_in(place)
        seen = _Seen.of(rest, signals)
        if not len(seen.mask):
            continue
        for chunk in _chunks([one for one in chosen if one.place == place]):
            result += _scored(chunk, model.white_traces(chunk, rest.noise, signals), rest, seen)
    result.sort(key=lambda one: -one.score)
    return result


@cache
def sizes_of_grammar() -> Mapping[int, int]:
    """Return the number of laws of each size, counting each side of wheels."""
    counts: Counter[int] = Counter()
    for one in candidates():
        counts[one.size] += len(SIDES) if is_of_wheels(one.place) else 1
    return counts


def penalty(candidate: Candidate, samples: int) -> float:
    """Return the likelihood ratio of a law with score 0."""
    fitted = candidate.count + len(candidate.constants)
    tried = math.log(max(sizes_of_grammar().get(candidate.size, 1), 1))
    return fitted * math.log(max(samples, 2)) + 2.0 * (candidate.size + 1) * math.log(2.0) + 2.0 * tried


def _chunks(laws: Sequence[Candidate]) -> Iterator[list[Candidate]]:
    """Yield laws in batches for the observer."""
    chunk: list[Candidate] = []
    count = 0
    for one in laws:
        width = one.count * (2 if is_of_wheels(one.place) else 1)
        if chunk and count + width > SIMD_WIDTH:
            yield chunk
            chunk, count = [], 0
        chunk.append(one)
        count += width
    if chunk:
        yield chunk


@dataclass(frozen=True)
class _Seen:
    """The residuals of some signals: basis and white errors stacked (p + 1, n), and the mask (n,)."""

    against: Floats
    mask: Floats

    @classmethod
    def of(cls, rest: Rest, signals: Sequence[str]) -> "_Seen":
        rows = rest.rows(signals)
        return cls(np.vstack([rest.basis[rows].T, rest.white[rows]]), rest.mask[rows])


def _scored(chunk: Sequence[Candidate], traces: Floats, rest: Rest, seen: _Seen) -> Iterator[Score]:
    """Yield the scores of laws of one place from their white traces, stacked by column."""
    if rest.samples < len(rest.mask):
        traces *= seen.mask[:, None]
    shared = seen.against @ traces  # one product: reading the many traces takes longer than multiplying
    along, pulls = shared[:-1], shared[-1]
    before = np.einsum("nc,nc->c", traces, traces)
    of_side = 2 if is_of_wheels(chunk[0].place) else 1
    ends = np.cumsum([one.count * of_side for one in chunk])
    single = [number for number, one in enumerate(chunk) if one.count == 1]
    first = ends[single] - of_side
    products = [np.einsum("nc,nc->c", traces[:, first], traces[:, first + 1])] if of_side > 1 else []
    for side in SIDES if of_side > 1 else ("",):
        sums = _of_single(side, first, before, along, pulls, *products)
        for number, gain, coefficient in zip(single, *sums, strict=True):
            if np.isfinite(gain) and chunk[number].side in ("", side):
                law = chunk[number].on(side)
                yield Score(law, gain, gain / rest.inflation - penalty(law, rest.samples), (coefficient,))
    for one, end in zip(chunk, ends, strict=True):
        if one.count > 1:
            own = slice(end - one.count * of_side, end)
            parts = traces[:, own].T @ traces[:, own], along[:, own].T @ along[:, own], pulls[own]
            yield from _of_several(one, *parts, rest)


def _of_single(
    side: str, first: Indices, before: Floats, along: Floats, pulls: Floats, between: Floats | None = None
) -> tuple[list[float], list[float]]:
    """Return likelihood ratios and coefficients of laws of one formula on a side, from column `first` on.

    A ratio is NaN if the model imitates the law, or the law has no effect. `between` are products of left and right.
    """
    if between is None:
        whole, seen_along, pull = before[first], along[:, first], pulls[first]
    else:
        left, right = SIDES[side]
        whole = left**2 * before[first] + right**2 * before[first + 1] + 2.0 * left * right * between
        seen_along = left * along[:, first] + right * along[:, first + 1]
        pull = left * pulls[first] + right * pulls[first + 1]
    own = whole - np.einsum("pc,pc->c", seen_along, seen_along)
    told = (whole >= NOTHING) & (own >= LEAST_OWN * whole)
    coefficients = np.divide(pull, own, out=np.full(len(own), np.nan), where=told)
    return (pull * coefficients).tolist(), coefficients.tolist()


def _of_several(one: Candidate, size: Floats, imitated: Floats, pull: Floats, rest: Rest) -> Iterator[Score]:
    """Yield the scores of a law of several formulas, of wheels on all sides."""
    wheels = is_of_wheels(one.place)
    for side in SIDES if wheels and not one.side else (one.side,):
        found = _judged(*_on_side(size, imitated, pull, side))
        if found is not None:
            gain, coefficients = found
            law = one.on(side) if wheels else one
            yield Score(law, gain, gain / rest.inflation - penalty(law, rest.samples), coefficients)


def _on_side(size: Floats, imitated: Floats, pull: Floats, side: str) -> tuple[Floats, Floats, Floats]:
    """Return products (k, k) and pulls (k,) of a law on some wheels from those of left and right, side by side."""
    if not side:
        return size, imitated, pull
    mixing = np.kron(np.eye(len(pull) // 2), SIDES[side][:, None])
    return mixing.T @ size @ mixing, mixing.T @ imitated @ mixing, mixing.T @ pull


def _judged(size: Floats, imitated: Floats, pull: Floats) -> tuple[float, tuple[float, ...]] | None:
    """Return the likelihood ratio and coefficients of a law of several formulas.

    Returns None if the model imitates it, or it has no effect.
    """
    before = np.diag(size)
    if np.any(before < NOTHING):
        return None
    free = size - imitated
    if np.any(np.diag(free) < LEAST_OWN * before):
        return None
    scale = np.sqrt(np.diag(free))
    scaled = free / np.outer(scale, scale)
    if np.linalg.eigvalsh(scaled)[0] < LEAST_OWN:
        return None
    solved = np.linalg.solve(scaled, pull / scale)
    return float(solved @ (pull / scale)), tuple(map(float, solved / scale))
