"""Plots as inline SVG: sharp on paper, small on a phone, and fast to make.

A report holds some seventy plots; Matplotlib takes 60 ms for each.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.report.markup import Html, joined, tag
from cmr.report.numbers import MINUS
from cmr.report.style import BORDER, FOUND, GRID, INK, PAPER

Floats = NDArray[np.float64]

Range = tuple[float, float]
NICE = (1.0, 0.5, 0.2)  # steps of ticks, times a power of ten
SHADE = 0.16  # opacity of shaded ranges behind curves


class Curve(NamedTuple):
    """Data shown at the pointer for a curve: its name and values.

    `along` are the values that identify its points, such as times, shape (n,); by default their x. `error` are standard
    errors of y, shape (n,).
    """

    name: str
    along: Floats | None = None
    error: Floats | None = None

    def data(self, shown: NDArray[np.bool_]) -> dict[str, str]:
        """Return the attributes from which `readings.js` reads the points that are shown, shape (n,)."""
        known = {"data_along": self.along, "data_error": self.error}
        values = {key: " ".join(f"{v:.4g}" for v in of[shown]) for key, of in known.items() if of is not None}
        return {"data_name": self.name, **values}


@dataclass(frozen=True, kw_only=True)
class Frame:
    """The rectangle that a plot is drawn in, and how data are mapped to it.

    `x` and `y` are the ranges of the data. `width` and `height` are those of the whole plot, labels included, `text` is
    the font size in these units; `room_left` and `room_top` are the space for labels, in letters.
    """

    x: Range
    y: Range
    width: float = 360.0
    height: float = 270.0
    text: float = 12.0
    room_left: float = 4.6
    room_top: float = 1.7

    @property
    def left(self) -> float:
        """Where the rectangle begins."""
        return round(self.room_left * self.text, 1)

    @property
    def top(self) -> float:
        """Where the rectangle begins."""
        return round(self.room_top * self.text, 1)

    @property
    def inner_width(self) -> float:
        """Width of the rectangle."""
        return self.width - self.left - 0.8 * self.text

    @property
    def inner_height(self) -> float:
        """Height of the rectangle."""
        return self.height - self.top - 3.0 * self.text

    def across(self, x: Floats) -> Floats:
        """Map values to x coordinates, from the frame's left edge."""
        return np.asarray((x - self.x[0]) / (self.x[1] - self.x[0]) * self.inner_width)

    def down(self, y: Floats) -> Floats:
        """Map values to y coordinates, from the frame's top edge."""
        return np.asarray((self.y[1] - y) / (self.y[1] - self.y[0]) * self.inner_height)


def plot(
    frame: Frame, *drawn: Html, x_label: str, y_label: str = "", title: str = "", along: str | None = None, alt: str
) -> Html:
    """Return a plot with axes; clipped to the frame.

    `alt` is its text alternative. `along` names the values that identify points of a map's curves.
    """
    inside = tag(
        "svg",
        *drawn,
        x=frame.left,
        y=frame.top,
        width=_round(frame.inner_width),
        height=_round(frame.inner_height),
        data_range=" ".join(f"{end:.6g}" for end in (*frame.x, *frame.y)),
        data_along=along,
    )
    return tag(
        "svg",
        _axes(frame),
        inside,
        _border(frame),
        _labels(frame, x_label, y_label, title),
        viewBox=f"0 0 {frame.width:g} {frame.height:g}",
        font_size=frame.text,
        role="img",
        aria_label=alt,
        data_x=x_label,
        data_y=y_label or None,
    )


def line(
    frame: Frame,
    x: Floats,
    y: Floats,
    colour: str,
    width: float,
    *,
    dashes: str | None = None,
    under: str | None = None,
    curve: Curve | None = None,
) -> Html:
    """Return a line through points, broken where one is not finite; `under` is the colour of an outline."""
    across, down = frame.across(x), frame.down(y)
    finite = np.isfinite(across) & np.isfinite(down)
    follows = np.concatenate([[False], finite[:-1]])
    steps = "".join(
        f"{'L' if linked else 'M'}{a:.1f} {d:.1f}"
        for a, d, linked in zip(across[finite], down[finite], follows[finite], strict=True)
    )
    stroke = {"d": steps, "fill": "none", "stroke_linejoin": "round", "stroke_dasharray": dashes}
    drawn = tag("path", **stroke, stroke=colour, stroke_width=width, **(curve.data(finite) if curve else {}))
    outline = tag("path", **stroke, stroke=under, stroke_width=width + 1.4) if under else Html("")
    return joined(outline, drawn)


def band(frame: Frame, ends: Range) -> Html:
    """Return a shade behind a range of x, over the whole height."""
    left, right = frame.across(np.array(ends))
    size = {"width": _round(right - left), "height": _round(frame.inner_height)}
    edges = f"M{left:.1f} 0V{frame.inner_height:.1f}M{right:.1f} 0V{frame.inner_height:.1f}"
    return joined(
        tag("rect", x=_round(left), y=0, **size, fill=FOUND, opacity=SHADE),
        tag("path", d=edges, stroke=FOUND, stroke_width=1.2),
    )


def dots(frame: Frame, x: Floats, y: Floats, colour: str, size: float) -> Html:
    """Return round dots at the points that are finite and inside the frame; with one element for all of them."""
    across, down = frame.across(x), frame.down(y)
    inside = (across >= 0.0) & (across <= frame.inner_width) & (down >= 0.0) & (down <= frame.inner_height)
    steps = "".join(f"M{a:.1f} {d:.1f}h0" for a, d in zip(across[inside], down[inside], strict=True))
    return tag("path", d=steps, stroke=colour, stroke_width=size, stroke_linecap="round")


def error_bars(frame: Frame, x: Floats, mean: Floats, error: Floats, colour: str) -> Html:
    """Return upright bars of one standard error either side of the means that are finite."""
    known = np.isfinite(mean)
    x, mean, error = x[known], mean[known], error[known]
    ends = zip(frame.across(x), frame.down(mean + error), frame.down(mean - error), strict=True)
    steps = "".join(f"M{a:.1f} {top:.1f}V{low:.1f}" for a, top, low in ends)
    return tag("path", d=steps, stroke=colour, stroke_width=1.3)


def squares(frame: Frame, x: Floats, y: Floats, colour: str, size: float) -> Html:
    """Return hollow squares at the points that are finite."""
    known = np.isfinite(y)
    corners = zip(frame.across(x[known]) - size / 2.0, frame.down(y[known]) - size / 2.0, strict=True)
    steps = "".join(f"M{a:.1f} {d:.1f}h{size}v{size}h-{size}z" for a, d in corners)
    return tag("path", d=steps, stroke=colour, stroke_width=1.1, fill=PAPER)


def zero_line(frame: Frame) -> Html:
    """Return a thin line at zero, over the full width."""
    return line(frame, np.array(frame.x), np.zeros(2), INK, 0.7)


def ticks(ends: Range, fewest: int) -> list[float]:
    """Return round numbers within a range at equal steps: as few as possible, but at least `fewest`."""
    power = 10.0 ** math.ceil(math.log10(ends[1] - ends[0]))
    for step in (nice * power * shrink for shrink in (1.0, 0.1, 0.01) for nice in NICE):
        first, last = math.ceil(ends[0] / step - 1e-9), math.floor(ends[1] / step + 1e-9)
        if last - first + 1 >= fewest:
            break
    return [float(f"{k * step:.9g}") for k in range(first, last + 1)]


def _axes(frame: Frame) -> Html:
    """Return a faint grid at round numbers, and the numbers."""
    across = ticks(frame.x, max(int(frame.inner_width / (7.0 * frame.text)), 2))
    upwards = ticks(frame.y, max(int(frame.inner_height / (5.0 * frame.text)), 2))
    x_places, y_places = frame.across(np.array(across)) + frame.left, frame.down(np.array(upwards)) + frame.top
    bottom = frame.top + frame.inner_height
    steps = [f"M{x:.1f} {frame.top:.1f}V{bottom:.1f}" for x in x_places]
    steps += [f"M{frame.left:.1f} {y:.1f}h{frame.inner_width:.1f}" for y in y_places]
    numbers = [
        _words(_number(value), x, bottom + 1.15 * frame.text) for value, x in zip(across, x_places, strict=True)
    ] + [
        _words(_number(value), frame.left - 0.35 * frame.text, y + 0.35 * frame.text, "end")
        for value, y in zip(upwards, y_places, strict=True)
    ]
    return joined(tag("path", d="".join(steps), stroke=GRID, stroke_width=0.8), *numbers)


def _border(frame: Frame) -> Html:
    size = {"width": _round(frame.inner_width), "height": _round(frame.inner_height)}
    return tag("rect", x=frame.left, y=frame.top, **size, fill="none", stroke=BORDER, stroke_width=0.8)


def _labels(frame: Frame, x_label: str, y_label: str, title: str) -> Html:
    middle, centre = frame.left + frame.inner_width / 2.0, frame.top + frame.inner_height / 2.0
    parts = [_words(x_label, middle, frame.height - 0.5 * frame.text)]
    if y_label:
        turned = f"translate({frame.text:.1f} {centre:.1f}) rotate(-90)"
        parts.append(tag("text", y_label, transform=turned, text_anchor="middle"))
    if title:
        parts.append(tag("text", title, x=_round(middle), y=1.1 * frame.text, text_anchor="middle", font_weight="bold"))
    return joined(*parts)


def _words(text: str, x: float, y: float, anchor: str = "middle") -> Html:
    return tag("text", text, x=_round(x), y=_round(y), text_anchor=anchor)


def _number(value: float) -> str:
    return f"{value:g}".translate(MINUS)


def _round(value: float) -> float:
    return round(value, 1)
