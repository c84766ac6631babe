"""Prediction errors of candidate parameters, signal by signal, and made white: independent and of size one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cmr.estimation.segments import Segment
from cmr.model.observer import RESTART, Gains, Observer
from cmr.recordings.signal import Floats

SIGNALS = ("psi_left", "psi_right", "yaw_rate", "forward", "sideways", "heading")
WHEELS, POSE_SIGNALS = SIGNALS[:2], SIGNALS[3:]
FREE = Gains(0.0, 0.0, 0.0, 0.0)  # nothing is followed


@dataclass(frozen=True)
class Errors:
    """Prediction errors of C candidates in one segment, shape (n, C) by signal, and how the first of them moved.

    `motion` has shape (T + 1, columns of the observer's MOTION); `followed` is how far the sensors were followed.
    """

    of: Mapping[str, Floats]
    motion: Floats
    followed: Gains = FREE


class Predictor:
    """Foretells a recorded segment, sample by sample, with many candidate parameters at once."""

    def __init__(self, segment: Segment) -> None:
        self.segment = segment
        observations = segment.observations
        used = {"psi_left": observations.wheel_use[:, 0] > 0, "psi_right": observations.wheel_use[:, 1] > 0}
        self._wheels_foretold = len(observations.given) == 0
        self._used = used
        self._rests_on = {
            name: 1 + np.flatnonzero(np.diff(observations.wheel[used[name], side]) == 0.0)
            for side, name in enumerate(WHEELS)
        }
        self._restarts = observations.pose_use == RESTART
        self._cosine, self._sine = np.cos(observations.pose[:, 2])[:, None], np.sin(observations.pose[:, 2])[:, None]

    @cached_property
    def times(self) -> dict[str, Floats]:
        """When each error arises [s since the segment's beginning], by signal, shape (n,)."""
        observations = self.segment.observations
        times = {"yaw_rate": observations.gyro_time, **dict.fromkeys(POSE_SIGNALS, observations.pose_time)}
        if self._wheels_foretold:
            times |= {name: observations.wheel_time[used] for name, used in self._used.items()}
        return {name: times[name] for name in SIGNALS if name in times and len(times[name])}

    @cached_property
    def doubt(self) -> dict[str, Floats]:
        """Standard deviation [rad] that the encoder's ticks leave of each of its errors, (n,); of other signals 0."""
        columns = {"psi_left": 0, "psi_right": 1}
        return {
            name: self.segment.wheel_doubt[self._used[name], columns[name]] if name in columns else np.zeros(len(times))
            for name, times in self.times.items()
        }

    def errors(self, values: Mapping[str, Any], gains: Gains, **luck: Any) -> Errors:
        """Return the prediction errors; `values` by name are numbers or arrays (C,), `luck` is as in `observe`."""
        return self.errors_of(Observer(values, gains), **luck)

    def errors_of(self, observer: Observer, **luck: Any) -> Errors:
        """Return the prediction errors of an observer's candidates; `luck` is as in `observe`."""
        innovations = observer.observe(self.segment.observations, **luck)
        east, north = innovations.pose[:, 0], innovations.pose[:, 1]
        with np.errstate(invalid="ignore"):  # a candidate that makes no sense may lose its way altogether
            forward, sideways = self._cosine * east + self._sine * north, self._cosine * north - self._sine * east
        of = {
            "psi_left": innovations.wheel[self._used["psi_left"], 0],
            "psi_right": innovations.wheel[self._used["psi_right"], 1],
            "yaw_rate": innovations.gyro,
            "forward": forward,
            "sideways": sideways,
            "heading": innovations.pose[:, 2],
        }
        for name in POSE_SIGNALS:
            of[name][self._restarts] = 0.0  # there was nothing to foretell such a pose from
        return Errors({name: of[name] for name in self.times}, innovations.motion)

    def told_once(self, errors: Errors, gains: Gains) -> Errors:
        """Return the errors, counting the position of a resting wheel once.

        All readings during one rest repeat the same position. With these gains, the observer corrects a part of the
        error at each reading, so the rest of it appears in the next one's. That part is subtracted there: what remains
        is the motion that the model predicted since the reading before.
        """
        of = dict(errors.of)
        for name, again in self._rests_on.items():
            if name in of and len(again):
                of[name] = of[name].copy()
                of[name][again] -= (1.0 - gains.angle) * errors.of[name][again - 1]
        return replace(errors, of=of, followed=gains)

    def motion_at(self, motion: Floats, signal: str) -> Floats:
        """Return how the robot moved when each error of a signal arose, shape (n, columns of MOTION)."""
        index = np.minimum(
            np.round(self.times[signal] / self.segment.observations.dt).astype(np.int64), len(motion) - 1
        )
        return np.asarray(motion[index], np.float64)


def predictors(segments: Sequence[Segment]) -> list[Predictor]:
    """Return a predictor for each segment."""
    return [Predictor(segment) for segment in segments]
