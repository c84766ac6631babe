"""Small SVG and HTML drawings in panels: paths of a robot and its twin, and progress bars."""

from collections.abc import Sequence

import numpy as np

from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR
from cmr.report.markup import Html, joined, tag
from cmr.view.data.drives import Paths
from cmr.view.data.robots import Floats
from cmr.view.inputs import plain

SIZE, GAP, TOP, BOTTOM = 160, 16, 32, 22  # units of the drawing: of a square, between two, above and below
MARGIN = 0.08  # of a square's side around the paths
LEAST_EXTENT = 0.5  # m that are in a square at least
GREY = "#8a8a8a"


def paths_drawing(titles_and_paths: Sequence[tuple[str, Paths | None]]) -> str:
    """Return drawings side by side, with the same scale: a robot's path in yellow, its twin's in blue."""
    known = [paths for _, paths in titles_and_paths if paths is not None]
    if not known:
        return ""
    extent = max(LEAST_EXTENT, *(float(np.ptp(_points(paths), axis=0).max()) for paths in known))
    scale = SIZE * (1 - 2 * MARGIN) / extent
    width, height = len(titles_and_paths) * (SIZE + GAP) - GAP, TOP + SIZE + BOTTOM
    parts = [_square(place, title, paths, scale) for place, (title, paths) in enumerate(titles_and_paths)]
    drawn = joined(*parts, _scale_bar(scale, height), _legend(width, height))
    box, look = f"0 0 {width} {height}", "width:100%;font-size:11px"
    svg = tag("svg", drawn, viewBox=box, style=look, fill="none", stroke_width=1.6)
    return plain(tag("div", svg, style="padding:2px 12px"))


def bar(share: float) -> str:
    """Return a bar filled to this share [0 to 1]."""
    percent = 100 * min(max(share, 0.0), 1.0)
    filled = tag("div", style=f"width:{percent:.0f}%;height:8px;border-radius:4px;background:{TWIN_COLOUR}")
    return plain(tag("div", filled, style=f"margin:2px 12px;height:8px;border-radius:4px;background:{GREY}55"))


def distance(metres: float) -> str:
    """Format a distance [m]."""
    return f"{100 * metres:.1f} cm" if metres < 1.0 else f"{metres:.2f} m"


def _square(place: int, title: str, paths: Paths | None, scale: float) -> Html:
    left = place * (SIZE + GAP)
    frame = tag("rect", x=left, y=TOP, width=SIZE, height=SIZE, rx=4, stroke=GREY, stroke_width=0.5)
    subtitle = "not driven yet" if paths is None else f"{distance(paths.rmse)} apart (rms)"
    framed = joined(frame, _text(left, 11, title, "bold"), _text(left, 25, subtitle))
    if paths is None:
        return framed
    points = _points(paths)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    middle = np.array([left + SIZE / 2, TOP + SIZE / 2])
    drawn = [middle + (way - centre) * (scale, -scale) for way in (paths.real, paths.twin)]
    curves = [_curve(way, colour) for way, colour in zip(drawn, (REAL_COLOUR, TWIN_COLOUR), strict=True)]
    x, y = drawn[0][0]
    return joined(framed, *curves, tag("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=2.5, fill=GREY))


def _points(paths: Paths) -> Floats:
    return np.concatenate([paths.real, paths.twin])


def _curve(way: Floats, colour: str) -> Html:
    return tag("polyline", points=" ".join(f"{x:.1f},{y:.1f}" for x, y in way), stroke=colour)


def _scale_bar(scale: float, height: float) -> Html:
    """Return a line as long as a round length that is at most half of a square."""
    most = SIZE / 2 / scale
    length = max(length for length in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if length <= max(most, 0.1))
    y = height - 8
    line = tag("path", d=f"M1 {y - 3} v6 M1 {y} h{length * scale:.1f} v-3 v6", stroke=GREY)
    return joined(line, _text(length * scale + 7, y + 4, f"{length:g} m"))


def _legend(width: float, height: float) -> Html:
    y, parts = height - 8, list[Html]()
    for right, name, colour in ((106, "robot", REAL_COLOUR), (50, "twin", TWIN_COLOUR)):
        x = width - right
        parts += [tag("path", d=f"M{x} {y} h14", stroke=colour, stroke_width=2.5), _text(x + 18, y + 4, name)]
    return joined(*parts)


def _text(x: float, y: float, text: str, weight: str = "normal") -> Html:
    return tag("text", text, x=f"{x:.1f}", y=y, fill="currentColor", font_weight=weight)
