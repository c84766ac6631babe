"""What a report shows of a robot and its models: paths of free runs, and residuals over what may explain them.

What residuals are shown over is the simulated motion, never a sensor's own sample: the noise of a sample that is in
both would look like structure (errors in variables).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.result import DENSE, Path, Residual
from cmr.estimation.free_runs import (
    OVERLAP,
    Averages,
    Indices,
    Values,
    Windows,
    free_run,
    smoothed_poses,
    stacked,
    told_errors,
    windows_of,
)
from cmr.estimation.prediction import WHEELS
from cmr.estimation.segments import Segment
from cmr.model.body import forward, wrap
from cmr.model.catalogue import effects_on
from cmr.model.observer import MOTION, RESTART, Innovations, Observations
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats

MOST_PATHS = 4  # a page with more tells nobody more
MOST_POINTS = 2000  # of the first DENSE seconds of a path, and as many of the rest
MOST_SAMPLES = 3000  # of a residual
GROWN = 1.0  # s over which errors of the pose grow
AT_THE_END = 0.2  # s whose poses are averaged when they have grown: single ones are noisy
UNITS = {**dict.fromkeys((*WHEELS, "yaw_rate"), "rad/s"), "forward": "m", "sideways": "m", "heading": "rad"}
# The command that drives a signal: shares of left and right.
DRIVING = {"psi_left": (1.0, 0.0), "psi_right": (0.0, 1.0), "forward": (0.5, 0.5)}
TURNING = (-1.0, 1.0)
TURN = 2.0 * np.pi
BINS = 12  # of a regressor, each with as many samples
BLOCKS, PARTS = 60, 5  # blocks of time, and the parts they are dealt out to in turn


@dataclass(frozen=True)
class Spans:
    """Spans of time from `begin` to `end` [s], (n,), on a raster of `dt` [s] with T steps and T + 1 borders."""

    dt: float
    begin: Floats
    end: Floats

    @property
    def middle(self) -> Floats:
        """The middles of the spans [s]."""
        return 0.5 * (self.begin + self.end)

    @property
    def before(self) -> "Spans":
        """Spans as long, each before its own; cut at the raster's beginning."""
        begin = np.maximum(2.0 * self.begin - self.end, 0.0)
        return Spans(self.dt, begin, np.maximum(self.begin, begin + self.dt))

    def at_middle(self, column: Floats) -> Floats:
        """Return what is given at the borders (T + 1,) in the middle of each span."""
        return self._at(self.middle, column)

    def growth(self, column: Floats) -> Floats:
        """Return by how much what is given at the borders (T + 1,) grows in a second."""
        return (self._at(self.end, column) - self._at(self.begin, column)) / (self.end - self.begin)

    def mean(self, column: Floats) -> Floats:
        """Return the mean of what is given at the borders (T + 1,)."""
        return self.mean_of_steps(0.5 * (column[1:] + column[:-1]))

    def mean_of_steps(self, steps: Floats) -> Floats:
        """Return the mean of what is constant in each step (T,)."""
        return self.growth(np.append(0.0, np.cumsum(steps)) * self.dt)

    def _at(self, time: Floats, column: Floats) -> Floats:
        return np.asarray(np.interp(time, np.arange(len(column)) * self.dt, column), np.float64)


class _Sampled(NamedTuple):
    """One signal's errors in a segment, `averages.error` (n, models), and its regressors (n,)."""

    averages: Averages
    regressors: dict[str, Floats]


def paths_of(segments: Sequence[Segment], before: Values, after: Values, labels: Sequence[str]) -> tuple[Path, ...]:
    """Return the MOST_PATHS paths on which two models differ most, and their free runs by both from the start.

    The one of each recording comes first. Where the models are alike, they are the paths that lead farthest. Segments
    without poses have none. `labels` are those of the recordings.
    """
    pieces: dict[int, list[Segment]] = {}
    for segment in pieces_with_path(segments):
        pieces.setdefault(segment.recording, []).append(segment)
    ranked = []
    for recording, own in pieces.items():
        paths = [
            _path(segment, before, after, labels[recording], number, len(own))
            for number, segment in enumerate(own, start=1)
        ]
        paths.sort(key=_difference, reverse=True)
        ranked += list(enumerate(paths[:MOST_PATHS]))
    # The best piece of each recording, in order of the difference, then the second best.
    ranked.sort(key=lambda one: (-one[0], _difference(one[1])), reverse=True)
    return tuple(path for _, path in ranked[:MOST_PATHS])


def pieces_with_path(segments: Sequence[Segment]) -> list[Segment]:
    """Return the segments in which poses were recorded."""
    return [segment for segment in segments if len(segment.observations.pose)]


def _difference(path: Path) -> tuple[float, float]:
    """Return how far [m] the models are from each other where the path is dense, and how far [m] it leads."""
    dense = path.time <= path.time[0] + DENSE
    between = (path.before_x - path.after_x) ** 2 + (path.before_y - path.after_y) ** 2
    way = (path.x - path.x[0]) ** 2 + (path.y - path.y[0]) ** 2
    return float(np.sqrt(np.nanmean(between[dense]))), float(np.sqrt(np.nanmean(way[dense])))


def _path(segment: Segment, before: Values, after: Values, label: str, piece: int, pieces: int) -> Path:
    observations = segment.observations
    begins = np.flatnonzero(observations.pose_use == RESTART)
    smooth = smoothed_poses(observations, after)
    measured = np.column_stack([observations.pose[:, :2], np.unwrap(observations.pose[:, 2])])
    simulated = measured[:, :, None] - free_run(observations, begins, smooth, stacked((before, after))).pose
    simulated[begins] = smooth[begins, :, None]
    beginning = int(np.searchsorted(observations.pose_time, observations.pose_time[0] + DENSE, side="right"))
    rest = beginning + _spread(len(measured) - beginning, MOST_POINTS)
    shown = np.concatenate([_spread(beginning, MOST_POINTS), rest])
    simulated = simulated[shown]
    return Path(
        label=label,
        time=observations.pose_time[shown] + observations.time,
        x=measured[shown, 0],
        y=measured[shown, 1],
        theta=measured[shown, 2],
        before_x=simulated[:, 0, 0],
        before_y=simulated[:, 1, 0],
        before_theta=simulated[:, 2, 0],
        after_x=simulated[:, 0, 1],
        after_y=simulated[:, 1, 1],
        after_theta=simulated[:, 2, 1],
        piece=piece,
        pieces=pieces,
    )


def residuals_of(segments: Sequence[Segment], before: Values, after: Values) -> tuple[Residual, ...]:
    """Return the residuals of all signals that were recorded, over all segments.

    Speeds are means over SPAN. Errors of the pose have grown over GROWN from the real pose on, and are in the frame of
    the robot. `command_change` is by how much the mean command that drives the signal changed from as long a time
    before; for the yaw rate, the sideways position and the heading that is right minus left.
    """
    effects = without_each(after)
    sampled = [_sampled(segment, (after, before, *effects.values())) for segment in segments]
    found = [(name, [one[name] for one in sampled if len(one[name].averages.begin)]) for name in UNITS]
    return tuple(_residual(name, parts, list(effects)) for name, parts in found if parts)


def without_each(values: Values) -> dict[str, Values]:
    """Return by effect that these values switch on the values with that one switched off, and nothing else changed."""
    switches = {
        effect.name: {one.name: one.neutral for one in effect.parameters if one.switches and one.neutral is not None}
        for effect in effects_on(values)
    }
    return {name: {**values, **off} for name, off in switches.items()}


def _residual(name: str, parts: Sequence[_Sampled], effects: Sequence[str]) -> Residual:
    error = np.concatenate([part.averages.error for part in parts])
    shown = _spread(len(error), MOST_SAMPLES)
    # Segments with commands and segments without may come together.
    regressors = [key for key in parts[0].regressors if all(key in part.regressors for part in parts)]
    return Residual(
        signal=name,
        unit=UNITS[name],
        before=error[shown, 1],
        after=error[shown, 0],
        regressors={key: np.concatenate([part.regressors[key] for part in parts])[shown] for key in regressors},
        without={effect: error[shown, 2 + number] for number, effect in enumerate(effects)},
    )


def _sampled(segment: Segment, models: Sequence[Values]) -> dict[str, _Sampled]:
    """Return the errors of all signals in a segment, in order of time, over the motion of the first model."""
    observations = segment.observations
    after, values = models[0], stacked(models)
    smooth = smoothed_poses(observations, after)
    speeds: dict[str, _Sampled] = {}
    poses: list[dict[str, _Sampled]] = []
    for phase in range(OVERLAP):
        windows = windows_of(observations, GROWN, phase * GROWN / OVERLAP)
        run = free_run(observations, windows.pose, smooth, values)
        grown = _grown(observations, windows, smooth, run)
        poses.append(_with_regressors(observations, run.motion, grown, after))
        if not speeds:
            told = told_errors(observations, run)
            speeds = _with_regressors(
                observations, run.motion, {name: told[name] for name in (*WHEELS, "yaw_rate")}, after
            )
    return speeds | {name: _merged([one[name] for one in poses]) for name in poses[0]}


def _with_regressors(
    observations: Observations, motion: Floats, errors: Mapping[str, Averages], values: Values
) -> dict[str, _Sampled]:
    return {
        name: _Sampled(
            one,
            regressors_of(
                observations, motion, values, Spans(observations.dt, one.begin, one.end), DRIVING.get(name, TURNING)
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
    """Return the pose's errors at the ends of windows, in the frame of the robot, by signal."""
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
    """Return what may explain residuals over n spans of time, all (n,), from the simulated `motion`.

    Places and angles are those in the middle of a span, the others means over it. `values` are the parameters that
    it was simulated with; `driving` are the shares of left and right in the command that drives the signal.
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
    """Return the integral of the load share (as in the catalogue's battery_drift) at the raster's borders (T + 1,)."""
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
    """Return the share of a residual's variance that its means in bins of a regressor predict, both (n,), in time.

    The means are taken from some blocks of time and tested on the others (cross-validation), so that chance predicts
    nothing: about 0, or a little less. Samples that are not finite do not count.
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
