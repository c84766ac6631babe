"""Candidate regressors of unknown disturbances: products of command, motion, position and time.

They are built from the simulated motion, never from a sensor's own sample, whose noise would look like structure.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from cmr.estimation.prediction import Errors, Predictor
from cmr.model.observer.observer import MOTION
from cmr.recordings.signal import Floats

SPACING, FEWEST, MOST = 0.4, 3, 10  # m between the knots of functions of the place; numbers of knots
MOMENTS = 7  # knots of functions of time
RIPPLES = (1, 2, 3, 4, 6, 8)  # in a turn of a wheel
STILL = 0.03  # of the top speed; a robot that is clearly faster moves
FRICTION = (0.02, 0.1)  # of the top speed; where friction may set in
IDLE = 0.01  # duty below which a motor is not driven
MEMORIES = (0.1, 1.0)  # s, time constants of memories of the command
REVERSED = 0.02  # of the top speed, from which a direction counts
SINCE_REVERSAL = ((0.0, 0.15), (0.15, 0.3), (0.3, 0.5), (0.5, 1.0))  # s since a wheel reversed: edges of the terms
SPEEDS = 5  # knots of an encoder's speed-dependent miscount
# Hz at which something on the robot may swing, three to an octave, and how its swings fade, as a share of critical.
SWINGS, FADING = (0.5, 0.63, 0.79, 1.0, 1.26, 1.59, 2.0, 2.52, 3.17, 4.0), 0.1
FADED = 6.0  # times the time in which an oscillation fades to 1/e, after which it is neglected
NOTHING = 1e-6  # the least range of a quantity
ACCELERATION = "acceleration"  # a regressor

Column = tuple[Mapping[str, float], Floats]
WHEELS = ("left", "right")


@dataclass(frozen=True)
class Drive:
    """The motion in one segment, at the middle of each step, all of shape (T,).

    `duty`, `effort` (the duty left for acceleration), `psi` and `angle` are those of left and right. Speeds are
    shares of the top speeds of the drives, places are in [m], and `dt` [s] is the step.
    """

    time: Floats
    x: Floats
    y: Floats
    theta: Floats
    speed: Floats
    yaw_rate: Floats
    duty: tuple[Floats, Floats]
    effort: tuple[Floats, Floats]
    psi: tuple[Floats, Floats]
    angle: tuple[Floats, Floats]
    dt: float

    @classmethod
    def of(cls, predictor: Predictor, motion: Floats, top: float, k1: float) -> "Drive":
        """Return the drive of a segment with this motion; `top` [rad/s] is its top wheel speed."""
        observations = predictor.segment.observations
        column = dict(zip(MOTION, (0.5 * (motion[1:] + motion[:-1])).T, strict=True))
        psi = column["psi_left"] / top, column["psi_right"] / top
        left, right = observations.duty.T
        return cls(
            time=observations.time + observations.dt * np.arange(observations.steps, dtype=np.float64),
            x=column["x"],
            y=column["y"],
            theta=column["theta"],
            speed=0.5 * (psi[0] + psi[1]),
            yaw_rate=0.5 * (psi[1] - psi[0]),
            duty=(left, right),
            effort=(left - k1 * column["psi_left"], right - k1 * column["psi_right"]),
            psi=psi,
            angle=(column["angle_left"], column["angle_right"]),
            dt=observations.dt,
        )


def drives_of(predictors: Sequence[Predictor], errors: Sequence[Errors], k1: float) -> list[Drive]:
    """Return the motion of the robot, whose back-EMF is `k1` [s/rad], in all segments."""
    wheels = [MOTION.index("psi_left"), MOTION.index("psi_right")]
    top = max(float(np.max(np.abs(error.motion[:, wheels]))) for error in errors)
    return [Drive.of(p, e.motion, max(top, NOTHING), k1) for p, e in zip(predictors, errors, strict=True)]


@dataclass(frozen=True)
class Term:
    """Disturbances with the same regressors.

    `columns` gives, for a drive, the weights and time course (T,) of each. `disturbed` is one of the quantities they
    act on.
    """

    disturbed: str
    regressors: tuple[str, ...]
    columns: Callable[[Drive], list[Column]]


@dataclass(frozen=True)
class Knots:
    """Knots over the range of places [m] and times [s]; none if the drives hardly left a place."""

    x: Floats
    y: Floats
    time: Floats

    @classmethod
    def over(cls, drives: Sequence[Drive]) -> "Knots":
        """Return knots over the range of the drives."""
        x, y = (_spaced(*_reach(drives, name)) for name in ("x", "y"))
        return cls(x, y, np.linspace(*_reach(drives, "time"), MOMENTS))


def terms_for(drives: Sequence[Drive], predicted: bool) -> list[Term]:
    """Return all terms for these drives; those of the wheels only if these are `predicted`."""
    knots = Knots.over(drives)
    longest = max(drives, key=lambda drive: len(drive.time))
    terms = [term for name in ("yaw_rate", "forward", "sideways") for term in _of_motion(name, knots)]
    terms += [term for name in ("gyro", "heading", "east", "north") for term in _of_reading(name, knots)]
    terms = [*_of_wheels(longest), *_of_both_wheels(knots), *_of_encoders(), *terms] if predicted else terms
    return [term for term in terms if term.columns(longest)]


def _of_wheels(longest: Drive) -> list[Term]:
    """Return disturbances of each wheel's acceleration that depend on its own command, speed and angle."""
    commands = ("command_left", "command_right")
    terms = [
        _each(WHEELS, commands, lambda u, _: [np.abs(u), u * u, u * np.abs(u), u**3]),
        _each(WHEELS, ("speed",), _of_speed),
        _each(WHEELS, (*commands, "speed"), lambda u, p: [u * p, np.abs(u) * p, u * np.abs(p)]),
        _each(WHEELS, (*commands, "speed"), lambda u, p: [p * (np.abs(u) < IDLE)]),
        Term("left", ("command_change",), _after_a_change),
        Term("left", ("time_since_reversal",), _after_a_wheels_reversal),
    ]
    return terms + [Term("left", ANGLES, partial(_with_angle, longest, number)) for number in RIPPLES]


def _of_encoders() -> list[Term]:
    """Return disturbances of each encoder's counts."""
    knots = np.linspace(0.0, 1.0, SPEEDS)

    def missed(_: Floats, psi: Floats) -> list[Floats]:
        return [psi * psi, psi**3, *(psi * hat for hat in _hats(np.abs(psi), knots)[1:])]

    return [_each(("left_encoder", "right_encoder"), ("speed",), missed)]


def _of_both_wheels(knots: Knots) -> list[Term]:
    """Return disturbances that push both wheels forward, or turn them against each other."""
    terms = []
    for name, sides in (("forward", {"left": 1.0, "right": 1.0}), ("turning", {"left": -1.0, "right": 1.0})):
        terms += [
            *_with_heading(sides, lambda d: np.ones(len(d.theta)), ("heading",)),
            _one(sides, ("time", "speed"), lambda d: [d.speed * hat for hat in _hats(d.time, knots.time)]),
            _one(sides, ("speed_times_yaw_rate",), lambda d: [*_products(d), *_squares(d.yaw_rate)]),
        ]
        if name == "forward":
            terms += [
                *_with_heading(sides, lambda d: _moving(d.speed), ("heading", "speed")),
                _one(sides, ("x",), lambda d: [_moving(d.speed) * hat for hat in _hats(d.x, knots.x)]),
                _one(sides, ("y",), lambda d: [_moving(d.speed) * hat for hat in _hats(d.y, knots.y)]),
                *(_one(sides, (ACCELERATION,), partial(_swinging, frequency)) for frequency in SWINGS),
            ]
    return terms


def _of_motion(name: str, knots: Knots) -> list[Term]:
    """Return disturbances of one speed of the body."""
    one = {name: 1.0}
    return [
        _one(one, ("speed",), lambda d: [abs(d.speed), d.speed**2, d.speed * abs(d.speed), _moving(d.speed)]),
        _one(one, ("yaw_rate",), _of_turning),
        _one(one, ("speed_times_yaw_rate",), _products),
        _one(one, (ACCELERATION,), _of_acceleration),
        *_with_heading(one, lambda d: _moving(abs(d.speed) + abs(d.yaw_rate)), ("heading",)),
        *_with_heading(one, lambda d: d.speed, ("heading", "speed")),
        _one(one, ("x",), lambda d: [d.speed * hat for hat in _hats(d.x, knots.x)]),
        _one(one, ("y",), lambda d: [d.speed * hat for hat in _hats(d.y, knots.y)]),
        _one(one, ("time", "speed"), lambda d: [d.speed * hat for hat in _hats(d.time, knots.time)]),
        _one(one, ("time", "yaw_rate"), lambda d: [d.yaw_rate * hat for hat in _hats(d.time, knots.time)]),
        _one(one, ("time_since_reversal",), _after_reversal),
    ]


def _of_reading(name: str, knots: Knots) -> list[Term]:
    """Return disturbances of one reading of a sensor alone."""
    one = {name: 1.0}
    terms = [
        *_with_heading(one, lambda d: np.ones(len(d.theta)), ("heading",)),
        _one(one, ("x",), lambda d: _hats(d.x, knots.x)),
        _one(one, ("y",), lambda d: _hats(d.y, knots.y)),
        _one(one, ("time",), lambda d: _hats(d.time, knots.time)),
    ]
    if name in ("gyro", "heading"):
        terms += [
            _one(one, ("speed",), lambda d: [d.speed, abs(d.speed), d.speed * abs(d.speed)]),
            _one(one, ("yaw_rate",), _of_turning),
            _one(one, ("speed_times_yaw_rate",), _products),
            _one(one, (ACCELERATION,), _of_acceleration),
        ]
    return terms


ANGLES = ("wheel_angle_left", "wheel_angle_right")


def _one(sides: Mapping[str, float], regressors: tuple[str, ...], shapes: Callable[[Drive], list[Floats]]) -> Term:
    return Term(next(iter(sides)), regressors, lambda drive: [(sides, shape) for shape in shapes(drive)])


def _each(names: tuple[str, str], regressors: tuple[str, ...], of: Callable[[Floats, Floats], list[Floats]]) -> Term:
    """Return a term with columns of each wheel, which depend on its command and speed."""

    def columns(drive: Drive) -> list[Column]:
        pairs = zip(names, drive.duty, drive.psi, strict=True)
        return [({name: 1.0}, shape) for name, duty, psi in pairs for shape in of(duty, psi)]

    return Term(names[0], regressors, columns)


def _of_speed(_: Floats, psi: Floats) -> list[Floats]:
    size = np.abs(psi)
    return [np.ones(len(psi)), size, psi * size, psi**2, psi**3, *(np.tanh(psi / slow) for slow in FRICTION)]


def _of_turning(drive: Drive) -> list[Floats]:
    turning, size = drive.yaw_rate, np.abs(drive.yaw_rate)
    return [size, turning * size, turning**2, turning**3]


def _of_acceleration(drive: Drive) -> list[Floats]:
    forward, turning = 0.5 * (drive.effort[0] + drive.effort[1]), 0.5 * (drive.effort[1] - drive.effort[0])
    return [forward, np.abs(forward), forward * np.abs(forward), turning, turning * np.abs(turning)]


def _squares(values: Floats) -> list[Floats]:
    return [values**2, values * np.abs(values)]


def _products(drive: Drive) -> list[Floats]:
    speed, turning = drive.speed, drive.yaw_rate
    return [speed * turning, np.abs(speed) * turning, speed * np.abs(turning)]


def _swinging(frequency: float, drive: Drive) -> list[Floats]:
    """Return displacement and speed of an oscillation that the robot's acceleration excites: liquids, hanging loads."""
    rate = 2.0 * np.pi * frequency
    acceleration = np.diff(drive.speed, prepend=drive.speed[:1])
    count = min(len(acceleration), int(FADED / (FADING * rate * drive.dt)) + 1)
    since = drive.dt * np.arange(count)
    swings = [np.exp(-FADING * rate * since) * of(rate * since) for of in (np.sin, np.cos)]
    length = 1 << int(np.ceil(np.log2(len(acceleration) + count)))
    driven = np.fft.rfft(acceleration, length)
    return [np.fft.irfft(driven * np.fft.rfft(of, length), length)[: len(acceleration)] for of in swings]


def _moving(speed: Floats) -> Floats:
    return np.asarray(np.tanh(speed / STILL))


def _with_heading(
    sides: Mapping[str, float], size: Callable[[Drive], Floats], regressors: tuple[str, ...]
) -> list[Term]:
    """Return terms that vary with the heading, and with twice the heading."""

    def waves(times: float, drive: Drive) -> list[Floats]:
        return [size(drive) * np.cos(times * drive.theta), size(drive) * np.sin(times * drive.theta)]

    return [_one(sides, regressors, partial(waves, times)) for times in (1.0, 2.0)]


def _with_angle(longest: Drive, ripples: int, drive: Drive) -> list[Column]:
    """Return ripples with this many periods per wheel revolution, alone and multiplied by the drive.

    Only the longest drive counts, because each drive starts its wheel angle at zero.
    """
    columns: list[Column] = []
    for name, angle, duty in zip(WHEELS, drive.angle, drive.duty, strict=True):
        for wave in (np.cos(ripples * angle), np.sin(ripples * angle)):
            counted = wave if drive is longest else np.zeros(len(wave))
            columns += [({name: 1.0}, counted), ({name: 1.0}, duty * counted)]
    return columns


def _after_a_change(drive: Drive) -> list[Column]:
    """Return the difference between each wheel's command and its mean over some time before."""
    columns: list[Column] = []
    for name, duty in zip(WHEELS, drive.duty, strict=True):
        sums = np.concatenate([[0.0], np.cumsum(duty)])
        index = np.arange(len(duty))
        for memory in MEMORIES:
            first = np.maximum(index + 1 - round(memory / drive.dt), 0)
            ahead = duty - (sums[1:] - sums[first]) / (index + 1 - first)
            columns += [({name: 1.0}, ahead), ({name: 1.0}, np.abs(ahead))]
    return columns


def _after_reversal(drive: Drive) -> list[Floats]:
    """Return spans of time after the robot reversed: alone, with its direction, and to each side in turn."""
    since, number, direction = _reversals(drive.speed, drive.dt)
    spans = [((since >= begin) & (since < end)).astype(np.float64) for begin, end in SINCE_REVERSAL]
    return [span * sense for sense in (1.0, direction, 1.0 - 2.0 * (number % 2)) for span in spans]


def _after_a_wheels_reversal(drive: Drive) -> list[Column]:
    columns: list[Column] = []
    for name, psi in zip(WHEELS, drive.psi, strict=True):
        since, _, direction = _reversals(psi, drive.dt)
        for begin, end in SINCE_REVERSAL:
            columns.append(({name: 1.0}, direction * ((since >= begin) & (since < end))))
    return columns


def _reversals(speed: Floats, dt: float) -> tuple[Floats, Floats, Floats]:
    """Return the time since the speed last changed its sign [s], the number of changes, and its sign; each (T,)."""
    index = np.arange(len(speed))
    latest = np.maximum.accumulate(np.where(np.abs(speed) > REVERSED, index, -1))
    direction = np.where(latest >= 0, np.sign(speed[np.maximum(latest, 0)]), 0.0)
    before = np.concatenate([direction[:1], direction[:-1]])
    reversed_now = (direction != before) & (before != 0.0)
    last = np.maximum.accumulate(np.where(reversed_now, index, -len(index) * 1000))
    return (
        np.asarray((index - last) * dt, np.float64),
        np.cumsum(reversed_now).astype(np.float64),
        np.asarray(direction, np.float64),
    )


def _reach(drives: Sequence[Drive], name: str) -> tuple[float, float]:
    low = min(float(np.min(getattr(drive, name))) for drive in drives)
    return low, max(low + NOTHING, max(float(np.max(getattr(drive, name))) for drive in drives))


def _spaced(low: float, high: float) -> Floats:
    if high - low < SPACING:
        return np.empty(0)
    return np.linspace(low, high, int(np.clip(np.ceil((high - low) / SPACING) + 1.0, FEWEST, MOST)))


def _hats(values: Floats, knots: Floats) -> list[Floats]:
    """Return the weight of each knot for each value: linear between neighbouring knots."""
    if len(knots) == 0:
        return []
    width = knots[1] - knots[0]
    return [np.maximum(0.0, 1.0 - np.abs(values - knot) / width) for knot in knots]
