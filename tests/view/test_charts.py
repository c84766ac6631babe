"""The charts of the page's panels say themselves which span of time and values they show."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from cmr.view.charts import Chart

Floats = Any


class Gui:
    """What a page is built with, as far as charts use it; counts how often a chart is given other axes."""

    def __init__(self) -> None:
        self.remade = 0
        self.chart: Any = None

    def add_uplot(self, data: Any, series: Any, **properties: Any) -> Any:
        gui = self

        class Handle(SimpleNamespace):
            def __setattr__(self, name: str, value: Any) -> None:
                gui.remade += name == "scales"
                super().__setattr__(name, value)

        self.chart = Handle(data=data, series=series, **properties)
        self.remade = 0
        return self.chart


def columns(begin: float, end: float) -> Floats:
    seconds = np.linspace(begin, end, 5)
    return np.array([seconds, seconds, seconds + 1.0, seconds - 1.0])


def test_a_chart_shows_the_time_of_its_data_wherever_the_log_jumps_to() -> None:
    gui = Gui()
    chart: Any = Chart(gui, "k1 [s/rad]", with_interval=True)  # type: ignore[arg-type]
    for begin, end in ((14.8, 87.3), (14.8, 17.0), (18.8, 60.0)):
        chart.show(columns(begin, end))
        assert gui.chart.visible
        assert gui.chart.scales["x"]["range"] == (begin, end)
        low, high = gui.chart.scales["y"]["range"]
        assert low < begin - 1.0 < end + 1.0 < high
        assert gui.chart.data[0].tolist() == np.linspace(begin, end, 5).tolist()


def test_a_chart_is_made_again_only_for_another_span() -> None:
    gui = Gui()
    chart: Any = Chart(gui, "k1 [s/rad]", with_interval=True)  # type: ignore[arg-type]
    chart.show(columns(2.0, 8.0))
    chart.show(columns(2.0, 8.0))
    assert gui.remade == 1
    chart.show(columns(2.0, 9.0))
    assert gui.remade == 2


def test_a_chart_of_a_single_moment_is_hidden() -> None:
    gui = Gui()
    chart: Any = Chart(gui, "k1 [s/rad]", with_interval=True)  # type: ignore[arg-type]
    for hidden in (np.empty((4, 0)), np.ones((4, 1)), np.ones((4, 2))):
        chart.show(columns(2.0, 8.0))
        assert gui.chart.visible
        chart.show(hidden)
        assert not gui.chart.visible
