"""Tell by how much one sensor's time stamps lag another's, from how the robot speeds up and turns.

Two sensors that saw the same motion give the same rates of driving and of turning, up to unknown factors and
offsets. Both are averaged over the same short span, correlated over all lags within reach, and the best lag is refined
by least squares, so that it is found to a fraction of a sample.
"""

from dataclasses import dataclass

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.robust import quantile, running_median, spread
from cmr.recordings.signal import SECONDS, Floats, Signal, Times

LEAST_MOTION = 1e-9  # spread of rates, in any unit; less is nothing
ROUNDING = 1e-12  # of sums of squares
FEWEST_SPANS = 4  # of common time
REACH = 2.5  # s; longer lags are not looked for
STEP = 0.04  # s between the moments at which the rates are compared
SPAN = 0.2  # s over which rates are averaged, twice; longer where a sensor is slow
SPARSEST = 1.0  # s for each sample, on average; with fewer samples the time is mostly gaps
ITERATIONS = 3  # of the refinement: it converges quadratically from a step's width
SHORTEST = 3.0  # s of common time
LARGEST_STD = 0.05  # s; a lag that is known less well is called unknown
SMALLEST_STD = 1e-6  # s; time stamps are no finer
LEAST_EVIDENCE = 12.0  # log-likelihood by which the best lag must explain more than no connection at all
RIVAL = 0.4  # s; a lag further away than this from the best must be worse
LEAST_LEAD = 4.0  # log-likelihood by which it must be worse
LONGEST_GAP = 1.0  # s
OUTLYING = 4.0  # standard deviations; larger differences of two rates are left out


@dataclass(frozen=True)
class Lag:
    """By how much `sensor` is stamped later than `reference`; `seconds` and `std` [s] are NaN where unknown."""

    sensor: str
    reference: str
    seconds: float
    std: float
    why_unknown: str = ""

    @classmethod
    def unknown(cls, sensor: str, reference: str, why: str) -> "Lag":
        """Return the lag of which the recording does not tell."""
        return cls(sensor, reference, np.nan, np.nan, why)

    @property
    def known(self) -> bool:
        """Whether the recording tells it."""
        return not self.why_unknown


class IncomparableError(Exception):
    """What two sensors saw cannot be compared; the text says why."""


@dataclass(frozen=True)
class CommonRates:
    """The rates of two sensors, the later named first, at the same moments, `STEP` apart.

    `pairs`, each of two arrays of shape (n,), are the rates of driving, where both tell it, and of turning, in the
    units of each sensor's travel per second, averaged twice over `span` [s]. Lags of up to `shifts` steps can be seen.
    """

    pairs: list[tuple[Floats, Floats]]
    span: float
    shifts: int


@dataclass(frozen=True)
class Travel:
    """How far a robot has driven and turned since the start, in any unit, by one sensor; shape (n,).

    A gyro does not tell how far it has `driven`: None.
    """

    time: Floats
    driven: Floats | None
    turned: Floats


def wheel_travel(wheels: Signal, origin: int) -> Travel:
    """Return the wheels' travel; a speed is the average since the message before."""
    dt = _intervals(np.diff(wheels.utime, prepend=wheels.utime[:1]))
    left, right = wheels["psi_left"], wheels["psi_right"]
    return Travel(_time(wheels, origin), np.cumsum((left + right) * dt), np.cumsum((right - left) * dt))


def command_travel(commands: Signal, origin: int) -> Travel:
    """Return the travel that duties ask for; a duty holds until the next."""
    dt = _intervals(np.diff(commands.utime, append=commands.utime[-1:]))
    left, right = commands["left"], commands["right"]
    driven, turned = (np.append(0.0, np.cumsum(rate * dt))[:-1] for rate in (left + right, right - left))
    return Travel(_time(commands, origin), driven, turned)


def gyro_travel(gyro: Signal, origin: int) -> Travel:
    """Return the gyro's travel: it only turns."""
    rate, dt = gyro["yaw_rate"], _intervals(np.diff(gyro.utime))
    return Travel(_time(gyro, origin), None, np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * dt)))


def pose_travel(poses: Signal, origin: int) -> Travel:
    """Return the travel along the measured path, forward where the heading points."""
    theta = running_median(np.unwrap(poses["theta"]), 2)
    x, y = (running_median(poses[name], 2) for name in ("x", "y"))
    middle = 0.5 * (theta[1:] + theta[:-1])
    steps = np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle), np.diff(theta)
    together = _intervals(np.diff(poses.utime)) > 0.0
    driven, turned = (np.append(0.0, np.cumsum(np.where(together, step, 0.0))) for step in steps)
    return Travel(_time(poses, origin), driven, turned)


def lags_of(recording: Recording) -> list[Lag]:
    """Return by how much poses lag the wheels, the gyro the wheels, and the wheels the commands (motor included).

    Without wheels, poses and gyro are compared with the commands. Pairs of which one was not recorded are left out.
    """
    reference = "wheels" if len(recording.wheels) > 1 else "commands"
    pairs = [("poses", reference), ("gyro", reference), ("wheels", "commands")]
    signals = recording.signals
    travels = {"wheels": wheel_travel, "commands": command_travel, "gyro": gyro_travel, "poses": pose_travel}
    present = [pair for pair in pairs if len(signals[pair[0]]) > 1 and len(signals[pair[1]]) > 1]
    names = {name for pair in present for name in pair}
    origin = min((int(signals[name].utime[0]) for name in names), default=0)
    travel = {name: travels[name](signals[name], origin) for name in names}
    return [_lag(sensor, of, travel[sensor], travel[of]) for sensor, of in present]


def common_rates(late: Travel, early: Travel) -> CommonRates:
    """Return the rates at which two sensors saw the robot drive and turn.

    Raises IncomparableError where they have too little in common.
    """
    first, last = max(late.time[0], early.time[0]), min(late.time[-1], early.time[-1])
    if last - first < SHORTEST:
        raise IncomparableError(f"they have less than {SHORTEST:.0f} s in common")
    if last - first > SPARSEST * (len(late.time) + len(early.time)):
        raise IncomparableError("the recording is mostly gaps")
    span = max(SPAN, *(2.5 * float(np.median(np.diff(travel.time))) for travel in (late, early)))
    if last - first < FEWEST_SPANS * span:
        raise IncomparableError("one of them comes too seldom")
    moments = np.arange(first + 0.5 * span, last - 0.5 * span, STEP)
    pairs = [
        (_rates(late.time, a, moments, span), _rates(early.time, b, moments, span))
        for a, b in ((late.driven, early.driven), (late.turned, early.turned))
        if a is not None and b is not None
    ]
    pairs = [pair for pair in pairs if min(float(np.std(rates)) for rates in pair) > LEAST_MOTION]
    if not pairs:
        raise IncomparableError("nothing moves in one of them")
    return CommonRates(pairs, span, int(min(REACH, 0.25 * (last - first)) / STEP))


def _lag(sensor: str, reference: str, late: Travel, early: Travel) -> Lag:
    """Find the lag of one sensor."""
    try:
        rates = common_rates(late, early)
    except IncomparableError as why:
        return Lag.unknown(sensor, reference, str(why))
    span, shifts = rates.span, rates.shifts
    evidence = np.sum([_evidence(a, b, shifts, span) for a, b in rates.pairs], axis=0)
    best = int(np.argmax(evidence))
    far = np.abs(np.arange(len(evidence)) - best) * STEP > RIVAL
    if evidence[best] < LEAST_EVIDENCE or best in (0, len(evidence) - 1):
        return Lag.unknown(sensor, reference, "their speeds do not change alike")
    if far.any() and evidence[far].max() > evidence[best] - LEAST_LEAD:
        return Lag.unknown(sensor, reference, "several lags fit alike")
    refined = [_refined(a, b, (best - shifts) * STEP, span) for a, b in rates.pairs]
    found = [(lag, max(std, SMALLEST_STD)) for lag, std in refined if std < LARGEST_STD]
    if not found:
        return Lag.unknown(sensor, reference, "the speeds change too little")
    weight = sum(std**-2.0 for _, std in found)
    return Lag(sensor, reference, sum(lag * std**-2.0 for lag, std in found) / weight, weight**-0.5)


def _rates(time: Floats, travel: Floats, moments: Floats, span: float) -> Floats:
    """Return the rate around each moment, averaged twice over `span`; rare absurd ones are cut to the others' size.

    The second averaging makes noise smooth, so that it favours no fraction of a step over another.
    """
    rates = (np.interp(moments + 0.5 * span, time, travel) - np.interp(moments - 0.5 * span, time, travel)) / span
    largest = 1.5 * quantile(np.abs(rates), 0.95)
    half = round(0.5 * span / STEP)
    total = np.cumsum(np.pad(np.clip(rates, -largest, largest), (half + 1, half), mode="edge"))
    return np.asarray(total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


def correlation_of(late: Floats, early: Floats, shifts: int) -> Floats:
    """Return the correlation at each lag of -shifts to shifts steps, shape (2 shifts + 1,)."""
    inner = late[shifts : len(late) - shifts]
    inner = inner - inner.mean()
    size = 1 << int(np.ceil(np.log2(len(early) + len(inner))))
    early = early - early.mean()
    # Entry j of the product is the sum over t of inner[t] early[t + j]: early moved to the right by shifts - j.
    product = np.fft.irfft(np.conj(np.fft.rfft(inner, size)) * np.fft.rfft(early, size), size)[: 2 * shifts + 1]
    sums, squares = (np.cumsum(np.append(0.0, early**power)) for power in (1, 2))
    n = len(inner)
    within = squares[n : n + 2 * shifts + 1] - squares[: 2 * shifts + 1]
    within = within - (sums[n : n + 2 * shifts + 1] - sums[: 2 * shifts + 1]) ** 2 / n
    energy = max(float(inner @ inner), ROUNDING * float(late @ late))
    return np.asarray(product / np.sqrt(np.maximum(within, ROUNDING * squares[-1]) * energy))[::-1]


def _evidence(late: Floats, early: Floats, shifts: int, span: float) -> Floats:
    """Return the log-likelihood of each lag of -shifts to shifts steps over no connection, shape (2 shifts + 1,)."""
    correlation = correlation_of(late, early, shifts)
    independent = (len(late) - 2 * shifts) * STEP / span
    return np.asarray(-0.5 * independent * np.log1p(-np.minimum(correlation**2, 0.9999)) * (correlation > 0.0))


def _refined(late: Floats, early: Floats, lag: float, span: float) -> tuple[float, float]:
    """Return lag and standard deviation [s], refined together with factor and offset of the rates.

    The slope of one sensor's rates is the instrument for the other's: the slopes of coarse encoders are mostly
    noise, and by least squares on them no lag would be seen.
    """
    place = np.arange(len(early), dtype=np.float64)
    slope, slope_late = np.gradient(early, STEP), np.gradient(late, STEP)
    for _ in range(ITERATIONS):
        at = place - lag / STEP
        inside = (at >= 0.0) & (at <= len(early) - 1)
        if np.count_nonzero(inside) < 0.5 * len(early):  # it runs away, or is no number
            return lag, np.inf
        rates, slopes = (np.interp(at[inside], place, values) for values in (early, slope))
        instruments = np.stack([rates, np.ones_like(rates), -slopes])
        design, wanted = np.stack([rates, np.ones_like(rates), -slope_late[inside]]), late[inside]
        residual = wanted - _solver(instruments, design) @ (instruments @ wanted) @ design
        kept = np.abs(residual) <= OUTLYING * max(spread(residual), 0.75 * float(np.std(residual)))
        instruments, design, wanted = instruments[:, kept], design[:, kept], wanted[kept]
        if not instruments[2] @ design[2] > 0.0:
            return lag, np.inf
        solver = _solver(instruments, design)
        solution = solver @ (instruments @ wanted)
        lag += float(solution[2])
    influence = solver[2] @ instruments * (wanted - solution @ design)
    return lag, float(np.sqrt(_long_run_variance(influence, int(2.0 * span / STEP))))


def _solver(instruments: Floats, design: Floats) -> Floats:
    """Return the inverse of the product of instruments and regressors, each of shape (k, n); NaN without one."""
    product = instruments @ design.T
    try:
        return np.asarray(np.linalg.inv(product))
    except np.linalg.LinAlgError:
        return np.full_like(product, np.nan)


def _long_run_variance(influence: Floats, reach: int) -> float:
    """Return the variance of the sum of correlated terms: neighbours up to `reach` count, ever less (Newey-West)."""
    total = float(influence @ influence)
    for k in range(1, min(reach, len(influence) - 1) + 1):
        total += 2.0 * (1.0 - k / (reach + 1)) * float(influence[k:] @ influence[:-k])
    return max(total, 0.0)


def _time(signal: Signal, origin: int) -> Floats:
    return np.asarray((signal.utime - origin) * SECONDS, np.float64)


def _intervals(utime: Times) -> Floats:
    """Return time steps [us] in seconds; 0 for a gap, across which no sensor is said to have moved."""
    return np.where(utime > LONGEST_GAP / SECONDS, 0.0, utime * SECONDS)
