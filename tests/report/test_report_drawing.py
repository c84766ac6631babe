"""What every report promises: readable colours on light and dark pages, contents, values of curves, bounded swarms."""

import re

import numpy as np
import pytest

from cmr.experiments.live.page import run_page
from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR
from cmr.report.density import CELL, MOST_LINES, density, passes
from cmr.report.markup import Html
from cmr.report.numbers import typeset
from cmr.report.page import MOST_WITHOUT_CONTENTS, page_of
from cmr.report.section import paragraph, section
from cmr.report.style import DARK, DENSITY_STEPS, LIGHT, TONES, style_sheet
from cmr.report.svg import Curve, Frame, line
from tests.report.run_example import document
from tests.support.html_page import Page

TEXT = ("ink", "soft", "link")
DRAWN = ("border", "simulated", "before", "found", "sample", "real-outline")
FRAME = Frame(x=(0.0, 10.0), y=(0.0, 10.0))


def contrast(one: str, other: str) -> float:
    """Contrast of two colours after WCAG 2.1."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    red, green, blue = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
def test_text_and_drawings_stand_out_from_the_page(palette: dict[str, str]) -> None:
    densities = [f"density-{step + 1}" for step in range(len(DENSITY_STEPS))]
    assert [name for name in TEXT if contrast(palette[name], palette["panel"]) < 4.5] == []
    assert [tone for tone in TONES if contrast(palette[tone], palette["paper"]) < 4.5] == []  # of a badge's text, too
    assert contrast(palette["doubt"], palette["doubt-panel"]) >= 4.5
    assert [name for name in (*DRAWN, *densities) if contrast(palette[name], palette["paper"]) < 3.0] == []
    steps = [contrast(palette[name], palette["paper"]) for name in densities]
    assert steps == sorted(steps)


def test_real_robots_are_yellow_and_simulated_ones_blue_as_everywhere() -> None:
    assert (LIGHT["real"], LIGHT["simulated"]) == (REAL_COLOUR, TWIN_COLOUR)


def test_every_colour_that_is_named_is_in_both_palettes() -> None:
    assert set(LIGHT) == set(DARK)
    text = style_sheet() + run_page(document(MOST_LINES))
    assert set(re.findall(r"var\(--([a-z0-9-]+)\)", text)) <= set(LIGHT)


@pytest.mark.parametrize("count", [MOST_WITHOUT_CONTENTS, MOST_WITHOUT_CONTENTS + 1])
def test_a_page_of_many_sections_begins_with_links_to_them(count: int) -> None:
    sections = [section(f"Part {k}: what & why?", paragraph("Words.")) for k in range(count)]
    page = Page(page_of("Title", Html(""), Html(""), [*sections, section("Empty")]))
    links = [str(link["href"]) for link in page.named("a")]
    assert links == ([f"#part-{k}-what-why" for k in range(count)] if count > MOST_WITHOUT_CONTENTS else [])
    assert {link[1:] for link in links} <= {str(heading["id"]) for heading in page.named("h2")}
    assert "Empty" not in page.text


def test_a_curve_has_the_values_of_the_points_that_are_drawn() -> None:
    x, y = np.array([0.0, 5.0, np.nan, 10.0]), np.array([0.0, 10.0, 1.0, 5.0])
    along, error = np.array([1.0, 2.0, 3.0, 4.5]), np.array([0.1, 0.2, 0.3, 0.4])
    (path,) = Page(f"<body>{line(FRAME, x, y, 'red', 1.0, curve=Curve('<mean>', along, error))}</body>").named("path")
    assert path["data-name"] == "<mean>"
    assert path["data-along"] == "1 2 4.5"
    assert path["data-error"] == "0.1 0.2 0.4"
    places = np.array(re.findall(r"[ML]([\d.]+) ([\d.]+)", str(path["d"])), float)
    width, height = FRAME.inner_width, FRAME.inner_height
    assert places == pytest.approx(np.array([[0.0, height], [0.5 * width, 0.0], [width, 0.5 * height]]), abs=0.051)


def test_a_cell_counts_each_robot_that_passed_it_once() -> None:
    there_and_back = np.array([1.0, 9.0, 1.0]), np.array([5.0, 5.0, 5.0])
    upwards = np.array([5.0, 5.0]), np.array([1.0, 9.0])
    counts = passes(FRAME, [there_and_back, there_and_back, upwards])
    row, column = (int(size * 0.5 / CELL) for size in (FRAME.inner_height, FRAME.inner_width))
    assert counts[row, column] == 3
    begin, end = (int(share * FRAME.inner_width / CELL) for share in (0.1, 0.9))
    assert np.array_equal(np.flatnonzero(counts[row]), np.arange(begin, end + 1))  # without a gap
    assert np.all(counts[row, begin : column - 1] == 2)
    assert counts.sum() == 2 * (end - begin + 1) + np.count_nonzero(counts[:, column])


def test_a_robot_that_stands_still_or_leaves_the_map_is_counted_where_it_is_seen() -> None:
    still, away = (np.full(3, 5.0), np.full(3, 5.0)), (np.array([5.0, 500.0]), np.array([5.0, 5.0]))
    assert passes(FRAME, [still]).sum() == 1
    assert 0 < np.count_nonzero(passes(FRAME, [away])) <= FRAME.inner_width / CELL


def test_a_density_tells_how_many_robots_its_colours_stand_for() -> None:
    lanes = [(np.array([1.0, 9.0]), np.full(2, 2.0 + 2.0 * (k < 3))) for k in range(20)]  # 3 robots, and 17
    page = Page(f"<body>{density(FRAME, lanes)}</body>")
    drawn = [bool(path["d"]) for path in page.named("path")]
    assert dict(zip(page.texts_of["title"], drawn, strict=True)) == {
        "1 to 3 robots passed here": True,
        "4 to 15 robots passed here": False,
        "16 to 63 robots passed here": True,
        "64 or more robots passed here": False,
    }


def test_a_swarm_is_drawn_as_a_density_and_fewer_robots_as_lines() -> None:
    few, many = (Page(run_page(document(virtual))) for virtual in (MOST_LINES - 1, MOST_LINES))
    assert len([p for p in few.named("path") if "data-name" in p]) == MOST_LINES
    assert [p["data-name"] for p in many.named("path") if "data-name" in p] == ["robot 0"]  # the real one
    assert f"{MOST_LINES} robots are drawn as a density" in many.text
    assert "density" not in few.text


def test_the_page_of_a_thousand_robots_can_be_mailed() -> None:
    assert len(run_page(document(1000))) < 600_000


def test_texts_on_a_page_have_raised_exponents_and_signs_of_their_own() -> None:
    text = "w = w_wheels (1 - 0.2 s^2/m^2 v^2), -0.2 +- 0.1 s^-1 in run-1 of 2026-11-27"
    assert typeset(text) == (
        "w = w_wheels (1 \u2212 0.2 s\u00b2/m\u00b2 v\u00b2), \u22120.2 \u00b1 0.1 s\u207b\u00b9 in run-1 of 2026-11-27"
    )
