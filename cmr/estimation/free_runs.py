"""Free runs over short windows: the deviation of the model from the robot without corrections.

Each window begins at the real pose and then runs on commands alone (on measured wheel speeds if there are none). Wheel
speeds and the internal states of effects run freely from the beginning of the segment, because they do not drift.

The window is short on purpose. Disturbances make headings drift randomly, and errors grow with the 1.5th power of time:
over 10 s, the errors of a perfect model on two logs of the same robot differ by 20 % and more. Over 3 s, with windows
that overlap by half, they agree, so an error measured on one log predicts that on the next.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.estimation.prediction import FREE, WHEELS
from cmr.estimation.segments import Segment, continued
from cmr.estimation.smoothing import smoothed_poses
from cmr.model.catalogue import definition
from cmr.model.observer.observer import RESTART, Observations, Observer
from cmr.model.observer.structures import Innovations
from cmr.recordings.signal import Floats

WINDOW = 3.0  # s of a free run
OVERLAP = 2  # windows that cover each moment
BLOCK = 4.0 * WINDOW  # s; seven of eight windows lie within such blocks
COMPLETE = 0.95  # share of a window that its poses must span
LEAST = 0.5  # of a window; shorter stretches are skipped
SPAN = 0.1  # s over which speeds are averaged, so that quantisation errors are small
SIGNALS = ("position", "heading", *WHEELS, "yaw_rate")

Indices = NDArray[np.int64]
Values = Mapping[str, float]


class Fold(NamedTuple):
    """Parameters by name of one or more models, found without some spans [s] of a segment: begin and end of each."""

    models: tuple[Values, ...]
    spans: tuple[tuple[float, float], ...] = ((-np.inf, np.inf),)


class Windows(NamedTuple):
    """When W free runs begin and end [s since the segment's beginning], and the numbers of their first poses, (W,).

    Without poses the numbers are empty.
    """

    begin: Floats
    end: Floats
    pose: Indices

    def number_of(self, times: Floats) -> Indices:
        """Return the number of the window that contains each time, -1 for none; windows must not overlap. Shape as
        `times`.
        """
        number = np.searchsorted(self.begin, times, side="left") - 1
        inside = (number >= 0) & (times <= np.append(self.end, -np.inf)[number])
        return np.asarray(np.where(inside, number, -1))


NO_WINDOWS = Windows(np.empty(0), np.empty(0), np.empty(0, np.int64))


class Averages(NamedTuple):
    """Errors averaged over n spans from `begin` to `end` [s] (n,), of C candidates: `error` (n, C)."""

    begin: Floats
    end: Floats
    error: Floats


@dataclass(frozen=True)
class Errors:
    """Errors of one model's free runs over W windows of `window` [s].

    `begin` [s since the recording's first sample] and the number of the `recording` have shape (W,); so have, by signal
    of SIGNALS, the sums of squared errors `squares` (m, rad, rad/s) and the numbers of errors, `counts`.
    """

    window: float
    begin: Floats
    recording: Indices
    squares: Mapping[str, Floats]
    counts: Mapping[str, Floats]

    def rmse(self, *signals: str) -> float:
        """Return the root mean square error of these signals together; NaN where none was recorded."""
        count = sum(float(np.sum(self.counts[name])) for name in signals)
        return float(np.sqrt(sum(np.sum(self.squares[name]) for name in signals) / count)) if count else np.nan

    def median(self, signal: str) -> float:
        """Return the median over windows of each one's root mean square error; NaN where none was recorded."""
        counts = self.counts[signal]
        known = counts > 0
        return float(np.median(np.sqrt(self.squares[signal][known] / counts[known]))) if np.any(known) else np.nan


def alternating_spans(seconds: float, folds: int, block: float = BLOCK) -> list[tuple[tuple[float, float], ...]]:
    """Return the spans of each fold: blocks of `block` [s] assigned to the folds in turn, over a duration of `seconds`.

    Blocks should be several windows long. Leaving out a whole quarter at once would remove a kind of driving from the
    fit, and measure that rather than the error on the next log.
    """
    begins = [block * number for number in range(int(np.ceil(seconds / block)))]
    return [tuple((begin, begin + block) for begin in begins[fold::folds]) for fold in range(folds)]


def errors_of(
    segments: Sequence[Segment], folds: Sequence[Sequence[Fold]], window: float = WINDOW
) -> tuple[Errors, ...]:
    """Return the errors of each model over all segments; `folds` are those of each, all with as many models.

    The last model should be the most complete one: its sensor effects determine the real pose at the start of a window.
    Windows do not extend beyond a fold's span; each is run with parameters fitted without it. Remainders at the ends
    are not used.
    """
    observations = [segment.observations for segment in segments]
    models = {id(fold.models): fold.models for of_segment in folds for fold in of_segment}
    first = dict(zip(models, np.cumsum([0, *map(len, models.values())]).tolist(), strict=False))
    values = stacked([model for together in models.values() for model in together])
    smooth = _smoothed(observations, folds)
    parts: list[list[list[Errors]]] = [[[] for _ in segments] for _ in folds[0][0].models]
    for phase in range(OVERLAP):
        late = phase * window / OVERLAP
        chosen = [_windows(one, of_one, window, late) for one, of_one in zip(observations, folds, strict=True)]
        begins = [windows.pose for windows, _ in chosen]
        runs = free_runs(observations, begins, smooth, values, continued(segments))
        for number, ((windows, fold), run) in enumerate(zip(chosen, runs, strict=True)):
            if len(windows.begin):
                known = reading_errors(observations[number], run)
                lane = np.array([first[id(one.models)] for one in folds[number]])[fold]
                for model, part in enumerate(parts):
                    part[number].append(_summed(segments[number], window, windows, known, lane + model))
    return tuple(joined(chain.from_iterable(part), window) for part in parts)


def _smoothed(observations: Sequence[Observations], folds: Sequence[Sequence[Fold]]) -> list[Floats]:
    """Return the real poses of each segment, by the last of its models."""
    result = [one.pose for one in observations]
    for models in {id(of_one[0].models): of_one[0].models for of_one in folds}.values():
        own = [number for number, of_one in enumerate(folds) if of_one[0].models is models]
        smooth = smoothed_poses([observations[number] for number in own], models[-1])
        for number, poses in zip(own, smooth, strict=True):
            result[number] = poses
    return result


def joined(errors: Iterable[Errors], window: float = WINDOW) -> Errors:
    """Return the errors of one model over all windows of several, each of `window` [s]."""
    parts = list(errors)
    empty = np.empty(0)
    return Errors(
        window,
        np.concatenate([empty, *(part.begin for part in parts)]),
        np.concatenate([empty.astype(np.int64), *(part.recording for part in parts)]),
        {name: np.concatenate([empty, *(part.squares[name] for part in parts)]) for name in SIGNALS},
        {name: np.concatenate([empty, *(part.counts[name] for part in parts)]) for name in SIGNALS},
    )


def stacked(models: Sequence[Values]) -> dict[str, Floats]:
    """Return the values of all models by name, shape (models,); missing names get the neutral value."""
    names = dict.fromkeys(name for model in models for name in model)
    return {name: np.array([m.get(name, definition(name).neutral) for m in models], np.float64) for name in names}


def free_run(observations: Observations, begins: Indices, poses: Floats, values: Mapping[str, Floats]) -> Innovations:
    """Run freely from a segment's beginning to its end, reset to `poses` (P, 3) at the poses with numbers `begins`.

    Returns measured minus simulated sensor readings.
    """
    return free_runs([observations], [begins], [poses], values, [False])[0]


def free_runs(
    observations: Sequence[Observations],
    begins: Sequence[Indices],
    poses: Sequence[Floats],
    values: Mapping[str, Floats],
    continued: Sequence[bool],
) -> list[Innovations]:
    """Run freely over several segments; see `free_run`. `continued` says which segments continue the previous one after
    a gap.
    """
    changed = [_put_to(*one) for one in zip(observations, begins, poses, strict=True)]
    results = Observer(values, FREE).observe_each(changed, continued)
    measured = (
        np.insert(np.ones(len(one.pose), np.bool_), np.repeat(of_one, 2) + 1, False)
        for one, of_one in zip(observations, begins, strict=True)
    )
    return [result._replace(pose=result.pose[rows]) for result, rows in zip(results, measured, strict=True)]


def _put_to(observations: Observations, begins: Indices, poses: Floats) -> Observations:
    """Return observations in which the robot is reset to `poses` (P, 3) right after the poses with numbers `begins`."""
    # Twice, because the position of the tracked point depends on the heading, which the first pass sets.
    source = np.repeat(begins, 2)
    at = source + 1
    return replace(
        observations,
        pose_time=np.insert(observations.pose_time, at, observations.pose_time[source]),
        pose=np.insert(observations.pose, at, poses[source], axis=0),
        pose_use=np.insert(observations.pose_use, at, RESTART),
    )


def windows_of(
    observations: Observations, window: float, late: float = 0.0, begin: float = -np.inf, end: float = np.inf
) -> Windows:
    """Return windows end to end, within `begin` and `end` [s], over each stretch of unbroken path.

    The first begins `late` [s] after its stretch. A stretch between half a window and a window long is one window.
    """
    time = observations.pose_time
    if len(time) == 0:
        first, last = max(begin, 0.0), min(end, observations.seconds)
        begins = _begins(first, last, _length(observations.seconds, window), late)
        return Windows(begins, np.minimum(begins + window, last), np.empty(0, np.int64))
    parts = [(np.empty(0, np.int64), np.empty(0))]
    for stretch in np.split(np.arange(len(time)), np.flatnonzero(observations.pose_use == RESTART)):
        inside = stretch[(time[stretch] >= begin) & (time[stretch] <= end)]
        if len(inside):
            first, last = float(time[inside[0]]), float(time[inside[-1]])
            length = _length(float(np.ptp(time[stretch])), window)
            number = np.unique(inside[np.searchsorted(time[inside], _begins(first, last, length, late) - 1e-9)])
            # If poses are late, the previous window would otherwise reach into the next.
            parts.append((number, np.minimum(time[number] + window, np.append(time[number[1:]], last)[: len(number)])))
    number, ends = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Windows(time[number], ends, number)


def _length(whole: float, window: float) -> float:
    """Return how long windows are [s] in a stretch of `whole` [s]."""
    return whole if LEAST * window <= whole < COMPLETE * window else window


def _begins(first: float, last: float, length: float, late: float) -> Floats:
    """Return the start times of windows of a length [s] placed end to end, or nearly so, between two times."""
    return np.arange(first + late, last - COMPLETE * length, length)


def _windows(observations: Observations, folds: Sequence[Fold], window: float, late: float) -> tuple[Windows, Indices]:
    """Return the windows of all folds, and the number of each one's fold (W,)."""
    numbers, parts = [np.empty(0, np.int64)], [NO_WINDOWS]
    for index, fold in enumerate(folds):
        for begin, end in fold.spans:
            if begin < observations.seconds and end > 0.0:  # most of many spans lie outside
                parts.append(windows_of(observations, window, late, begin, end))
                numbers.append(np.full(len(parts[-1].begin), index))
    number = np.concatenate(numbers)
    begins, ends, poses = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(begins, kind="stable")
    return Windows(begins[order], ends[order], np.sort(poses)), number[order]


def reading_errors(observations: Observations, innovations: Innovations) -> dict[str, Averages]:
    """Return the errors by signal of SIGNALS; positions as distances, speeds as means over SPAN, poses individually."""
    poses = observations.pose_time, observations.pose_time
    result = {
        "position": Averages(*poses, np.hypot(innovations.pose[:, 0], innovations.pose[:, 1])),
        "heading": Averages(*poses, innovations.pose[:, 2]),
        "yaw_rate": _binned(observations.gyro_time, innovations.gyro, observations.seconds),
    }
    for side, name in enumerate(WHEELS):
        used = (
            observations.wheel_use[:, side] > 0
            if len(observations.given) == 0
            else np.zeros(len(observations.wheel), np.bool_)
        )
        result[name] = _rates(observations.wheel_time[used], innovations.wheel[used, side])
    return result


def _binned(time: Floats, error: Floats, seconds: float) -> Averages:
    """Return means of errors (n, C) over each whole SPAN of so many seconds in which there are any."""
    number = np.floor(time / SPAN)
    whole = (number + 1.0) * SPAN <= seconds
    number, time, error = number[whole], time[whole], error[whole]
    first = np.flatnonzero(np.diff(number, prepend=-1.0))
    if len(first) == 0:
        return Averages(time, time, error)
    count = np.diff(np.append(first, len(time)))
    begin = number[first] * SPAN
    return Averages(begin, begin + SPAN, np.add.reduceat(error, first) / count[:, None])


def _rates(time: Floats, error: Floats) -> Averages:
    """Return the growth rates of angle errors (n, C), over spans of at least SPAN."""
    first = np.flatnonzero(np.diff(np.floor(time / SPAN), prepend=-1.0))
    begin, end = time[first[:-1]], time[first[1:]]
    wide = end - begin > 0.5 * SPAN
    rate = np.diff(error[first], axis=0)[wide] / (end - begin)[wide, None]
    return Averages(begin[wide], end[wide], rate)


def _summed(segment: Segment, window: float, windows: Windows, known: Mapping[str, Averages], lane: Indices) -> Errors:
    """Return the sums over windows of the errors of the candidate assigned to each window, `lane` (W,)."""
    squares: dict[str, Floats] = {}
    counts: dict[str, Floats] = {}
    for name, averages in known.items():
        number = windows.number_of(0.5 * (averages.begin + averages.end))
        inside = number >= 0
        error = averages.error[inside, lane[number[inside]]]
        squares[name] = np.asarray(np.bincount(number[inside], error**2, len(lane)), np.float64)
        counts[name] = np.bincount(number[inside], minlength=len(lane)).astype(np.float64)
    return Errors(
        window, windows.begin + segment.observations.time, np.full(len(lane), segment.recording), squares, counts
    )
