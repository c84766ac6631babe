"""Everybody who sees can read the page: its colours are distinct without red and green, its texts stand out."""

from itertools import combinations

import numpy as np
import pytest

from cmr.bus.world_state import WorldState
from cmr.view.log_index import Mark
from cmr.view.look import LEGEND, legend, time_bar
from cmr.view.picture import COLOURS, TRAIL_COLOURS
from cmr.view.state import ViewState

# How a deuteranope sees linear red, green and blue (Machado, Oliveira and Fernandes 2009, severity 1.0).
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]
)
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])  # sRGB, IEC 61966-2-1
WHITE_POINT = np.array([0.9505, 1.0, 1.089])
WHITE = (255, 255, 255)  # the floor
DISTINCT = 25.0  # CIE 1976 colour difference; 2.3 is just noticeable side by side


def linear(colour: tuple[int, int, int]) -> np.ndarray:
    share = np.array(colour) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(light: np.ndarray) -> np.ndarray:
    x, y, z = np.cbrt(TO_XYZ @ light / WHITE_POINT)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("eyes", [np.eye(3), DEUTERANOPIA], ids=["usual", "deuteranope"])
def test_no_two_colours_of_the_legend_look_alike_and_none_is_lost_on_the_floor(eyes: np.ndarray) -> None:
    seen = {name: lab(np.clip(eyes @ linear(colour), 0.0, 1.0)) for colour, name in (*LEGEND, (WHITE, "floor"))}
    distances = {pair: float(np.linalg.norm(seen[pair[0]] - seen[pair[1]])) for pair in combinations(seen, 2)}
    assert min(distances.values()) > DISTINCT, min(distances, key=lambda pair: distances[pair])


def test_the_legend_has_every_colour_in_which_robots_and_their_trails_are_drawn() -> None:
    in_legend = {colour for colour, _ in LEGEND}
    assert {*COLOURS.values(), *TRAIL_COLOURS.values()} <= in_legend
    state = ViewState()
    columns = (np.arange(3), np.array([0, 1, 2]), *np.zeros((7, 3)))
    state.handle(1, "WORLD_STATE", WorldState(1, *columns))
    assert all(f"rgb({red},{green},{blue})" in legend(state, False) for red, green, blue in COLOURS.values())


def test_the_time_bar_shows_where_the_log_is_and_its_events() -> None:
    marks = [(30.0, Mark(30_000_000, "stop", 'said "stop" & <stayed>')), (90.0, Mark(90_000_000, "released", "go"))]
    bar = time_bar(45.0, 120.0, marks)
    assert 'aria-valuenow="45.0"' in bar
    assert "width:37.50%" in bar
    assert "left:25.00%" in bar
    assert "left:75.00%" in bar
    assert "<stayed>" not in bar
    assert "45.0 of 120.0 s" in bar
