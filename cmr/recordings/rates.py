"""Rates of driving and turning from two sensors at common times, and their correlation.

The times of the pieces are laid out with gaps between, in which neither sensor is known, so that a shift by a lag does
not mix pieces.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.recordings.pieces import Pieces
from cmr.recordings.robust import quantile
from cmr.recordings.signal import SECONDS, Floats, Mask
from cmr.recordings.travel import Travel

LEAST_MOTION = 1e-9  # spread of rates, in any unit; less counts as no motion
ROUNDING = 1e-12  # of sums of squares
FEWEST_SPANS = 4  # of common time
REACH, REACH_SHARE = 2.5, 0.25  # s, and share of a piece: largest usual lags
STEP = 0.04  # s between the times at which the rates are compared
SPAN = 0.2  # s over which rates are averaged, twice; longer for a slow sensor
SPARSEST = 1.0  # s per sample, on average; with fewer samples the time is mostly gaps
SHORTEST = 3.0  # s of common time
FEWEST_LEFT = 0.5  # of the times known without a lag, which a lag must leave


class IncomparableError(Exception):
    """Two sensors cannot be compared; the text says why."""


@dataclass(frozen=True)
class Rates:
    """The rates of one sensor at the common times, in units of its travel per second, and where they are known.

    `values` are 0 where they are not `covered`; both of shape (n,).
    """

    values: Floats
    covered: Mask

    @property
    def spread(self) -> float:
        """The spread of the rates."""
        return float(np.std(self.values[self.covered])) if self.covered.any() else 0.0

    def changes(self, piece: NDArray[np.int64], among: Mask) -> "Rates":
        """Return the deviations from their mean in each piece, over the times `among` which both sensors are known."""
        return Rates(np.where(self.covered, self.values - piece_means(self.values, piece, among), 0.0), self.covered)


def piece_means(values: Floats, piece: NDArray[np.int64], among: Mask) -> Floats:
    """Return for each time, shape (n,), the mean of the values of its piece over the times in `among`."""
    count = np.maximum(np.bincount(piece, among), 1.0)
    return np.asarray((np.bincount(piece, np.where(among, values, 0.0)) / count)[piece])


@dataclass(frozen=True)
class CommonRates:
    """The rates of two sensors, the later one first, at common times, `STEP` apart within each `piece`, (n,).

    `pairs` are the rates of driving, if both measure it, and of turning, averaged twice over `span` [s]. Lags of up to
    `shifts` steps can be detected.
    """

    pairs: list[tuple[Rates, Rates]]
    piece: NDArray[np.int64]
    span: float
    shifts: int


def common_rates(
    late: Travel, early: Travel, pieces: Pieces, origin: int, reach: float = REACH, share: float = REACH_SHARE
) -> CommonRates:
    """Return the rates of driving and turning from two sensors; `origin` [us] is the origin of their times.

    Lags of up to `reach` [s] are to be seen, but of no more than a `share` of a piece.
    Raises IncomparableError where they have too little in common.
    """
    first = np.maximum((pieces.first - origin) * SECONDS, max(late.time[0], early.time[0]))
    last = np.minimum((pieces.last - origin) * SECONDS, min(late.time[-1], early.time[-1]))
    common = last > first
    total = float((last - first)[common].sum())
    if total < SHORTEST:
        raise IncomparableError(f"they have less than {SHORTEST:.0f} s in common")
    if total > SPARSEST * (len(late.time) + len(early.time)):
        raise IncomparableError("the recording is mostly gaps")
    span = max(SPAN, *(2.5 * float(np.median(np.diff(travel.time))) for travel in (late, early)))
    if total < FEWEST_SPANS * span:
        raise IncomparableError("one of them comes too seldom")
    shifts = int(min(reach, share * pieces.usual) / STEP)
    moments, piece = _moments(first[common], last[common], shifts)
    pairs = [
        (_rates(late, a, moments, span), _rates(early, b, moments, span))
        for a, b in ((late.driven, early.driven), (late.turned, early.turned))
        if a is not None and b is not None
    ]
    pairs = [pair for pair in pairs if min(rates.spread for rates in pair) > LEAST_MOTION]
    if not pairs or shifts < 1:
        raise IncomparableError("nothing moves in one of them" if shifts else "the pieces are too short")
    return CommonRates(pairs, piece, span, shifts)


def _moments(first: Floats, last: Floats, room: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the times of all pieces, with `room` NaNs after each, and the piece of each time."""
    counts = np.floor((last - first) / STEP).astype(np.int64) + 1
    piece = np.repeat(np.arange(len(counts)), counts + room)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(counts + room) - counts - room, counts + room)
    return np.where(number < counts[piece], first[piece] + STEP * number, np.nan), piece


def _rates(travel: Travel, travelled: Floats, moments: Floats, span: float) -> Rates:
    """Return the rate around each moment, averaged twice over `span`; rare absurd ones are clipped.

    The second averaging makes noise smooth, so that it does not favour fractions of a step. A time is known if the
    whole average lies in one run, excluding its first and last intervals, which medians distort.
    """
    inside = np.isfinite(moments)
    rates = np.zeros(len(moments))
    at = moments[inside]
    ends = [np.interp(at + side * 0.5 * span, travel.time, travelled) for side in (1.0, -1.0)]
    rates[inside] = (ends[0] - ends[1]) / span
    half = round(0.5 * span / STEP)
    reach = 0.5 * span + half * STEP
    covered = np.zeros(len(moments), np.bool_)
    run = np.concatenate([travel.run[:1] - 1, travel.run, travel.run[-1:] + 1])  # so that the ends are ends of runs
    before = np.searchsorted(travel.time, at - reach, side="right")  # in `run`, the sample before
    after = np.searchsorted(travel.time, at + reach) + 1  # and the one after
    covered[inside] = run[np.maximum(before - 1, 0)] == run[np.minimum(after + 1, len(run) - 1)]
    largest = 1.5 * quantile(np.abs(rates[covered]), 0.95)
    total = np.cumsum(np.pad(np.clip(rates, -largest, largest), (half + 1, half), mode="edge"))
    twice = (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)
    return Rates(np.where(covered, twice, 0.0), covered)


def correlation_of(late: Rates, early: Rates, shifts: int) -> tuple[Floats, Floats]:
    """Return the correlation at each lag from -shifts to shifts steps, and the number of times it is based on.

    Both have shape (2 shifts + 1,), and are 0 where a lag leaves too few common times.
    """
    size = 1 << int(np.ceil(np.log2(len(late.values) + shifts + 1)))
    a, b = late.values / (late.spread + LEAST_MOTION), early.values / (early.spread + LEAST_MOTION)
    covered_a, covered_b = (np.fft.rfft(rates.covered, size) for rates in (late, early))
    lags = np.arange(-shifts, shifts + 1)

    def summed(of_late: NDArray[np.complex128], of_early: NDArray[np.complex128]) -> Floats:
        # Entry j of the product is the sum over t of late[t + j] early[t].
        return np.asarray(np.fft.irfft(of_late * np.conj(of_early), size)[lags])

    in_a, in_b = (np.fft.rfft(values, size) for values in (a, b))
    count = np.round(summed(covered_a, covered_b))
    enough = count >= max(FEWEST_LEFT * count.max(), 2.0)
    n = np.maximum(count, 1.0)
    sum_a, sum_b = summed(in_a, covered_b), summed(covered_a, in_b)
    energy_a = summed(np.fft.rfft(a**2, size), covered_b) - sum_a**2 / n
    energy_b = summed(covered_a, np.fft.rfft(b**2, size)) - sum_b**2 / n
    floor = ROUNDING * np.maximum(float(a @ a) * float(b @ b), 1.0) + 1e-300
    product = (summed(in_a, in_b) - sum_a * sum_b / n) / np.sqrt(np.maximum(energy_a * energy_b, floor))
    usable = enough & (energy_a > 1e-6 * float(a @ a)) & (energy_b > 1e-6 * float(b @ b))
    return np.where(usable, np.clip(product, -1.0, 1.0), 0.0), np.where(enough, count, 0.0)
