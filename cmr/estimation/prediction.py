"""Prediction errors of candidate parameters, signal by signal, and whitened: independent with unit variance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from cmr.estimation.segments import Segment, continued
from cmr.model.observer.drives import Drives, ends_of
from cmr.model.observer.observer import RESTART, Gains, Observer
from cmr.model.parameters import Quantity
from cmr.recordings.signal import Floats, Mask

SIGNALS = ("psi_left", "psi_right", "yaw_rate", "forward", "sideways", "heading")
WHEELS, POSE_SIGNALS = SIGNALS[:2], SIGNALS[3:]
Indices = np.typing.NDArray[np.int64]
FREE = Gains(0.0, 0.0, 0.0, 0.0)  # no corrections: a free run


@dataclass(frozen=True)
class Errors:
    """Prediction errors of C candidates in one segment, shape (n, C) by signal, and the motion of the first one.

    `motion` has shape (T + 1, columns of the observer's MOTION); `followed` are the observer gains used.
    """

    of: Mapping[str, Floats]
    motion: Floats
    followed: Gains = FREE


class Predictor:
    """Computes prediction errors of one recorded segment, with their times and reading uncertainties."""

    def __init__(self, segment: Segment) -> None:
        self.segment = segment
        observations = segment.observations
        self.used = {name: observations.wheel_use[:, side] > 0 for side, name in enumerate(WHEELS)}
        self.rests_on = {
            name: 1 + np.flatnonzero(np.diff(observations.wheel[self.used[name], side]) == 0.0)
            for side, name in enumerate(WHEELS)
        }

    @cached_property
    def times(self) -> dict[str, Floats]:
        """The time of each error [s since the segment's beginning], by signal, shape (n,)."""
        observations = self.segment.observations
        times = {"yaw_rate": observations.gyro_time, **dict.fromkeys(POSE_SIGNALS, observations.pose_time)}
        if not len(observations.given):
            times |= {name: observations.wheel_time[used] for name, used in self.used.items()}
        return {name: times[name] for name in SIGNALS if name in times and len(times[name])}

    @cached_property
    def doubt(self) -> dict[str, Floats]:
        """Standard deviation [rad] of each error due to encoder quantisation, (n,); 0 for other signals."""
        columns = {"psi_left": 0, "psi_right": 1}
        return {
            name: self.segment.wheel_doubt[self.used[name], columns[name]] if name in columns else np.zeros(len(times))
            for name, times in self.times.items()
        }

    def errors(self, values: Mapping[str, Quantity], gains: Gains) -> Errors:
        """Return the prediction errors; `values` by name are numbers or arrays (C,)."""
        return Batch([self]).errors(Observer(values, gains))

    def told_once(self, errors: Errors, gains: Gains) -> Errors:
        """Return the errors with each rest of a wheel counted once; see `Batch.told_once`."""
        return _told_once(errors, gains, self.rests_on)

    def motion_at(self, motion: Floats, signal: str) -> Floats:
        """Return the robot's motion at the time of each error of a signal, shape (n, columns of MOTION)."""
        return np.asarray(motion[self.motion_rows(signal)], np.float64)

    def motion_rows(self, signal: str) -> Indices:
        """Return the row of the motion at the time of each error of a signal, (n,)."""
        observations = self.segment.observations
        return np.minimum(np.round(self.times[signal] / observations.dt).astype(np.int64), observations.steps)


class Batch:
    """Segments that are predicted together: one call of the observer, and one error array per signal.

    Rows of a signal stand segment by segment; `ends[name]` (K + 1,) are the ends of each of K segments. White errors,
    of all signals, stand segment by segment and signal by signal: there those of a signal begin at the rows `at[name]`
    (K,), of `rows` in all.
    """

    def __init__(self, predictors: Sequence[Predictor]) -> None:
        self.predictors = tuple(predictors)
        counts = np.array([[len(one.times.get(name, ())) for name in SIGNALS] for one in predictors], np.int64)
        begins = np.cumsum(counts).reshape(counts.shape) - counts
        self.rows = int(counts.sum())
        self.signals = tuple(name for name, count in zip(SIGNALS, counts.sum(axis=0), strict=True) if count)
        self.ends = {name: ends_of(counts[:, SIGNALS.index(name)]) for name in SIGNALS}
        self.at = {name: np.ascontiguousarray(begins[:, SIGNALS.index(name)]) for name in SIGNALS}

    def errors(self, observer: Observer) -> Errors:
        """Return the prediction errors of an observer's candidates in all segments."""
        if len(self._of_one_kind) > 1:
            return self.joined([batch.errors(observer) for batch in self._of_one_kind])
        innovations = observer.observe_all(self._drives)
        east, north = innovations.pose[:, 0], innovations.pose[:, 1]
        with np.errstate(invalid="ignore"):  # an absurd candidate may diverge
            forward, sideways = self._cosine * east + self._sine * north, self._cosine * north - self._sine * east
        of = {"yaw_rate": innovations.gyro, "forward": forward, "sideways": sideways, "heading": innovations.pose[:, 2]}
        for name in POSE_SIGNALS:
            of[name][self._restarts] = 0.0  # earlier errors do not predict such a pose
        for side, name in enumerate(WHEELS):
            of[name] = innovations.wheel[self._used[name], side]
        return Errors({name: of[name] for name in self.signals}, innovations.motion)

    def told_once(self, errors: Errors, gains: Gains) -> Errors:
        """Return the errors, counting the position of a resting wheel once.

        All readings during one rest repeat the same position. With these gains, the observer corrects a part of the
        error at each reading, so the rest of it appears in the next one's. That part is subtracted there: the remainder
        is the motion that the model predicted since the reading before.
        """
        return _told_once(errors, gains, self._rests_on)

    def split(self, errors: Errors) -> list[Errors]:
        """Return the errors of each segment."""
        return [
            replace(
                errors,
                of={name: errors.of[name][self.ends[name][k] : self.ends[name][k + 1]] for name in predictor.times},
                motion=errors.motion[self.borders[k] : self.borders[k + 1]],
            )
            for k, predictor in enumerate(self.predictors)
        ]

    def joined(self, errors: Sequence[Errors]) -> Errors:
        """Concatenate the errors of all segments, or of parts of the batch, to those of one batch."""
        if len(errors) == 1:
            return errors[0]
        of = {name: np.concatenate([one.of[name] for one in errors if name in one.of]) for name in self.signals}
        return replace(errors[0], of=of, motion=np.concatenate([one.motion for one in errors]))

    @cached_property
    def before_poses(self) -> dict[str, Indices]:
        """The end rows, by signal, of the errors before each pose, (poses,)."""
        result = {}
        for name in self.signals:
            rows = [np.empty(0, np.int64)]
            for one, first in zip(self.predictors, self.ends[name], strict=False):
                poses = one.times.get(POSE_SIGNALS[0], np.empty(0))
                rows.append(first + np.searchsorted(one.times.get(name, np.empty(0)), poses, side="right"))
            result[name] = np.concatenate(rows).astype(np.int64)
        return result

    @property
    def dt(self) -> float:
        """The step of the segments' time grid [s]."""
        return self.predictors[0].segment.observations.dt

    @cached_property
    def motion_rows(self) -> dict[str, Indices]:
        """The row of the motion at the time of each error, (n,) by signal."""
        return {
            name: np.concatenate(
                [one.motion_rows(name) + self.borders[k] for k, one in enumerate(self.predictors) if name in one.times]
            )
            for name in self.signals
        }

    def white_rows(self, name: str) -> list[slice]:
        """Return the rows of a signal in the white errors, segment by segment."""
        counts = np.diff(self.ends[name])
        return [slice(int(at), int(at + count)) for at, count in zip(self.at[name], counts, strict=True)]

    @cached_property
    def _of_one_kind(self) -> list["Batch"]:
        """The batch split into segments with and without commands."""
        kinds = [list(group) for _, group in groupby(self.predictors, lambda p: len(p.segment.observations.given) > 0)]
        return [self] if len(kinds) == 1 else [Batch(group) for group in kinds]

    @cached_property
    def borders(self) -> Indices:
        """The ends of each segment's rows of motion, (K + 1,), starting with 0."""
        return ends_of([one.segment.observations.steps + 1 for one in self.predictors])

    @cached_property
    def _drives(self) -> Drives:
        segments = [one.segment for one in self.predictors]
        return Drives.of([one.observations for one in segments], continued(segments))

    @cached_property
    def _used(self) -> dict[str, Mask]:
        return {name: np.concatenate([one.used[name] for one in self.predictors]) for name in WHEELS}

    @cached_property
    def _rests_on(self) -> dict[str, Indices]:
        return {
            name: np.concatenate(
                [one.rests_on[name] + self.ends[name][k] for k, one in enumerate(self.predictors) if name in one.times]
            )
            for name in WHEELS
            if name in self.signals
        }

    @cached_property
    def _restarts(self) -> Mask:
        return np.asarray(self._drives.recorded.readings.pose_use == RESTART)

    @cached_property
    def _cosine(self) -> Floats:
        return np.cos(self._drives.recorded.readings.pose[:, 2])[:, None]

    @cached_property
    def _sine(self) -> Floats:
        return np.sin(self._drives.recorded.readings.pose[:, 2])[:, None]


def errors_of(predictors: Sequence[Predictor], values: Mapping[str, Quantity], gains: Gains) -> list[Errors]:
    """Return the prediction errors in each segment; `values` by name are numbers or arrays (C,)."""
    batch = Batch(predictors)
    return batch.split(batch.errors(Observer(values, gains)))


def _told_once(errors: Errors, gains: Gains, rests_on: Mapping[str, Indices]) -> Errors:
    of = dict(errors.of)
    for name, again in rests_on.items():
        if name in of and len(again):
            of[name] = of[name].copy()
            of[name][again] -= (1.0 - gains.angle) * errors.of[name][again - 1]
    return replace(errors, of=of, followed=gains)


def recorded(predictors: Sequence[Predictor]) -> set[str]:
    """Return which of commands, wheels and gyro some predictors have; wheel speeds may be given without commands."""
    given = [len(predictor.segment.observations.given) > 0 for predictor in predictors]
    read = {name for predictor in predictors for name in predictor.times}
    there = {"commands": not all(given), "wheels": any(given) or read & {*WHEELS}, "gyro": "yaw_rate" in read}
    return {name for name in there if there[name]}


def predictors(segments: Sequence[Segment]) -> list[Predictor]:
    """Return a predictor for each segment."""
    return [Predictor(segment) for segment in segments]
