"""Take pictures of the page of cmr-view in Chromium."""

import secrets
import shutil
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import FloatRect, Page, sync_playwright

from cmr.processes.children import our_command
from cmr.view.camera import FREE, TOP

FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]
WIDE, HIGH = (1280, 800), (1180, 1010)  # pixels
TALL = (1280, 1600)  # so that a tab is shown completely
NARROW = (640, 620)
POLL_PERIOD = 50.0  # ms between checks whether a motion has begun
TIMEOUT = 120e3  # ms; the page is slow without a graphics card
MARGIN = 5  # pixels
PANEL, TIME_BAR = 388, 26  # pixels: width of the panel, height of the time bar
FILMED = (900 + PANEL, 560 + TIME_BAR)
SCALE, COLOURS = 0.8, 128  # of a film: scale relative to the page, number of colours
ZOOM_OUT = 150  # pixels of the mouse wheel, to show the whole floor
MOVING, LAST = 1.5e3, 4.0  # ms until the scene shows another time; s for which the last picture is shown
READING, DRAWING = 8e3, 8e3  # ms until the log is read, and until the charts are drawn


def take_tab(log: Path, seconds: float, tab: str, path: Path) -> None:
    """Write a picture of a tab of the panel, at a time [s] after the beginning of a log."""
    with opened(log, seconds, tab, TALL) as page:
        page.screenshot(path=path, clip=_below_tabs(page))


def take_window(log: Path, seconds: float, tab: str, path: Path, scene: tuple[str, ...] = ()) -> None:
    """Write a picture of the whole page; `scene` are options of cmr-view for objects in the scene."""
    with opened(log, seconds, tab, WIDE, scene) as page:
        page.screenshot(path=path)


def take_plots(log: Path, seconds: float, window: str, signals: Sequence[tuple[str, str]], path: Path) -> None:
    """Write a picture of the page with plots of signals, each a channel and one of its fields, over a time window."""
    with opened(log, seconds, "plots", HIGH) as page:
        for channel, signal in signals:
            _choose(page, "channel", channel)
            _choose(page, "signal", signal)
        _choose(page, "time", window)
        page.wait_for_timeout(DRAWING)
        page.screenshot(path=path)


def take_bringup(folder: Path, path: Path) -> None:
    """Write a picture of the bring-up page with an emulated robot, while its first motor turns."""
    robot = folder / "robot"
    emulator = subprocess.Popen([our_command("cmr-emulate"), "--ports", robot, "--hands", "--ideal"])
    ports = ["robot/motor", "robot/gyro"]  # relative to the folder in which cmr-view runs
    token, url = secrets.token_urlsafe(12), "udpm://239.255.76.67:7698?ttl=0"
    try:
        with (
            serving("--token", token, "--lcm-url", url, "--ports", *ports, folder=folder) as address,
            browser(NARROW) as page,
        ):
            page.goto(f"{address}/bringup")
            page.fill("#token", token)
            page.fill("#steps", "devices motors")
            page.click("text=begin")
            page.click("#choices button")
            page.wait_for_function(
                "!document.getElementById('stop').hidden", polling=POLL_PERIOD
            )  # visible for a second
            page.screenshot(path=path)
    finally:
        emulator.terminate()
        emulator.wait()


def film(log: Path, seconds: Sequence[float], frame: float, path: Path, scene: tuple[str, ...] = ()) -> None:
    """Write a GIF of the scene at these times of a log, each shown for `frame` [s]; `scene` as in take_window."""
    with opened(log, seconds[0], "view", FILMED, scene) as page:
        clip: FloatRect = {"x": 0, "y": 0, "width": FILMED[0] - PANEL, "height": FILMED[1] - TIME_BAR}
        page.mouse.move(0.5 * clip["width"], 0.5 * clip["height"])
        page.mouse.wheel(0, ZOOM_OUT)
        page.wait_for_timeout(DRAWING)
        pictures = []
        for moment in seconds:
            page.get_by_label("go to").fill(f"{moment:.2f}")
            page.wait_for_timeout(MOVING)
            picture = Image.open(BytesIO(page.screenshot(clip=clip))).convert("RGB")
            pictures.append(picture.resize((round(SCALE * picture.width), round(SCALE * picture.height))))
    palette = pictures[len(pictures) // 2].quantize(COLOURS)  # one palette for all pictures
    shown = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    durations = [round(1e3 * frame)] * (len(shown) - 1) + [round(1e3 * LAST)]
    shown[0].save(path, save_all=True, append_images=shown[1:], duration=durations, loop=0, optimize=True)


@contextmanager
def opened(log: Path, seconds: float, tab: str, size: tuple[int, int], scene: tuple[str, ...] = ()) -> Iterator[Page]:
    """Open the page of a log, paused at a time [s], with a tab of the panel in front."""
    with serving(str(log), *scene) as address, browser(size) as page:
        page.goto(address)
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(READING)
        page.get_by_role("button", name="pause", exact=True).or_(page.get_by_role("button", name="play again")).click()
        page.get_by_label("go to").fill(f"{seconds:.2f}")
        page.wait_for_timeout(DRAWING)
        for note in page.get_by_role("button", name="close").all():  # the note that there is no graphics card
            note.click()
        page.get_by_role("tab", name="view").click()
        for mode in (FREE, TOP):  # centres the view above the robots
            _choose(page, "camera", mode)
        page.get_by_role("tab", name=tab).click()
        page.mouse.move(0, 0)
        page.wait_for_timeout(DRAWING)
        yield page


def _choose(page: Page, label: str, text: str) -> None:
    page.get_by_role("combobox", name=label, exact=True).fill(text)
    page.get_by_role("option", name=text, exact=True).click()


def _below_tabs(page: Page) -> FloatRect:
    """Return the area of the page with the contents of the tab: below the tabs, down to the last chart."""
    tabs = [tab.bounding_box() for tab in page.get_by_role("tab").all()]
    charts = [chart.bounding_box() for chart in page.locator("canvas").all()]
    top = max(box["y"] + box["height"] for box in tabs if box)
    left = min(box["x"] for box in tabs if box)
    bottom = max(box["y"] + box["height"] for box in charts if box and box["x"] > left)
    return {"x": left, "y": top + MARGIN, "width": TALL[0] - left, "height": bottom - top}


@contextmanager
def serving(*options: str, folder: Path | None = None) -> Iterator[str]:
    """Serve the page of cmr-view with these options, in a folder; yield its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [our_command("cmr-view"), "--port", str(port), *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, cwd=folder)
    try:
        assert process.stderr
        process.stderr.readline()  # the address is printed when the page is available
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.communicate()


@contextmanager
def browser(size: tuple[int, int]) -> Iterator[Page]:
    """Open a window of this size in the system's Chromium, or in playwright's if there is none."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = chromium.new_page(viewport={"width": size[0], "height": size[1]})
        page.set_default_timeout(TIMEOUT)
        try:
            yield page
        finally:
            chromium.close()
