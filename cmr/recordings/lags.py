"""Estimate the lag between two sensors' time stamps, from the robot's acceleration and turning.

Two sensors that measured the same motion give the same rates of driving and turning, up to unknown factors and offsets.
Both are averaged over the same short span and correlated over all lags within reach; the best lag is refined by least
squares to a fraction of a sample.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmr.model.command_kinds import DUTY
from cmr.recordings.pieces import Pieces
from cmr.recordings.rates import (
    REACH,
    REACH_SHARE,
    STEP,
    CommonRates,
    IncomparableError,
    Rates,
    common_rates,
    correlation_of,
    piece_means,
)
from cmr.recordings.recording import Recording
from cmr.recordings.robust import spread
from cmr.recordings.signal import Floats, Mask
from cmr.recordings.travel import Travel, travel_of

ITERATIONS = 3  # of the refinement: it converges quadratically from a step's width
LARGEST_STD = 0.05  # s; a less certain lag counts as unknown
SMALLEST_STD = 1e-6  # s; resolution of time stamps
# A clock that was never set: its lag is searched within so many seconds, or this share of a piece. It must explain this
# share of the squares of one rate, and have this many times the log-likelihood of the best usual lag.
FAR, FAR_SHARE = 60.0, 0.5
FAR_ALIKE, FAR_EVIDENCE = 0.9, 2.0
LEAST_EVIDENCE = 12.0  # log-likelihood by which the best lag must be better than no correlation
RIVAL = 0.4  # s; a lag further from the best than this must be worse
LEAST_LEAD = 4.0  # log-likelihood by which it must be worse
OUTLYING = 4.0  # standard deviations; larger differences of the rates are excluded
SMALLEST_LAG = 0.03  # s; clocks that differ by less count as equal
HALF_PERIOD = 0.5  # of the sampling interval: a stamp may be at its beginning, middle or end
SMALLEST_LEAD = 0.015  # s; filters of odometry have lags of 0.02 to 0.1
SURE = 5.0  # standard deviations by which clocks must differ
# s of lag behind commands with correct clocks: a motor, and a velocity controller.
SLOWEST_MOTOR, SLOWEST_CONTROLLER = 0.5, 2.0
MOTOR_RESPONSE = 0.15  # s by which wheels may follow a command sooner or later than on average, at least


@dataclass(frozen=True)
class Lag:
    """The lag of `sensor`'s stamps behind `reference`'s; `seconds` and `std` [s] are NaN if unknown."""

    sensor: str
    reference: str
    seconds: float
    std: float
    why_unknown: str = ""

    @classmethod
    def unknown(cls, sensor: str, reference: str, why: str) -> "Lag":
        """Return an unknown lag, with the reason."""
        return cls(sensor, reference, np.nan, np.nan, why)

    @property
    def known(self) -> bool:
        """Whether the lag is known."""
        return not self.why_unknown


def slowest_response(recording: Recording) -> float:
    """Return the largest lag [s] of the robot behind its commands with correct clocks."""
    return SLOWEST_MOTOR if recording.command_kind == DUTY else SLOWEST_CONTROLLER


def response_to_commands(lag: float) -> float:
    """Return how much [s] sooner or later than on average, after `lag`, a robot may follow a command."""
    return max(MOTOR_RESPONSE, lag)


def clocks_differ(lag: Lag, rates: Mapping[str, float], slowest: float) -> bool:
    """Return whether a lag proves that the two clocks differ.

    `rates` [Hz] are those of the signals: a stamp may be off by half an interval, because it is unknown which time
    within the interval it refers to. A robot may follow its commands within `slowest` [s].
    """
    if not lag.known:
        return False
    late = lag.seconds - (float(np.clip(lag.seconds, 0.0, slowest)) if lag.reference == "commands" else 0.0)
    stamps = math.hypot(HALF_PERIOD / rates[lag.sensor], HALF_PERIOD / rates[lag.reference])
    return abs(late) > stamps + math.hypot(SMALLEST_LAG, SURE * lag.std)


def is_ahead(lag: Lag, rates: Mapping[str, float]) -> bool:
    """Return whether a sensor is certainly ahead of its reference, which is then late, since no sensor measures the
    future.

    Only its own stamp may refer to the beginning of an interval. `rates` [Hz] are as in `clocks_differ`. Half an
    interval of slow wheels does not count, because the cause of their latency does not matter.
    """
    least = HALF_PERIOD / rates[lag.sensor] + math.hypot(SMALLEST_LEAD, SURE * lag.std) if lag.known else math.inf
    return -lag.seconds > least


def lags_of(recording: Recording) -> list[Lag]:
    """Return the lags of poses behind wheels, gyro behind wheels, and wheels behind commands (motor included).

    Without wheels, poses and gyro are compared with the commands. Pairs with a missing signal are omitted.
    """
    reference = "wheels" if len(recording.wheels) > 1 else "commands"
    pairs = [("poses", reference), ("gyro", reference), ("wheels", "commands")]
    signals = recording.signals
    present = [pair for pair in pairs if len(signals[pair[0]]) > 1 and len(signals[pair[1]]) > 1]
    return [_lag(recording, sensor, of) for sensor, of in present]


def _lag(recording: Recording, sensor: str, reference: str) -> Lag:
    """Find the lag of one sensor."""
    origin = int(recording.pieces.first[0])
    late, early = (travel_of(recording, name, origin) for name in (sensor, reference))
    # A recorder takes all from one moment on: stamps that begin elsewhere may be those of a clock that was set wrong.
    apart = float(late.time[0] - early.time[0])
    moved = replace(late, time=late.time - apart)
    near, why = _compared(late, early, recording.pieces, origin, REACH, REACH_SHARE)
    far, _ = _compared(moved, early, recording.pieces, origin, FAR, FAR_SHARE)
    least = FAR_EVIDENCE * (near.most if near is not None else LEAST_EVIDENCE)
    if far is not None and far.alike > FAR_ALIKE and far.most > least:
        lag = far.lag(sensor, reference)
        return replace(lag, seconds=lag.seconds + apart)
    return near.lag(sensor, reference) if near is not None else Lag.unknown(sensor, reference, why)


def _compared(
    late: Travel, early: Travel, pieces: Pieces, origin: int, reach: float, share: float
) -> tuple["_Compared | None", str]:
    """Return how well lags within reach explain the rates; None where these cannot be compared, and why."""
    try:
        return _Compared(common_rates(late, early, pieces, origin, reach, share)), ""
    except IncomparableError as why:
        return None, str(why)


class _Compared:
    """How well each lag explains the rates of two sensors: a log-likelihood for each pair, and their sum.

    `most` is that of the best lag, `alike` which share of the squares of a rate it explains.
    """

    def __init__(self, rates: CommonRates) -> None:
        self._rates = rates
        found = [_evidence(a, b, rates) for a, b in rates.pairs]
        self._of_pairs = np.stack([evidence for evidence, _ in found])
        self._evidence = self._of_pairs.sum(axis=0)
        self._best = int(np.argmax(self._evidence))
        self.most = float(self._evidence[self._best])
        self.alike = float(max(explained[self._best] for _, explained in found))

    def lag(self, sensor: str, reference: str) -> Lag:
        """Return the best lag, refined."""
        rates, evidence, best = self._rates, self._evidence, self._best
        far = np.abs(np.arange(len(evidence)) - best) * STEP > RIVAL
        if self.most < LEAST_EVIDENCE or best in (0, len(evidence) - 1):
            return Lag.unknown(sensor, reference, "their speeds do not change alike")
        if far.any() and evidence[far].max() > self.most - LEAST_LEAD:
            return Lag.unknown(sensor, reference, "several lags fit alike")
        # If driving or turning hardly changes, its rates are not correlated, and a refinement would be random.
        alike = [pair for pair, own in zip(rates.pairs, self._of_pairs[:, best], strict=True) if own >= LEAST_EVIDENCE]
        first = (best - rates.shifts) * STEP
        refined = [_refined(a, b, rates.piece, first, rates.span) for a, b in alike]
        # Lags beyond RIVAL explain less: a refinement that ends there has diverged.
        near = [(lag, std) for lag, std in refined if abs(lag - first) <= RIVAL]
        found = [(lag, max(std, SMALLEST_STD)) for lag, std in near if std < LARGEST_STD]
        if not found:
            return Lag.unknown(sensor, reference, "the speeds change too little")
        weight = sum(std**-2.0 for _, std in found)
        return Lag(sensor, reference, sum(lag * std**-2.0 for lag, std in found) / weight, weight**-0.5)


def _evidence(late: Rates, early: Rates, rates: CommonRates) -> tuple[Floats, Floats]:
    """Return the log-likelihood of each lag over no correlation, and which share of the squares it explains.

    Both have shape (2 shifts + 1,), for lags from -shifts to shifts steps.
    A lag is determined by changes within a piece. All lags are compared on as much data as the one with the least.
    """
    both = late.covered & early.covered
    late, early = late.changes(rates.piece, both), early.changes(rates.piece, both)
    correlation, count = correlation_of(late, early, rates.shifts)
    independent = count[count > 0.0].min(initial=len(both)) * STEP / rates.span
    explained = correlation**2 * (correlation > 0.0)
    return np.asarray(-0.5 * independent * np.log1p(-np.minimum(explained, 0.9999))), explained


def _refined(late: Rates, early: Rates, piece: NDArray[np.int64], lag: float, span: float) -> tuple[float, float]:
    """Return lag and standard deviation [s], refined jointly with factor and offset of the rates.

    Each piece has its own offset. The slope of one sensor's rates is the instrument for the other's: slopes of coarse
    encoders are mostly noise, so least squares on them would not find the lag.
    """
    place = np.arange(len(piece), dtype=np.float64)
    slope, slope_late = np.gradient(early.values, STEP), np.gradient(late.values, STEP)
    sloped, sloped_late = _sloped(early.covered), _sloped(late.covered)
    for _ in range(ITERATIONS):
        at = place - lag / STEP
        inside = sloped_late & _held(sloped, at)
        if np.count_nonzero(inside) < 0.5 * np.count_nonzero(sloped_late):  # it diverges, or is NaN
            return lag, np.inf
        rates, slopes = (np.interp(at, place, values) for values in (early.values, slope))
        rates, slopes, own_slopes, wanted = (
            (values - piece_means(values, piece, inside))[inside] for values in (rates, slopes, slope_late, late.values)
        )
        instruments, design = np.stack([rates, -slopes]), np.stack([rates, -own_slopes])
        residual = wanted - _solver(instruments, design) @ (instruments @ wanted) @ design
        kept = np.abs(residual) <= OUTLYING * max(spread(residual), 0.75 * float(np.std(residual)))
        instruments, design, wanted = instruments[:, kept], design[:, kept], wanted[kept]
        if not instruments[1] @ design[1] > 0.0:
            return lag, np.inf
        solver = _solver(instruments, design)
        solution = solver @ (instruments @ wanted)
        lag += float(solution[1])
    influence = solver[1] @ instruments * (wanted - solution @ design)
    return lag, _deviation(influence, piece[inside][kept], int(2.0 * span / STEP))


def _sloped(covered: Mask) -> Mask:
    """Return where a rate and its neighbours are known, so that its slope is."""
    around = np.pad(covered, 1)
    return np.asarray(covered & around[2:] & around[:-2])


def _held(covered: Mask, at: Floats) -> Mask:
    """Return which indices, shape (n,), lie between two where something is known."""
    below = np.floor(at).astype(np.int64) if np.isfinite(at).all() else np.full(len(at), -1)
    inside = (below >= 0) & (below + 1 < len(covered))
    below = np.clip(below, 0, len(covered) - 2)
    return np.asarray(inside & covered[below] & covered[below + 1])


def _solver(instruments: Floats, design: Floats) -> Floats:
    """Return the inverse of the product of instruments and regressors, each of shape (k, n); NaN without one."""
    product = instruments @ design.T
    try:
        return np.asarray(np.linalg.inv(product))
    except np.linalg.LinAlgError:
        return np.full_like(product, np.nan)


def _deviation(influence: Floats, piece: NDArray[np.int64], reach: int) -> float:
    """Return the standard deviation of a sum of correlated terms, shape (n,).

    Neighbours up to `reach` count with decreasing weight (Newey-West); errors of a piece, such as slip, are common to
    all of it.
    """
    total = float(influence @ influence)
    for k in range(1, min(reach, len(influence) - 1) + 1):
        total += 2.0 * (1.0 - k / (reach + 1)) * float(influence[k:] @ influence[:-k])
    by_piece = np.bincount(piece, influence)
    return float(np.sqrt(max(total, float(by_piece @ by_piece), 0.0)))
