"""Residuals over possible regressors, for the report.

Regressors come from the simulated motion, never from a sensor's own sample: noise in both would look like structure
(errors in variables).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.result import Residual
from cmr.estimation.free_runs import (
    OVERLAP,
    Averages,
    Indices,
    Values,
    Windows,
    free_runs,
    reading_errors,
    stacked,
    windows_of,
)
from cmr.estimation.prediction import WHEELS
from cmr.estimation.segments import Segment
from cmr.estimation.smoothing import smoothed_poses
from cmr.model.body import forward, wrap
from cmr.model.catalogue import effects_on
from cmr.model.observer.observer import MOTION, Observations
from cmr.model.observer.structures import Innovations
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats

MOST_SAMPLES = 3000  # of a residual
GROWN = 1.0  # s over which pose errors accumulate
AT_THE_END = 0.2  # s over which poses at the end are averaged, because single ones are noisy
UNITS = {**dict.fromkeys((*WHEELS, "yaw_rate"), "rad/s"), "forward": "m", "sideways": "m", "heading": "rad"}
# The command that drives a signal: shares of left and right.
DRIVING = {"psi_left": (1.0, 0.0), "psi_right": (0.0, 1.0), "forward": (0.5, 0.5)}
TURNING = (-1.0, 1.0)
TURN = 2.0 * np.pi
BINS = 12  # of a regressor, each with as many samples
BLOCKS, PARTS = 60, 5  # blocks of time, and the folds they are assigned to


@dataclass(frozen=True)
class Spans:
    """Spans of time from `begin` to `end` [s], (n,), on a grid of `dt` [s] with T steps and T + 1 borders."""

    dt: float
    begin: Floats
    end: Floats

    @property
    def middle(self) -> Floats:
        """The middles of the spans [s]."""
        return 0.5 * (self.begin + self.end)

    @property
    def before(self) -> "Spans":
        """Spans of the same length just before each span, clipped at the start of the grid."""
        begin = np.maximum(2.0 * self.begin - self.end, 0.0)
        return Spans(self.dt, begin, np.maximum(self.begin, begin + self.dt))

    def at_middle(self, column: Floats) -> Floats:
        """Interpolate a column at borders (T + 1,) to the middle of each span."""
        return self._at(self.middle, column)

    def growth(self, column: Floats) -> Floats:
        """Return the growth per second of a column at borders (T + 1,)."""
        return (self._at(self.end, column) - self._at(self.begin, column)) / (self.end - self.begin)

    def mean(self, column: Floats) -> Floats:
        """Return the mean of a column at borders (T + 1,) over each span."""
        return self.mean_of_steps(0.5 * (column[1:] + column[:-1]))

    def mean_of_steps(self, steps: Floats) -> Floats:
        """Return the mean over each span of a quantity that is constant per step (T,)."""
        return self.growth(np.append(0.0, np.cumsum(steps)) * self.dt)

    def _at(self, time: Floats, column: Floats) -> Floats:
        return np.asarray(np.interp(time, np.arange(len(column)) * self.dt, column), np.float64)


class _Sampled(NamedTuple):
    """One signal's errors in a segment, `averages.error` (n, models), and its regressors (n,)."""

    averages: Averages
    regressors: dict[str, Floats]


def residuals_of(
    segments: Sequence[Segment], before: Values, after: Values, given: Values | None = None
) -> tuple[Residual, ...]:
    """Return the residuals of all signals that were recorded, over all segments.

    Speeds are means over SPAN. Pose errors are accumulated over GROWN from the real pose, in the robot's frame.
    `command_change` is the change of the mean command of the signal since the previous span of the same length; for yaw
    rate, sideways position and heading the command is right minus left.
    """
    effects = without_each(after, given or {})
    sampled = _sampled([segment.observations for segment in segments], (after, before, *effects.values()))
    found = [(name, [one[name] for one in sampled if len(one[name].averages.begin)]) for name in UNITS]
    return tuple(_residual(name, parts, list(effects)) for name, parts in found if parts)


def without_each(values: Values, given: Values) -> dict[str, Values]:
    """Return, for each effect that these values switch on, the values with only that effect switched off.

    A known effect is set to its `given` values instead; if unchanged, it is skipped.
    """
    switches = {
        effect.name: {
            one.name: given.get(one.name, one.neutral)
            for one in effect.parameters
            if one.switches and one.neutral is not None
        }
        for effect in effects_on(values)
    }
    without = {name: {**values, **off} for name, off in switches.items()}
    return {name: one for name, one in without.items() if one != values}


def _residual(name: str, parts: Sequence[_Sampled], effects: Sequence[str]) -> Residual:
    error = np.concatenate([part.averages.error for part in parts])
    shown = _spread(len(error), MOST_SAMPLES)
    # Segments with and without commands may be mixed.
    regressors = [key for key in parts[0].regressors if all(key in part.regressors for part in parts)]
    return Residual(
        signal=name,
        unit=UNITS[name],
        before=error[shown, 1],
        after=error[shown, 0],
        regressors={key: np.concatenate([part.regressors[key] for part in parts])[shown] for key in regressors},
        without={effect: error[shown, 2 + number] for number, effect in enumerate(effects)},
    )


def _sampled(observations: Sequence[Observations], models: Sequence[Values]) -> list[dict[str, _Sampled]]:
    """Return the errors of all signals in each segment, in order of time, over the motion of the first model."""
    after, values, alone = models[0], stacked(models), [False] * len(observations)
    smooth = smoothed_poses(observations, after)
    speeds: list[dict[str, _Sampled]] = []
    poses: list[list[dict[str, _Sampled]]] = []
    for phase in range(OVERLAP):
        windows = [windows_of(one, GROWN, phase * GROWN / OVERLAP) for one in observations]
        runs = free_runs(observations, [of.pose for of in windows], smooth, values, alone)
        grown = map(_grown, observations, windows, smooth, runs)
        poses.append([_with_regressors(*one, after) for one in zip(observations, runs, grown, strict=True)])
        if not speeds:
            readings = [reading_errors(*one) for one in zip(observations, runs, strict=True)]
            readings = [{name: one[name] for name in (*WHEELS, "yaw_rate")} for one in readings]
            speeds = [_with_regressors(*one, after) for one in zip(observations, runs, readings, strict=True)]
    both = [{name: _merged([of[name] for of in phases]) for name in phases[0]} for phases in zip(*poses, strict=True)]
    return [of_speeds | of_poses for of_speeds, of_poses in zip(speeds, both, strict=True)]


def _with_regressors(
    observations: Observations, run: Innovations, errors: Mapping[str, Averages], values: Values
) -> dict[str, _Sampled]:
    return {
        name: _Sampled(
            one,
            regressors_of(
                observations, run.motion, values, Spans(observations.dt, one.begin, one.end), DRIVING.get(name, TURNING)
            ),
        )
        for name, one in errors.items()
    }


def _merged(parts: Sequence[_Sampled]) -> _Sampled:
    """Return the samples of all parts in order of time."""
    begin, end, error = (np.concatenate(column) for column in zip(*(part.averages for part in parts), strict=True))
    order = np.argsort(begin, kind="stable")
    names = parts[0].regressors
    regressors = {name: np.concatenate([part.regressors[name] for part in parts])[order] for name in names}
    return _Sampled(Averages(begin[order], end[order], error[order]), regressors)


def _grown(observations: Observations, windows: Windows, smooth: Floats, run: Innovations) -> dict[str, Averages]:
    """Return the accumulated pose errors at the ends of windows, in the robot's frame, by signal."""
    number = windows.number_of(observations.pose_time)
    at_end = (number >= 0) & (observations.pose_time > np.append(windows.end, 0.0)[number] - AT_THE_END)
    heading = smooth[at_end, 2:]
    cosine, sine = np.cos(heading), np.sin(heading)
    x, y, theta = np.moveaxis(run.pose[at_end], 1, 0)
    errors = {"forward": cosine * x + sine * y, "sideways": cosine * y - sine * x, "heading": theta}
    window, first = np.unique(number[at_end], return_index=True)
    count = np.diff(np.append(first, np.count_nonzero(at_end)))[:, None]
    spans = windows.begin[window], windows.end[window]
    empty = np.empty((0, run.pose.shape[2]))
    return {
        name: Averages(*spans, np.add.reduceat(error, first) / count if len(first) else empty)
        for name, error in errors.items()
    }


def regressors_of(
    observations: Observations, motion: Floats, values: Values, spans: Spans, driving: tuple[float, float] = TURNING
) -> dict[str, Floats]:
    """Return regressors over n spans of time, all (n,), from the simulated `motion`.

    Positions and angles are taken at the middle of a span, others are means over it. `values` are the parameters of the
    simulation; `driving` are the weights of left and right in the command of the signal.
    """
    columns = dict(zip(MOTION, motion.T, strict=True))
    speed = forward(columns["psi_left"], columns["psi_right"], RobotParameters.of(values))
    turning = columns["yaw_rate"]
    result = {
        "time": spans.middle + observations.time,
        "speed": spans.mean(speed),
        "yaw_rate": spans.mean(turning),
        "speed_times_yaw_rate": spans.mean(speed * turning),
        "x": spans.at_middle(columns["x"]),
        "y": spans.at_middle(columns["y"]),
        "heading": wrap(spans.at_middle(columns["theta"])),
        "wheel_angle_left": spans.at_middle(columns["angle_left"]) % TURN,
        "wheel_angle_right": spans.at_middle(columns["angle_right"]) % TURN,
        "acceleration": spans.growth(speed),
        "yaw_acceleration": spans.growth(turning),
    }
    if len(observations.given) == 0:
        driven = driving[0] * observations.duty[:, 0] + driving[1] * observations.duty[:, 1]
        result |= {
            "command_left": spans.mean_of_steps(observations.duty[:, 0]),
            "command_right": spans.mean_of_steps(observations.duty[:, 1]),
            "command_change": spans.mean_of_steps(driven) - spans.before.mean_of_steps(driven),
            "energy": spans.at_middle(_energy(observations, columns, values["k1"])),
        }
    return result


def _energy(observations: Observations, columns: Mapping[str, Floats], k1: float) -> Floats:
    """Return the integral of the load share (as in the catalogue's battery_drift) at the borders of the time grid (T +
    1,).
    """
    sides = (
        (observations.duty[:, 0], columns["psi_left"][1:]),
        (observations.duty[:, 1], columns["psi_right"][1:]),
    )
    load = sum(np.maximum(0.0, duty * (duty - 0.8 * k1 * psi)) for duty, psi in sides)
    return np.append(0.0, np.cumsum(load)) * observations.dt


def _spread(count: int, most: int) -> Indices:
    """Return numbers of at most `most` of so many samples, evenly spread."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def structure(residual: Floats, regressor: Floats) -> float:
    """Return the share of a residual's variance predicted by its means in bins of a regressor, both (n,), in time.

    The means are taken from some blocks of time and tested on the others (cross-validation), so without structure the
    result is about 0 or slightly negative. Samples that are not finite do not count.
    """
    usable = np.isfinite(residual) & np.isfinite(regressor)
    residual, regressor = residual[usable], regressor[usable]
    if len(residual) < BLOCKS or np.ptp(regressor) == 0.0:
        return 0.0
    borders = np.quantile(regressor, np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    place = np.searchsorted(borders, regressor)
    part = np.arange(len(residual)) * BLOCKS // len(residual) % PARTS
    left = whole = 0.0
    for tested in range(PARTS):
        known, new = part != tested, part == tested
        mean = float(np.mean(residual[known]))
        count = np.bincount(place[known], minlength=BINS)
        means = mean + np.bincount(place[known], residual[known] - mean, BINS) / np.maximum(count, 1)
        left += float(np.sum((residual[new] - means[place[new]]) ** 2))
        whole += float(np.sum((residual[new] - mean) ** 2))
    return 1.0 - left / whole if whole > 0.0 else 0.0
