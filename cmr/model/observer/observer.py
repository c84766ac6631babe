"""The model as an observer: it simulates the recorded commands and is corrected by the sensors.

The prediction error (innovation) is a reading minus its prediction just before. Errors of free runs accumulate along
the drive; prediction errors do not, and each refers to its own time. With the gains of a Kalman filter they are as
independent as the noise (Ljung, System Identification, 2nd ed., 1999, chapters 4 and 7).

All effects are included, also those of sensors: the observer corrects its state by the predicted readings with effects.
Many candidate parameters are observed at once, one per lane.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.model.catalogue import CATALOGUE, DEFINITIONS, needed
from cmr.model.command_kinds import DUTY
from cmr.model.commands import Commands, fixed_delays
from cmr.model.extended.compose import COEFFICIENTS_END, DT, LANES
from cmr.model.extended.evaluating import mean_radii, slip_time
from cmr.model.extended.model import START, Candidates, aligned, model_of
from cmr.model.extended.statements import SIDES, memories
from cmr.model.extended.step_statements import CHANGED
from cmr.model.observer import loops
from cmr.model.observer.commanding import split_steps
from cmr.model.observer.drives import Drives
from cmr.model.observer.helpers import GAIN_ANGLE, PAST_ROWS
from cmr.model.observer.sensor_effects import Sensing, parameters_read, sensing, sensor_laws
from cmr.model.observer.structures import Buffers, CandidateRows, CommandRows, Indices, Innovations, Model
from cmr.model.parameters import Quantity

Floats = NDArray[np.float64]
MOTION = (*CHANGED[:9], "yaw_rate")  # columns of the observed motion
LONGEST_LATENCY = 1.2  # s of history
RESTART = 0  # in `pose_use`: the observer restarts at this pose
FOLLOWED = 1
DEAD_MOTOR = {"k2_over_k3": 1e-2, "k1": 1e-5}  # neither drives nor slows down, for given wheel speeds


@dataclass(frozen=True)
class Observations:
    """Commands and sensor readings, on a time grid of `steps` of `dt` [s] from time 0 on.

    Without recorded `commands`, `given` [rad/s], shape (steps, 2), are the measured wheel speeds as input; otherwise it
    is empty. `wheel` [rad], shape (W, 2), are the encoders' angles at `wheel_time` [s], `wheel_use` whether each is
    used; `gyro` [rad/s], and `pose` [m, m, rad] of shape (P, 3), likewise; `pose_use` is FOLLOWED or RESTART. `start`
    is x, y, theta, psi_left, psi_right at time 0, which is `time` [s] after the drive began; `turned` [rad] are the
    wheel rotations by then, left and right. All times of readings ascend and lie within the grid. `kind`, of
    cmr.model.command_kinds, is the kind of command that the duties of `commands` represent.
    """

    dt: float
    steps: int
    commands: Commands
    start: tuple[float, float, float, float, float]
    wheel_time: Floats
    wheel: Floats
    wheel_use: NDArray[np.uint8]
    gyro_time: Floats
    gyro: Floats
    pose_time: Floats
    pose: Floats
    pose_use: NDArray[np.uint8]
    given: Floats = field(default_factory=lambda: np.empty((0, 2)))
    time: float = 0.0
    kind: str = DUTY
    turned: tuple[float, float] = (0.0, 0.0)

    @property
    def seconds(self) -> float:
        """Its duration [s]."""
        return self.steps * self.dt

    @cached_property
    def duty(self) -> Floats:
        """The mean commands of each step, shape (steps, 2): left, right; 0 before the first."""
        profile = np.nan_to_num(self.commands.profile(self.dt, self.steps))
        split = profile[:, :1]
        return split * profile[:, 1:3] + (1.0 - split) * profile[:, 3:5]


class Gains(NamedTuple):
    """The observer gains: shares of an error, and for the speed 1/s; numbers or one per lane."""

    angle: Quantity
    psi: Quantity
    position: Quantity
    theta: Quantity


def observe(
    observations: Observations,
    values: Mapping[str, Quantity],
    gains: Gains,
    *,
    seed: int = 0,
    streams: NDArray[np.int64] | None = None,
) -> Innovations:
    """Observe a drive with C candidates.

    `values` maps names of parameters, the paper's and those of effects, to numbers or arrays (C,). `seed` and `streams`
    (C,) determine random numbers. Raises KeyError for an unknown parameter.
    """
    return Observer(values, gains).observe(observations, seed=seed, streams=streams)


class Observer:
    """C candidates and their gains, prepared to observe many drives; arguments as in `observe`."""

    def __init__(self, values: Mapping[str, Quantity], gains: Gains) -> None:
        self._count = max(int(np.size(value)) for value in (*values.values(), *gains))
        unknown = sorted(set(values) - set(DEFINITIONS))
        if unknown:
            raise KeyError(f"unknown parameters {', '.join(unknown)}")
        self._values = {name: self._each(value) for name, value in values.items()}
        self._model = model_of(values)
        lanes = np.minimum(np.arange(-(-self._count // LANES) * LANES), self._count - 1)  # leftovers repeat the last
        self._lanes = lanes
        self._laws = sensor_laws(needed(CATALOGUE, values))
        neutral = {name: DEFINITIONS[name].neutral or 0.0 for name in parameters_read(self._laws)}
        sensors = (self._values.get(name, usual) for name, usual in neutral.items())
        wheels = (*_encoder_scales(self._values, self._count), *mean_radii(self._values), slip_time(self._values))
        given = (*gains, *wheels, *sensors)  # as the rows from GAIN_ANGLE on
        self._numbers = np.stack([self._each(row)[lanes] for row in given])

    def observe(
        self, observations: Observations, *, seed: int = 0, streams: NDArray[np.int64] | None = None
    ) -> Innovations:
        """Observe a drive; see `observe`."""
        return self.observe_all(Drives.of([observations]), seed=seed, streams=streams)

    def observe_each(self, observations: Sequence[Observations], continued: Sequence[bool]) -> list[Innovations]:
        """Observe several drives, with or without commands; `continued` is that of `Drives`."""
        result: list[Innovations] = []
        for _, numbers in groupby(range(len(observations)), lambda number: len(observations[number].given) > 0):
            group = list(numbers)
            drives = Drives.of([observations[k] for k in group], [continued[k] for k in group])
            result += _split(self.observe_all(drives), drives)
        return result

    def observe_all(self, drives: Drives, *, seed: int = 0, streams: NDArray[np.int64] | None = None) -> Innovations:
        """Observe several drives; what comes back has the rows of each, one drive after another.

        Either all drives have commands or none has. Each has the same `seed` and `streams`; see `observe`.
        """
        count = self._count
        candidates = self._rolling if len(drives.recorded.readings.given) else self._driven
        commands, profile, streams = self._commands(drives, seed, streams)
        at_rest, robots = candidates.rows.copy(), candidates.begun(np.zeros((len(START), count)), 0.0).arguments
        candidate_rows = CandidateRows(robots, at_rest, self._numbers, profile, streams)
        result, model, compiled = _to_fill(drives, count), self._compiled_model, loops.observe

        def observe_blocks(first: int, last: int) -> None:
            rows = candidate_rows._replace(robots=robots._replace(work=_aligned_copy(robots.work)))
            buffers, end = _buffers(len(self._numbers), _history(drives.dt), commands.ring), min(last * LANES, count)
            compiled(model, rows, commands, drives.recorded, buffers, result, drives.dt, first, end)

        count_of_blocks = len(self._lanes) // LANES
        if getattr(compiled, "unloaded", False):  # one thread loads it, or compiles it
            observe_blocks(0, count_of_blocks)
        else:
            in_two_threads(observe_blocks, count_of_blocks)
        return result

    def _commands(self, drives: Drives, seed: int, streams: Indices | None) -> tuple[CommandRows, Indices, Indices]:
        """Return the commands of the drives, and for each lane the number of its profile, and its random stream."""
        delays, chosen, ring = fixed_delays(self._values), np.zeros(len(self._lanes), np.int64), 0
        if delays is None:
            longest = int(np.max(np.diff(drives.recorded.ends.steps)))
            ring = self._model.packets_under_way(self._values, np.full(longest, drives.dt))
            chosen = chosen if streams is None else np.asarray(streams, np.int64)[self._lanes]
            delays = np.zeros(1)
        delays, which = np.unique(np.broadcast_to(delays, self._count), return_inverse=True)
        profiles = np.stack([drives.profile(float(delay)) for delay in delays])
        commands = CommandRows(profiles, split_steps(profiles, drives.dt), ring, seed)
        return commands, np.ascontiguousarray(which.ravel()[self._lanes]), chosen

    @cached_property
    def _sensing(self) -> Sensing:
        return sensing(self._laws)

    @cached_property
    def _compiled_model(self) -> Model:
        model = self._model
        lasting = np.array([LANES * model.row[name] for name in memories(model.effects, lasting=True)], np.int64)
        return Model(model.equations, model.layout, lasting, self._sensing.sensors)

    @cached_property
    def _driven(self) -> Candidates:
        """The candidates, driven by their commands."""
        return self._candidates(self._values)

    @cached_property
    def _rolling(self) -> Candidates:
        """The candidates, whose wheels are turned at given speeds."""
        return self._candidates(self._values | {name: self._each(value) for name, value in DEAD_MOTOR.items()})

    def _candidates(self, values: Mapping[str, Floats]) -> Candidates:
        known = self._model.definitions
        return Candidates(self._model, {n: v for n, v in values.items() if n in known}, self._count)

    def _each(self, value: Quantity) -> Floats:
        """Return a number, or one for each candidate, as an array (C,)."""
        return np.broadcast_to(np.asarray(value, np.float64), self._count)


def in_two_threads(work: Callable[[int, int], None], count: int) -> None:
    """Do `work` on the numbers below `count`, from a first to a last one, which is not included: by halves at once.

    It must let other threads run, as compiled code does. With a single processor, or number, it is done in one go.
    """
    middle = (count + 1) // 2
    if middle == count or len(os.sched_getaffinity(0)) == 1:
        work(0, count)
        return
    with ThreadPoolExecutor(1) as other:
        second = other.submit(work, middle, count)
        work(0, middle)
        second.result()


def _to_fill(drives: Drives, count: int) -> Innovations:
    """Return arrays for the innovations of `count` candidates on these drives."""
    readings = drives.recorded.readings
    return Innovations(
        np.empty((len(readings.wheel_time), 2, count)),
        np.empty((len(readings.gyro_time), count)),
        np.empty((len(readings.pose_time), 3, count)),
        np.empty((drives.steps + len(drives.recorded.start), len(MOTION))),
    )


def _buffers(given_rows: int, history: int, ring: int) -> Buffers:
    """Return buffers for one thread, which looks back `history` steps and has so many `given_rows` of candidates."""
    whole, before, behind = np.empty((3, COEFFICIENTS_END - DT))
    return Buffers(
        own=aligned(GAIN_ANGLE + LANES * given_rows),
        past=aligned(history * PAST_ROWS).reshape(history, PAST_ROWS),
        whole=whole,
        before=before,
        behind=behind,
        duty=np.empty((2, LANES)),
        packets=np.empty(ring * 3 * LANES),
    )


def _aligned_copy(numbers: Floats) -> Floats:
    """Return a copy that begins where a line of a processor's cache does, as `numbers` do."""
    copy = aligned(len(numbers))
    copy[:] = numbers
    return copy


def _split(innovations: Innovations, drives: Drives) -> list[Innovations]:
    """Return the innovations of each drive."""
    ends = drives.recorded.ends
    borders = ends.steps + np.arange(len(ends.steps))
    spans = [pairwise(rows.tolist()) for rows in (ends.wheel, ends.gyro, ends.pose, borders)]
    return [
        Innovations(*(rows[first:last] for rows, (first, last) in zip(innovations, of_drive, strict=True)))
        for of_drive in zip(*spans, strict=True)
    ]


def _encoder_scales(values: Mapping[str, Floats], count: int) -> Floats:
    """Return how many radians a wheel turns for one that its encoder tells, shape (2, count): left, right."""
    from cmr.model.sensors import encoder_reading

    known = {name: value for name, value in values.items() if name in parameters_read(())}
    known.pop("encoder_quantisation", None)
    return np.stack([1.0 / encoder_reading(known, side, np.ones(count)) for side in SIDES])


def _history(dt: float) -> int:
    """Return how many steps of `dt` [s] the observer looks back, a power of two, for LONGEST_LATENCY."""
    return 1 << int(np.ceil(np.log2(LONGEST_LATENCY / dt + 3.0)))
