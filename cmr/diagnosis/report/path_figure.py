"""Figures of paths: the real one and the free runs before and after, and how far apart they are in time."""

import math
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.report.binned import thinned
from cmr.diagnosis.report.keys import DASHES, after_key, before_key, keys, real_key, simulated_key
from cmr.diagnosis.report.markup import Html, tag
from cmr.diagnosis.report.numbers import number
from cmr.diagnosis.report.style import AFTER, BEFORE, INK, REAL, REAL_OUTLINE
from cmr.diagnosis.report.svg import Frame, Range, dots, line, plot
from cmr.diagnosis.result import Path
from cmr.recordings.signal import Floats

MOST_POINTS = 900  # of a drawn line
WIDTH, HEIGHT = 290.0, 270.0
ROOM = 0.06  # of the range of a path, left free on all sides
STRAYING = 0.5  # of the size of the real path; what strays farther beyond it is cut off
SMALLEST = 0.1  # m; a robot that stood still is not drawn larger


class Places(NamedTuple):
    """Positions [m], shape (n,)."""

    x: Floats
    y: Floats

    def distance(self, other: "Places") -> Floats:
        """Return how far [m] the positions are from others, shape (n,)."""
        return np.asarray(np.hypot(self.x - other.x, self.y - other.y))


class Track(NamedTuple):
    """The points of a path that are drawn, at `time` [s] since its beginning."""

    time: Floats
    real: Places
    before: Places
    after: Places


def path_figure(path: Path, *, changed: bool) -> Html:
    """Return the figure of one piece; where nothing changed the model, only what the paper's makes of it."""
    track = track_of(path)
    if not np.any(np.isfinite(track.real.x)):
        return tag("p", f"{path.label}: no poses to draw.")
    stages = (("before", track.before), ("after", track.after)) if changed else (("paper's model", track.before),)
    plots = [_path_plot(track, simulated, title) for title, simulated in stages]
    piece = f", piece {path.piece} of {path.pieces}, {path.time[0]:.1f} s into the log" if path.pieces > 1 else ""
    words = (
        f"{path.label}{piece}: the real path, and free runs of the model from the real robot's start, driven as "
        f"recorded, without any correction. The dot is the start."
    )
    distances = [before_key("distance before"), after_key("distance after")] if changed else []
    return tag(
        "figure",
        keys(real_key(), simulated_key(), *distances),
        tag("div", *plots, _distance_plot(track, changed), class_="plots paths"),
        tag("figcaption", words),
    )


def track_of(path: Path) -> Track:
    """Return the points to draw, evenly spread: more would cover itself. Gaps stay gaps."""
    gaps = np.flatnonzero(~np.isfinite(path.x))
    shown = np.union1d(thinned(len(path.x), MOST_POINTS), gaps)
    return Track(
        path.time[shown] - path.time[:1],
        Places(path.x[shown], path.y[shown]),
        Places(path.before_x[shown], path.before_y[shown]),
        Places(path.after_x[shown], path.after_y[shown]),
    )


def _path_plot(track: Track, simulated: Places, title: str) -> Html:
    frame = _frame_around(track)
    error = f"{number(_root_mean_square(simulated.distance(track.real)), 2)} m"
    start = np.flatnonzero(np.isfinite(track.real.x))[:1]
    return plot(
        frame,
        line(frame, *track.real, REAL, 4.0, under=REAL_OUTLINE),
        line(frame, *simulated, AFTER, 1.6),
        dots(frame, track.real.x[start], track.real.y[start], INK, 7.0),
        x_label="x [m]",
        y_label="y [m]",
        title=f"{title}: off by {error}",
        alt=f"Path seen from above, {title}: the simulated robot is {error} from the real one, root mean square.",
    )


def _distance_plot(track: Track, changed: bool) -> Html:
    """Return how far the simulated robots are from the real one, in time."""
    before, after = (simulated.distance(track.real) for simulated in (track.before, track.after))
    drawn = np.concatenate([before, after])
    top = float(np.max(drawn[np.isfinite(drawn)], initial=1e-3))
    frame = Frame(
        x=(float(track.time[0]), max(float(track.time[-1]), float(track.time[0]) + 1.0)),
        y=(0.0, 1.05 * top),
        width=WIDTH,
        height=HEIGHT,
    )
    lines = [line(frame, track.time, before, BEFORE, 1.6, dashes=DASHES)] if changed else []
    words = f"{number(float(before[-1]), 2)} m before, {number(float(after[-1]), 2)} m after"
    return plot(
        frame,
        *lines,
        line(frame, track.time, after, AFTER, 1.6),
        x_label="time [s]",
        y_label="distance from the real robot [m]",
        title="distance over time",
        alt=f"Distance between simulated and real robot in time; at the end {words}.",
    )


def _root_mean_square(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else math.nan


def _frame_around(track: Track) -> Frame:
    """Return a frame in which a metre is as long in x as in y.

    It holds the real path, and the simulated ones unless they stray far beyond it.
    """
    empty = Frame(x=(0.0, 1.0), y=(0.0, 1.0), width=WIDTH, height=HEIGHT)
    farthest = STRAYING * max(float(np.ptp(axis[np.isfinite(axis)])) for axis in track.real)
    x = _range(track.real.x, np.concatenate([track.before.x, track.after.x]), farthest)
    y = _range(track.real.y, np.concatenate([track.before.y, track.after.y]), farthest)
    metres = max((x[1] - x[0]) / empty.inner_width, (y[1] - y[0]) / empty.inner_height)  # per unit of the plot
    return Frame(
        x=_about_middle(x, metres * empty.inner_width),
        y=_about_middle(y, metres * empty.inner_height),
        width=WIDTH,
        height=HEIGHT,
    )


def _range(real: Floats, simulated: Floats, farthest: float) -> Range:
    """Return the range of one coordinate, with room around it."""
    real, simulated = real[np.isfinite(real)], simulated[np.isfinite(simulated)]
    low, high = float(real.min()), float(real.max())
    low = max(float(np.min(simulated, initial=low)), low - farthest)
    high = min(float(np.max(simulated, initial=high)), high + farthest)
    room = ROOM * max(high - low, SMALLEST)
    return low - room, high + room


def _about_middle(ends: Range, length: float) -> Range:
    middle = (ends[0] + ends[1]) / 2.0
    return middle - length / 2.0, middle + length / 2.0
