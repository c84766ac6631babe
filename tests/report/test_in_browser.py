"""Reports in a real browser, light, dark, and on a phone: accessible, within the screen, values at the pointer."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright

from cmr.diagnosis.report import report_of
from cmr.report.density import MOST_LINES
from cmr.scenario.page import run_page
from tests.report.run_example import document
from tests.support.diagnosis_example import FOUND, SPOILT, STRANGE

CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.waits,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium; apt-get install chromium"),
]
REPORTS: dict[str, Callable[[], str]] = {
    "effects": lambda: report_of(FOUND),
    "unexplained": lambda: report_of(STRANGE),
    "bad data": lambda: report_of(SPOILT),
    "run": lambda: run_page(document(3)),
    "swarm": lambda: run_page(document(2 * MOST_LINES)),
}
UNFOLD = "document.querySelectorAll('details').forEach((one) => (one.open = true))"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reports")
    for name, made in REPORTS.items():
        (folder / f"{name}.html").write_text(made(), encoding="utf-8")
    return folder


def opened(browser: Browser, file: Path, *, width: int = 1200, dark: bool = False) -> Page:
    """A report as somebody sees it who prefers light or dark pages."""
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light")
    page.goto(file.as_uri())
    return page


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("name", REPORTS)
def test_a_report_is_accessible_and_fits_a_phone(browser: Browser, folder: Path, name: str, dark: bool) -> None:
    page = opened(browser, folder / f"{name}.html", width=390, dark=dark)
    page.evaluate(UNFOLD)
    found = Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") is not dark
    page.close()


def test_paper_is_light_whatever_the_screen_is_and_has_what_is_folded(browser: Browser, folder: Path) -> None:
    page = opened(browser, folder / "effects.html", dark=True)
    thumbnail = page.locator("details svg[role=img]").first
    assert not thumbnail.is_visible()
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert thumbnail.bounding_box()
    page.close()


def test_the_values_of_a_curve_are_told_at_the_pointer_and_by_keys(browser: Browser, folder: Path) -> None:
    page = opened(browser, folder / "effects.html")
    reading, plot = page.locator(".reading"), page.locator("svg[data-x='time [s]']").first
    box = plot.bounding_box()
    assert box
    plot.hover(position={"x": 0.6 * box["width"], "y": 0.5 * box["height"]})
    time, *values = reading.inner_text().splitlines()
    assert time.startswith("time [s]: 3")  # of 60 s, and the axis begins somewhat right of the left edge
    assert sorted(value.partition(":")[0] for value in values) == ["after [m]", "before [m]"]
    plot.focus()
    page.keyboard.press("ArrowRight")
    assert reading.inner_text() != "\n".join([time, *values])
    page.keyboard.press("Escape")
    assert not reading.is_visible()
    page.close()


def test_on_a_map_a_moment_is_told_of_all_robots(browser: Browser, folder: Path) -> None:
    page = opened(browser, folder / "run.html")
    page.locator("svg[data-x]").focus()
    page.keyboard.press("ArrowRight")
    time, *robots = page.locator(".reading").inner_text().splitlines()
    assert time == "time [s]: 0.00"
    assert sorted(robot.partition(":")[0] for robot in robots) == ["robot 0", "robot 1", "robot 2", "robot 3"]
    page.close()
