"""Figures of paths: the real one, free runs of both models, their distance, and where they differ most."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.diagnosis.report.track import Poses, Track, parting, track_of
from cmr.diagnosis.result import Path
from cmr.recordings.signal import Floats
from cmr.report.keys import DASHES, after_key, before_key, found_key, keys, real_key, simulated_key
from cmr.report.markup import Html, joined, tag
from cmr.report.numbers import number
from cmr.report.style import AFTER, BEFORE, FOUND, INK, REAL, REAL_OUTLINE
from cmr.report.svg import Curve, Frame, Range, band, dots, line, plot

WIDTH, HEIGHT = 330.0, 270.0
ROOM = 0.06  # of the range of a path, left free on all sides
STRAYING = 0.5  # of the size of the real path; what is farther outside is clipped
SMALLEST = 0.1  # m; a robot that stood still is not drawn larger
TIME = "time [s]"


def path_figure(
    path: Path, baseline: str, *, changed: bool, causes: Sequence[str] = (), window: float = math.nan
) -> Html:
    """Return the figure of one piece; only the baseline if the model was not extended.

    `baseline` is its label, `causes` are what the extended model has in addition. The interval of `window` seconds with
    the largest difference is marked.
    """
    track = track_of(path)
    if not np.any(np.isfinite(track.real.x)):
        return tag("p", f"{path.label}: no poses to draw.")
    part = parting(track, window) if changed else None
    after = [_path_plot(track, track.after, "after", part)] if changed else []
    plots = [_path_plot(track, track.before, "before" if changed else baseline.removeprefix("the "), part), *after]
    parted = track.begun_together(part) if part else None
    plots += [_parting_plot(parted)] if parted else []
    piece = f", piece {path.piece} of {path.pieces}, {path.time[0]:.1f} s into the log" if path.pieces > 1 else ""
    words = (
        f"{path.label}{piece}: the real path, and free runs of the model from the real robot's start, driven as "
        "recorded, without any correction. The dot is the start."
    )
    simulated = [before_key("simulated, before"), after_key("simulated, after")] if changed else [simulated_key()]
    return tag(
        "figure",
        keys(real_key(), *simulated, *([found_key("where the models differ most")] if part else [])),
        tag("div", *plots, _distance_plot(track, changed, part), class_="plots paths"),
        tag(
            "figcaption", words, *([" ", _parting_words(track.begun_together(part), baseline, causes)] if part else [])
        ),
    )


def _path_plot(track: Track, simulated: Poses, title: str, part: slice | None) -> Html:
    frame = _frame_around(track)
    error = f"{number(_root_mean_square(simulated.distance(track.real)), 2)} m"
    marked = line(frame, *track.real.within(part).places, FOUND, 10.0) if part else Html("")
    return plot(
        frame,
        marked,
        _real_line(frame, track),
        _simulated_line(frame, track, simulated, title),
        _start(frame, track),
        x_label="x [m]",
        y_label="y [m]",
        title=f"{title}: off by {error}",
        along=TIME,
        alt=f"Path seen from above, {title}: the simulated robot is {error} from the real one, root mean square.",
    )


def _parting_plot(track: Track) -> Html:
    """Plot the interval in which the models differ most, with all paths starting from the same pose."""
    frame = _frame_around(track)
    seconds = f"{track.time[0]:.1f} s to {track.time[-1]:.1f} s"
    before, after = (f"{number(float(one.distance(track.real)[-1]), 2)} m" for one in (track.before, track.after))
    return plot(
        frame,
        _real_line(frame, track),
        _simulated_line(frame, track, track.before, "before"),
        _simulated_line(frame, track, track.after, "after"),
        _start(frame, track),
        x_label="x [m]",
        y_label="y [m]",
        title=f"{seconds}, from one start",
        along=TIME,
        alt=f"Paths from {seconds}, begun at the same pose: at the end the simulated robot is {before} from the real "
        f"one before, {after} after.",
    )


def _parting_words(track: Track, baseline: str, causes: Sequence[str]) -> Html:
    """Describe the motion in the interval, the models' errors there, and the cause of the difference.

    Both models begin the interval at the real pose. The motion is described from the extended model's poses, which have
    no noise.
    """
    before, after = (number(float(one.distance(track.real)[-1]), 2) for one in (track.before, track.after))
    seconds = float(track.time[-1] - track.time[0])
    way = float(np.sum(np.hypot(np.diff(track.after.x), np.diff(track.after.y))))
    turned = math.degrees(float(np.sum(np.abs(np.diff(track.after.theta)))))
    words = (
        f"Marked are the {seconds:.1f} s in which the two models differ most, from {track.time[0]:.1f} s to "
        f"{track.time[-1]:.1f} s: the robot drives {way:.2f} m and turns through {turned:.0f}\u00b0. Begun at the real "
        f"pose, {baseline} ends {before} m from the real robot, and the extended model {after} m."
    )
    named = [part for cause in causes for part in (", ", cause)][1:]
    return joined(words, *([" The difference comes from ", *named, "."] if named else []))


def _real_line(frame: Frame, track: Track) -> Html:
    curve = Curve("real robot", track.time)
    return line(frame, *track.real.places, REAL, 4.0, under=REAL_OUTLINE, curve=curve)


def _simulated_line(frame: Frame, track: Track, simulated: Poses, stage: str) -> Html:
    curve = Curve(f"simulated, {stage}", track.time)
    if stage == "before":
        return line(frame, *simulated.places, BEFORE, 2.0, dashes=DASHES, curve=curve)
    return line(frame, *simulated.places, AFTER, 1.6, curve=curve)


def _start(frame: Frame, track: Track) -> Html:
    start = np.flatnonzero(np.isfinite(track.real.x))[:1]
    return dots(frame, track.real.x[start], track.real.y[start], INK, 7.0)


def _distance_plot(track: Track, changed: bool, part: slice | None) -> Html:
    """Plot the distance of the simulated robots from the real one over time."""
    before, after = (simulated.distance(track.real) for simulated in (track.before, track.after))
    drawn = np.concatenate([before, after])
    top = float(np.max(drawn[np.isfinite(drawn)], initial=1e-3))
    frame = Frame(
        x=(float(track.time[0]), max(float(track.time[-1]), float(track.time[0]) + 1.0)),
        y=(0.0, 1.05 * top),
        width=WIDTH,
        height=HEIGHT,
    )
    last = Curve("after [m]" if changed else "distance [m]")
    lines = [line(frame, track.time, after, AFTER, 1.6, curve=last)]
    if changed:
        lines = [line(frame, track.time, before, BEFORE, 1.6, dashes=DASHES, curve=Curve("before [m]")), *lines]
    shade = band(frame, (float(track.time[part][0]), float(track.time[part][-1]))) if part else Html("")
    words = f"{number(float(before[-1]), 2)} m before, {number(float(after[-1]), 2)} m after"
    return plot(
        frame,
        shade,
        joined(*lines),
        x_label=TIME,
        y_label="distance from the real robot [m]",
        title="distance over time",
        alt=f"Distance between simulated and real robot in time; at the end {words}.",
    )


def _root_mean_square(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else math.nan


def _frame_around(track: Track) -> Frame:
    """Return a frame with equal scales in x and y.

    It contains the real path, and the simulated ones unless they are far outside.
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
