"""The panel that plots signals over time: any field of any channel, several at once."""

from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from cmr.bus.fields import FieldName, unit_of
from cmr.recordings.thinning import broken_at_gaps, thinned
from cmr.report.colours import TWIN_COLOUR
from cmr.report.markup import joined, tag
from cmr.view.charts import LABEL_HEIGHT, value_axis, value_range
from cmr.view.curves import Curve, Curves
from cmr.view.data.robots import Floats
from cmr.view.data.signals import Source
from cmr.view.inputs import plain, write

MOST_PLOTS = 6  # per visitor, so that a page stays fast
PIXELS = 600  # of a plot's width, at least; minima and maxima of each pixel are drawn
HEIGHT = 150  # pixels
LONGEST_LABEL = 18  # characters that fit beside a plot; the full name is above it
GAP_COLOUR, CURSOR_COLOUR = "#dee2e6", "#212529"
BEYOND = 10.0  # plot heights above and below the visible range
ROOM = 0.25  # of the range, free before the vertical axis is rescaled
BOTTOM = -1e9  # below everything visible; gaps are filled down to it
CHANNEL, SIGNAL, REMOVE = "choose a channel ...", "then a signal ...", "remove a plot ..."
HINT = "Choose a channel and a signal to plot it over time."
FULL = f"There are {MOST_PLOTS} plots; remove one before you add another."


class Plots:
    """Lets a visitor choose signals, and plots them."""

    def __init__(self, gui: viser.GuiApi, container: viser.GuiTabHandle, windows: Sequence[str]) -> None:
        self._gui, self._container = gui, container
        self.window = windows[0]
        self.chosen: list[FieldName] = []
        self._sources: dict[str, Source] = {}
        self._names: dict[str, FieldName] = {}
        self._plots: dict[FieldName, _Plot] = {}
        self._channel = gui.add_dropdown("channel", (CHANNEL,), hint="type to search")
        self._signal = gui.add_dropdown("signal", (SIGNAL,), hint="type to search")
        self._window = gui.add_dropdown("time", tuple(windows), initial_value=windows[0])
        self._remove = gui.add_dropdown("remove", (REMOVE,), visible=False)
        self._said = gui.add_html("")
        self._channel.on_update(self._take_channel)
        self._signal.on_update(self._take_signal)
        self._window.on_update(self._take_window)
        self._remove.on_update(self._take_remove)

    def show(self, curves: Curves, sources: Sequence[Source], now: int) -> None:
        """Draw the selected signals at `now` [us], and offer `sources`."""
        self._offer(sources)
        chosen = list(self.chosen)
        for name in self._plots.keys() - set(chosen):
            self._plots.pop(name).remove()
        for name in chosen:
            if name not in self._plots:
                with self._container:
                    self._plots[name] = _Plot(self._gui, name)
            self._plots[name].show(curves.curve(name, curves.windows[self.window], now))
        self._said.content = "" if 0 < len(chosen) < MOST_PLOTS else _line(FULL if chosen else HINT)
        options = (REMOVE, *map(str, chosen))
        if self._remove.options != options:
            self._remove.options = options
            self._remove.visible = bool(chosen)

    def _offer(self, sources: Sequence[Source]) -> None:
        self._sources = {str(source): source for source in sources}
        options = (CHANNEL, *self._sources)
        if self._channel.options != options:
            chosen = self._channel.value if self._channel.value in options else CHANNEL
            self._channel.options = options
            write(self._channel, chosen)

    def _take_channel(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        source = self._sources.get(self._channel.value)
        if event.client_id is not None:
            self._names = {str(name): name for name in source.signals()} if source else {}
            self._signal.options = (SIGNAL, *self._names)
            write(self._signal, SIGNAL)

    def _take_signal(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        name = self._names.get(self._signal.value)
        if event.client_id is None or name is None:
            return
        write(self._signal, SIGNAL)
        if name not in self.chosen and len(self.chosen) < MOST_PLOTS:
            self.chosen = [*self.chosen, name]

    def _take_window(self, _event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        self.window = self._window.value

    def _take_remove(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if event.client_id is not None and self._remove.value != REMOVE:
            self.chosen = [name for name in self.chosen if str(name) != self._remove.value]
            write(self._remove, REMOVE)


class _Plot:
    """One signal: its name with its value, and its curve below."""

    def __init__(self, gui: viser.GuiApi, name: FieldName) -> None:
        self._name, self._unit = name, unit_of(name)
        self._title = gui.add_html("")
        label = f"{name.field} [{self._unit}]" if self._unit else name.field
        self._y_label = label if len(label) <= LONGEST_LABEL else f"[{self._unit}]" if self._unit else ""
        self._span: tuple[float, float, float, float] | None = None
        nothing = np.array([0.0, 1.0])
        self._chart = gui.add_uplot(
            (nothing,) * 4,
            (
                uplot.Series(label="time"),
                uplot.Series(label=str(name), stroke=TWIN_COLOUR, width=1.5, points={"show": False}),
                uplot.Series(label="no values", fill=GAP_COLOUR, fillTo=BOTTOM, width=0, points={"show": False}),
                uplot.Series(label="now", stroke=CURSOR_COLOUR, width=1.5, points={"show": False}),
            ),
            legend=uplot.Legend(show=False),
            height=HEIGHT,
            visible=False,
        )

    def show(self, curve: Curve) -> None:
        """Draw it."""
        self._title.content = title(self._name, self._unit, curve)
        self._chart.visible = bool(np.isfinite(curve.values).any())
        if not self._chart.visible:
            return
        low, high = self._fit(curve)
        data = columns(curve, low, high)
        if len(data[0]) != len(self._chart.data[0]) or not all(map(np.array_equal, data, self._chart.data)):
            self._chart.data = data

    def remove(self) -> None:
        """Take it from the page."""
        self._title.remove()
        self._chart.remove()

    def _fit(self, curve: Curve) -> tuple[float, float]:
        """Return the range of the vertical axis, rescaled only if the curve no longer fits."""
        values = curve.values[np.isfinite(curve.values)]
        low, high = value_range(values)
        if self._span is not None:
            begin, end, known_low, known_high = self._span
            is_wide = known_high - known_low > 4.0 * (high - low)
            if (begin, end) == (curve.begin, curve.end) and known_low <= low and high <= known_high and not is_wide:
                return known_low, known_high
        room = ROOM * (high - low) if curve.cursor is None else 0.0  # live, the next values may be outside
        low, high = low - room, high + room
        self._span = (curve.begin, curve.end, low, high)
        self._chart.scales = {
            "x": uplot.Scale(time=False, range=(curve.begin, curve.end)),
            "y": uplot.Scale(range=(low, high)),
        }
        time_axis = uplot.Axis(ticks={"show": False}, label="time [s]", labelSize=LABEL_HEIGHT, size=26)
        self._chart.axes = (time_axis, value_axis(low, high, self._y_label))
        return low, high


def title(name: FieldName, unit: str, curve: Curve) -> str:
    """Return a signal's name with its value at the cursor, or its last one, as HTML; and a note on missing data."""
    is_past = np.isfinite(curve.values)
    if curve.cursor is not None:
        is_past &= curve.seconds <= curve.cursor
    past = np.flatnonzero(is_past)
    value = f" {curve.values[past[-1]]:.4g} {unit}" if len(past) else ""
    note = joined(tag("br"), tag("span", curve.note, style="opacity:.8")) if curve.note else ""
    return _line(str(name), tag("b", value), note)


def columns(curve: Curve, low: float, high: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the browser's columns between `low` and `high`: times, values, gaps, and the cursor.

    The last two step from far below to far above the visible range, so that only their edges or areas are visible. This
    avoids NaN, across which the browser would draw a line.
    """
    below, above = low - BEYOND * (high - low), high + BEYOND * (high - low)
    seconds, values = thinned(*broken_at_gaps(*_to_the_edges(curve)), PIXELS)
    is_gap = np.isnan(values)
    # At the edges of a gap two points share a time, so that it begins and ends with a step.
    edges = np.flatnonzero(is_gap[1:] != is_gap[:-1])
    at = np.where(is_gap[edges], edges + 1, edges)
    seconds, values = np.insert(seconds, edges + 1, seconds[at]), np.insert(values, edges + 1, values[at])
    is_gap = np.insert(is_gap, edges + 1, True)
    known = np.flatnonzero(np.isfinite(values))
    values, gaps = np.interp(np.arange(len(values)), known, values[known]), np.where(is_gap, above, below)
    if curve.cursor is None:
        return seconds, values, gaps, np.full(len(seconds), below)
    cursor = min(max(curve.cursor, curve.begin), curve.end)
    place = int(np.searchsorted(seconds, cursor))
    here = (cursor, float(np.interp(cursor, seconds, values)), gaps[max(place - 1, 0)])
    # Two points at one time, between which the cursor rises; the curve continues through them.
    seconds, values, gaps = (np.insert(c, place, [h, h]) for c, h in zip((seconds, values, gaps), here, strict=True))
    return seconds, values, gaps, np.where(np.arange(len(seconds)) > place, above, below)


def _to_the_edges(curve: Curve) -> tuple[Floats, Floats]:
    """Return a curve with NaN for invalid values, extended to both edges of its window."""
    values = np.where(np.isfinite(curve.values), curve.values, np.nan)
    seconds = curve.seconds
    if seconds[0] > curve.begin:
        seconds, values = np.append(curve.begin, seconds), np.append(values[0], values)
    if seconds[-1] < curve.end:
        seconds, values = np.append(seconds, curve.end), np.append(values, values[-1])
    return seconds, values


def _line(*parts: str) -> str:
    return plain(tag("div", *parts, style="font-size:12px;line-height:1.3;padding:6px 12px 0"))
