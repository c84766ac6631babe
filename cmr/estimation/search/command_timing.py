"""Individual delays and losses of commands, estimated from the response to each change of the duty.

Each command that changes the duty leaves a trace in the wheels' prediction errors if it takes effect late; its size is
the delay. The delays of all commands are unknowns, and what remains is white noise: a linear model with random effects
(Laird and Ware, Biometrics 38, 1982). The resulting estimate for each command, marginalised over the others, is
compared with distributions of delays: constant; uniform, which is jitter; some delayed until the next command, which is
loss. The duty of a late command is an impulse in the model, that of a lost one a pulse until the next command. Each
distribution allows outliers, caused by moments of high load on a computer, so neither these nor slightly inaccurate
stamps turn a delay into jitter or loss.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cmr.estimation.gauss_newton import Fit
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Errors, Indices, Predictor
from cmr.estimation.problem import Problem
from cmr.recordings.signal import Floats, Mask

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

REACH = 0.5  # s after which the trace of a command's delay has decayed
IMPULSES = 4  # replace the pulse of duty of a lost command, which may last as long as the reading interval
LEAST_CHANGE = 1e-3  # duty; a smaller change of a command does not reveal its delay
LOSSES = np.geomspace(2e-3, 0.4, 25)  # probabilities of a loss that are tested
UNEVEN = np.array([0.0002, 0.0005, 0.001, 0.002, 0.004])  # s by which constant delays may appear to differ
OUTLIERS = np.array([0.001, 0.003, 0.01, 0.03])  # shares of commands that are outliers
OUTLYING = 0.05  # s, standard deviation of outliers
# Prior standard deviation of the other commands' delays, as a share of the period. More hides jitter; with less, the
# neighbours of a delayed command appear lost.
UNSURE_OF_LOSS, UNSURE_OF_JITTER = 0.25, 0.1
CLEAR = 1.0  # required ratio of the squared delay sought to its variance, for a command to count
FEWEST_CLEAR = 10  # commands that must count
PARTS = 8  # of the commands that count
PAUSE = 1.5  # times the period between two commands that indicates a delayed sender
SHARED = 2.0  # times its deviation that a share may differ: neighbours depend on the same readings (8 simulated drives)
LEAST = 1e-3  # 1/s^2; a delay with less information counts as unknown
SIDES = ("psi_left", "psi_right")
SMALLEST_BLOCK = 32  # of a banded matrix processed block by block
AGES = 200  # at which the age of the command in force is computed
MOST_OVERTAKEN = 100.0  # times the apparent delay: no jitter is larger
CLOSE = 1e-13  # of the largest delay: tolerance of the solution
DELAY, LAG = "command_delay", "electrical_lag"
MEANS = (DELAY, LAG)  # whose parameter is a mean delay [s]
JITTER, LOSS = "command_jitter", "command_loss"


@dataclass(frozen=True)
class Loss:
    """The share of commands that take effect only with the next one, and its standard deviation.

    `drop` is its reduction of -2 log-likelihood, `lost` says which commands of all segments were lost.
    """

    share: float
    std: float
    drop: float
    lost: Mask


@dataclass(frozen=True)
class Timing:
    """Information on the delay of each command from the errors of a fit, relative to the fit's mean delay.

    Normal matrix, upper banded (bands, n), and right side (n,) of the delays [s]; `gaps` [s], (n,), until the next
    command, `splits` the number of each segment's first. `period` [s] is the usual time between commands.
    """

    banded: Floats
    right: Floats
    gaps: Floats
    splits: tuple[int, ...]
    period: float

    def loss(self) -> Loss | None:
        """Return the loss that explains the delays best; None with too little information."""
        late, variance = self._alone((UNSURE_OF_LOSS * self.period) ** 2)
        clear = self._steady & (self.gaps**2 > CLEAR * variance)
        if np.count_nonzero(clear) < FEWEST_CLEAR:
            return None
        late, variance, gaps = late[clear] - np.median(late[clear]), variance[clear], self.gaps[clear]
        _, _, steady = _best([_normal(late, variance + size**2) for size in UNEVEN], late, variance)
        laws, shares = [], []
        for size in UNEVEN:
            there, lost = (_normal(late - of, variance + size**2) for of in (0.0, gaps))
            laws += [(1.0 - share) * there + share * lost for share in LOSSES]
            shares += [(share, there, lost) for share in LOSSES]
        _, law, density = _best(laws, late, variance)
        share, there, lost = shares[law]
        std = SHARED / float(np.sqrt(np.sum(((lost - there) / density) ** 2)))
        which = np.zeros(len(clear), np.bool_)
        which[clear] = share * lost > 0.5 * density
        return Loss(float(share), std, _throughout(2.0 * np.log(density / steady)), which)

    def jitter(self, size: float) -> float:
        """Return the gain of delays spread evenly over a size [s] over constant ones.

        It is twice a log-likelihood ratio, 0 with too little information.
        """
        from scipy.special import ndtr

        late, variance = self._alone((UNSURE_OF_JITTER * self.period) ** 2)
        clear = size**2 > CLEAR * variance
        if np.count_nonzero(clear) < FEWEST_CLEAR:
            return 0.0
        late, variance = late[clear] - np.median(late[clear]), variance[clear]
        steady, _, _ = _best([_normal(late, variance + uneven**2) for uneven in UNEVEN], late, variance)
        std = np.sqrt(variance + UNEVEN[0] ** 2)
        evenly = (ndtr((late + 0.5 * size) / std) - ndtr((late - 0.5 * size) / std)) / size
        spread, _, _ = _best([evenly], late, variance)
        return 2.0 * (spread - steady)

    def delays(self, size: float) -> tuple[Floats, ...]:
        """Return the most likely delay [s] of each segment's commands if delays are spread over this size [s]."""
        return tuple(np.split(self._solved(size**2 / 12.0)[1], self.splits[1:-1]))

    @property
    def _steady(self) -> Mask:
        """Which commands have no pause before or after them; at a pause, the sender may have been delayed."""
        paused = self.gaps > PAUSE * self.period
        return ~(paused | np.roll(paused, 1))

    def _alone(self, variance: float) -> tuple[Floats, Floats]:
        """Return the delay [s] of each command and its variance from the errors, with this prior variance for the
        others.
        """
        factor, solved = self._solved(variance)
        precision = np.maximum(1.0 / _inverse_diagonal(factor) - 1.0 / variance, LEAST)
        return solved * (1.0 + 1.0 / (variance * precision)), 1.0 / precision

    def _solved(self, variance: float) -> tuple[Floats, Floats]:
        """Return the Cholesky factor of the delays' precision, banded, and their most likely values."""
        from scipy.linalg import cho_solve_banded, cholesky_banded

        damped = self.banded.copy()
        damped[-1] += 1.0 / variance
        factor = cholesky_banded(damped)
        return factor, cho_solve_banded((factor, False), self.right)


def timing_of(problem: Problem, fit: Fit, *, until_next: bool = False) -> Timing | None:
    """Return the information on delays of commands beside a fit; None if there is none.

    Delays are assumed to be short, so that the duty of a late command is an impulse, or with `until_next` to last until
    the next command.
    """
    commanded = [len(predictor.segment.observations.commands.time) > 1 for predictor in problem.predictors]
    if not all(commanded) or not any(SIDES[0] in predictor.times for predictor in problem.predictors):
        return None
    moments = (np.arange(IMPULSES) + 0.5) / IMPULSES if until_next else np.zeros(1)
    return _timing(problem, fit, problem.joint_errors(fit.values), moments)


def _normal(late: Floats, variance: Floats) -> Floats:
    """Return the density of a normal distribution about 0."""
    return np.asarray(np.exp(-0.5 * late**2 / variance) / np.sqrt(2.0 * np.pi * variance))


def _throughout(drops: Floats) -> float:
    """Return the sum of the drops of commands in order of time, scaled up from all parts but the one with most of it.

    A computer overloaded for some seconds causes a burst of late commands, whereas loss occurs throughout.
    """
    parts = [float(part.sum()) for part in np.array_split(drops, PARTS)]
    return (sum(parts) - max(parts)) * PARTS / (PARTS - 1)


def _best(laws: Sequence[Floats], late: Floats, variance: Floats) -> tuple[float, int, Floats]:
    """Return the largest log-likelihood of several densities with outliers, its index, and that mixture."""
    outlying = _normal(late, variance + OUTLYING**2)
    # Densities of errors beyond any outlier round to 0.
    tiny = np.finfo(np.float64).tiny
    mixed = [np.maximum((1.0 - share) * law + share * outlying, tiny) for law in laws for share in OUTLIERS]
    likelihoods = [float(np.sum(np.log(density))) for density in mixed]
    best = int(np.argmax(likelihoods))
    return likelihoods[best], best // len(OUTLIERS), mixed[best]


def period_of(problem: Problem) -> float:
    """Return the usual time [s] from one command to the next."""
    return float(np.median(np.concatenate([np.diff(p.segment.observations.commands.time) for p in problem.predictors])))


def largest_delay(mean: float, period: float) -> float:
    """Return the largest of evenly spread delays [s] of commands, one each `period` [s], that seem `mean` [s] late.

    The mean is half of the largest while that is shorter than the period; beyond, newer commands overtake older ones.
    """

    def missing(largest: float) -> float:
        return _seeming_delay(largest, period) - mean

    if 2.0 * mean <= period or missing(2.0 * mean) >= 0.0:
        return 2.0 * mean
    # SciPy's `brentq` needs fewer steps, but importing it takes a tenth of the time of a calibration.
    low, high = 2.0 * mean, MOST_OVERTAKEN * mean
    while high - low > CLOSE * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if missing(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


def _seeming_delay(largest: float, period: float) -> float:
    """Return the mean additional age of the command in force due to delays, with all newer ones delayed."""
    age = (np.arange(AGES) + 0.5) / AGES * period  # of the newest command; others are whole periods older
    late, older = np.clip(1.0 - age / largest, 0.0, 1.0), 0.0
    while np.any(late > 0.0):
        older += period * float(np.mean(late))
        age = age + period
        late = late * np.clip(1.0 - age / largest, 0.0, 1.0)
    return older


def effective_size(largest: float, period: float) -> float:
    """Return the size [s] of a uniform distribution with the spread of the effective delays.

    Delays are uniform up to `largest` [s], but a command overtaken by a newer one has no effect.
    """
    if largest <= 0.0:
        return 0.0
    times = (np.arange(20 * AGES) + 0.5) / (20 * AGES) * largest
    later = np.ones(len(times))  # probability that none has come by then
    for number in range(int(largest / period) + 1):
        later *= np.clip(1.0 - (times - number * period) / largest, 0.0, 1.0)
    step = times[1] - times[0]
    mean, square = float(np.sum(later) * step), float(np.sum(2.0 * times * later) * step)
    return float(np.sqrt(12.0 * max(square - mean**2, 0.0)))


def without_jitter(problem: Problem, delays: Sequence[Floats], mean: float) -> Problem:
    """Return the problem with commands shifted to their apparent times of effect; `mean` [s] is their mean delay."""
    return _taken(problem, [np.maximum(mean + of, 0.0) for of in delays])


def without_loss(problem: Problem, timing: Timing, loss: Loss) -> Problem:
    """Return the problem with apparently lost commands merged into the next one."""
    return _taken(problem, np.split(np.where(loss.lost, timing.gaps, 0.0), timing.splits[1:-1]))


def _taken(problem: Problem, delays: Sequence[Floats]) -> Problem:
    predictors = []
    for predictor, late in zip(problem.predictors, delays, strict=True):
        time = predictor.segment.observations.commands.time + late
        # A command that arrives after a newer one has no effect.
        predictors.append(Predictor(predictor.segment.with_commands_at(np.minimum.accumulate(time[::-1])[::-1])))
    return Problem(predictors, problem.gains, problem.excitation)


def _timing(problem: Problem, fit: Fit, errors: Errors, moments: Floats) -> Timing:
    """Return the information on delays; the duty of a late command acts at some `moments`, shares of the time until the
    next command, or of PAUSE periods, if that is longer.
    """
    from scipy.sparse import csr_matrix

    white = fit.noise.all_white(problem.batch, errors)[:, 0]
    begins = {name: problem.batch.white_rows(name) for name in SIDES}
    entries, gaps, splits, period = [], [], [0], period_of(problem)
    mean = sum(fit.values.get(name, 0.0) for name in MEANS)  # given ones, too
    for number, predictor in enumerate(problem.predictors):
        commands = predictor.segment.observations.commands
        changes = np.diff(commands.duty, axis=0, prepend=commands.duty[:1])
        gaps.append(np.diff(commands.time, append=commands.time[-1:]))
        for side, name in enumerate(SIDES):
            response = _response(fit, problem, fit.noise, name, number, predictor)
            for moment in moments:
                packets = commands.time + mean + moment * np.minimum(gaps[-1], PAUSE * period)
                values, rows, columns = _design(packets, -changes[:, side], predictor.times[name], response)
                entries.append((values / len(moments), rows + begins[name][number].start, columns + splits[-1]))
        splits.append(splits[-1] + len(commands.time))
    values, rows, columns = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    design = csr_matrix((values, (rows, columns)), shape=(len(white), splits[-1]))
    return Timing(_banded(design.T @ design), design.T @ white, np.concatenate(gaps), tuple(splits), period)


def _response(
    fit: Fit, problem: Problem, noise: Noise, name: str, number: int, predictor: Predictor
) -> tuple[float, Floats, Floats]:
    """Return the period [s] of a wheel's readings, and the response of its white errors to an impulse of duty of one
    second.

    The third value is the size of the errors, shape (n,), by which the second must still be divided.
    """
    period = float(np.median(np.diff(predictor.segment.observations.wheel_time)))
    count = int(REACH / period)
    rate = fit.values["k1"] * fit.values["k2_over_k3"]
    kept = np.exp(-rate * period)
    # An impulse of duty at time 0: a jump of the speed. The observer, unaware of it, follows the angle.
    speed, angle, raw = fit.values["k2_over_k3"], 0.0, np.zeros(count)
    for index in range(1, count):
        angle += speed * (1.0 - kept) / rate
        speed *= kept
        raw[index] = angle
        speed -= problem.gains.psi * angle
        angle -= problem.gains.angle * angle
    past, spans = noise.of[name].past, noise.of[name].spans(name)
    borders = np.concatenate([[0], np.cumsum(spans)])
    weights = np.concatenate([[1.0], -np.repeat(past, np.diff(borders))])
    return period, np.convolve(raw, weights)[:count], noise.of[name].sizes[number]


def _design(
    packets: Floats, changes: Floats, times: Floats, response: tuple[float, Floats, Floats]
) -> tuple[Floats, Indices, Indices]:
    """Return the design matrix, white errors per second of command delay: values, row and column indices."""
    period, trace, sizes = response
    count = len(trace)
    matters = np.flatnonzero(np.abs(changes) > LEAST_CHANGE)
    first = np.searchsorted(times, packets[matters])
    rows = first[:, None] + np.arange(count)[None]
    inside = rows < len(times)
    rows = np.minimum(rows, len(times) - 1)
    lag = times[rows] - packets[matters][:, None]
    inside &= lag < REACH - period
    values = np.interp(lag, np.arange(count) * period, trace) * changes[matters][:, None] / sizes[rows]
    columns = np.broadcast_to(matters[:, None], rows.shape)
    return values[inside], rows[inside], columns[inside]


def _banded(normal: "csr_matrix") -> Floats:
    """Return a symmetric sparse matrix in the upper banded form of LAPACK."""
    matrix = normal.tocoo()
    above = matrix.col >= matrix.row
    rows, columns = matrix.row[above], matrix.col[above]
    bands = int(np.max(columns - rows, initial=0))
    result = np.zeros((bands + 1, normal.shape[0]))
    np.add.at(result, (bands - (columns - rows), columns), matrix.data[above])
    return result


def _inverse_diagonal(factor: Floats) -> Floats:
    """Return the diagonal of the inverse of a matrix whose Cholesky factor is given, in the upper banded form.

    Only the diagonal blocks of the inverse are computed (Takahashi, Fagan and Chen, 1973).
    """
    from scipy.linalg import solve_triangular

    bands, size = len(factor) - 1, factor.shape[1]
    width = max(bands, SMALLEST_BLOCK)  # no row of the factor reaches beyond the next block
    beyond, result = np.empty((0, 0)), np.empty(size)
    for first in range((size - 1) // width * width, -1, -width):
        rows = np.arange(first, min(first + width, size))[:, None]
        columns = np.arange(first, min(first + 2 * width, size))[None]
        inside = (columns >= rows) & (columns <= rows + bands)
        block = np.where(inside, factor[np.where(inside, bands - columns + rows, 0), columns], 0.0)
        own = solve_triangular(block[:, : len(rows)], np.eye(len(rows)))
        beside = own @ block[:, len(rows) :]
        beyond = own @ own.T + beside @ beyond @ beside.T
        result[first : first + width] = np.diag(beyond)
    return result
