"""Pictures of the page of cmr-view, as Chromium draws it."""

import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import FloatRect, Page, sync_playwright

from cmr.scenario.children import our_command

FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]
SIZE = (1280, 1600)  # pixels; high enough that a tab shows all it has
PATIENCE = 120e3  # ms; without a graphics card the page takes its time
MARGIN = 5  # pixels
READING, DRAWING = 15e3, 20e3  # ms until the log is read, and until the charts are drawn


def take_tab(log: Path, seconds: float, tab: str, path: Path) -> None:
    """Write a picture of a tab of the panel, as it is so many seconds after the beginning of a log."""
    with serving(log) as address, browser() as page:
        page.goto(address)
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(READING)
        page.get_by_label("go to").fill(f"{seconds:.0f}")
        page.get_by_label("go to").press("Enter")
        page.wait_for_timeout(DRAWING)
        page.screenshot(path=path, clip=_below_tabs(page))


def _below_tabs(page: Page) -> FloatRect:
    """Return where on the page the contents of the tab are: below the tabs, down to the last chart."""
    tabs = [tab.bounding_box() for tab in page.get_by_role("tab").all()]
    charts = [chart.bounding_box() for chart in page.locator("canvas").all()]
    top = max(box["y"] + box["height"] for box in tabs if box)
    left = min(box["x"] for box in tabs if box)
    bottom = max(box["y"] + box["height"] for box in charts if box and box["x"] > left)
    return {"x": left, "y": top + MARGIN, "width": SIZE[0] - left, "height": bottom - top}


@contextmanager
def serving(log: Path) -> Iterator[str]:
    """Serve the page of a log; return its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen([our_command("cmr-view"), str(log), "--port", str(port)], stderr=subprocess.PIPE)
    try:
        assert process.stderr
        process.stderr.readline()  # it says so once the page can be had
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.communicate()


@contextmanager
def browser() -> Iterator[Page]:
    """Open Chromium, the system's if there is one, else playwright's."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = chromium.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        page.set_default_timeout(PATIENCE)
        try:
            yield page
        finally:
            chromium.close()
