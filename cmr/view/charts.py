"""Curves over time in panels: calibration estimates with intervals, and the distance of robot and twin."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import viser
from viser import uplot

from cmr.model.velocity_controller import VelocityController
from cmr.msg import calibration_status_t
from cmr.view.data.robots import Floats
from cmr.view.data.state import Arrival
from cmr.view.words import CONFIDENCE, ESTIMATES, estimated

BAND = "rgba(53, 116, 226, 0.25)"
LINE, EDGE = "#3574e2", "rgba(53, 116, 226, 0.4)"
HEIGHT = 150  # pixels
LABELS = 62  # pixels for the numbers on the left, such as 117.125
LABEL_HEIGHT = 16  # pixels of an axis' own label
MARGIN = 0.08  # of the range, above and below the values, for tick labels
NOTHING = np.array([0.0, 1.0])


class Chart:
    """A curve with or without an interval around it, hidden if empty.

    `from_zero` starts the vertical axis at zero; otherwise it spans the values.
    """

    def __init__(self, gui: viser.GuiApi, title: str, with_interval: bool, from_zero: bool = False) -> None:
        self._from_zero = from_zero
        self._span = _Span((0.0, 1.0), value_range(NOTHING))
        curves = [uplot.Series(label="s"), uplot.Series(label=title, stroke=LINE, width=2)]
        if with_interval:
            curves += [uplot.Series(label=label, stroke=EDGE, width=1) for label in ("high", "low")]
        self._columns = len(curves)
        self._chart = gui.add_uplot(
            (NOTHING,) * self._columns,
            tuple(curves),
            bands=(uplot.Band(series=(2, 3), fill=BAND),) if with_interval else None,
            scales=self._span.scales(),
            axes=self._span.axes(),
            title=f"{title} over seconds",
            legend=uplot.Legend(show=False),
            height=HEIGHT,
            visible=False,
        )

    def show(self, columns: Floats) -> None:
        """Draw columns (k, n): moments [s], values, and the interval's upper and lower ends."""
        columns = columns[:, np.isfinite(columns).all(axis=0)]
        self._chart.visible = bool(columns.shape[1]) and bool(np.ptp(columns[0]) > 0.0)
        if not self._chart.visible:
            return
        shown = np.append(columns[1:], 0.0) if self._from_zero else columns[1:]
        span = _Span((float(columns[0].min()), float(columns[0].max())), value_range(shown))
        if span != self._span:  # the browser recreates the chart, losing the visitor's zoom
            self._span = span
            self._chart.scales, self._chart.axes = span.scales(), span.axes()
        self._chart.data = tuple(np.ascontiguousarray(column) for column in columns)


class _Span(NamedTuple):
    """The ranges of a chart in time [s] and value.

    Both are always given: a page that determines its own time range fails when axes change together with the data.
    """

    seconds: tuple[float, float]
    values: tuple[float, float]

    def scales(self) -> dict[str, uplot.Scale]:
        return {"x": uplot.Scale(time=False, range=self.seconds), "y": uplot.Scale(range=self.values)}

    def axes(self) -> tuple[uplot.Axis, uplot.Axis]:
        return uplot.Axis(ticks={"show": False}), value_axis(*self.values)


def value_range(values: Floats) -> tuple[float, float]:
    """Return the range of the vertical axis for these values."""
    low, high = float(values.min()), float(values.max())
    margin = MARGIN * (high - low) or 1e-3 * abs(high) or 1.0
    return low - margin, high + margin


def value_axis(low: float, high: float, label: str = "") -> uplot.Axis:
    """Return the vertical axis from `low` to `high`, with a label if there is one."""
    numbers, texts = ticks(low, high)
    axis = uplot.Axis(size=LABELS, ticks={"show": False}, splits=numbers, values=texts)
    if label:
        axis["label"], axis["labelSize"] = label, LABEL_HEIGHT
    return axis


def ticks(low: float, high: float) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Return three to six round numbers within a range, as numbers and with enough digits.

    The browser's default of three digits is too few for k1.
    """
    rough = (high - low) / 3.0
    power = math.floor(math.log10(rough))
    step = max(factor * 10.0**power for factor in (1.0, 2.0, 5.0) if factor * 10.0**power <= rough)
    places = range(math.ceil(low / step), math.floor(high / step) + 1)
    digits = max(-math.floor(math.log10(step)), 0)
    return tuple(place * step for place in places), tuple(f"{place * step:.{digits}f}" for place in places)


def estimates(
    history: Sequence[Arrival[calibration_status_t]], controller: VelocityController | None = None
) -> dict[str, Floats]:
    """Return the columns of each parameter's chart, from the history of a calibration.

    Parameters that a robot with this velocity controller, or without one, does not have are not known.
    """
    begin = history[0].utime
    known = [((heard.utime - begin) / 1e6, estimated(heard.message, controller)) for heard in history]
    result = {}
    for name, _unit in ESTIMATES:
        rows = [(seconds, of[name].value, CONFIDENCE * of[name].std) for seconds, of in known if name in of]
        seconds, value, reach = np.array(rows).reshape(-1, 3).T
        result[name] = np.array([seconds, value, value + reach, value - reach])
    return result


def distances(history: Iterable[tuple[int, float]], now: int) -> Floats:
    """Return the columns of the chart of a robot's distance [cm] from its twin, over seconds until now."""
    return np.array([[(utime - now) / 1e6, 100 * distance] for utime, distance in history]).T
