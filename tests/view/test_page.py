"""cmr-view in a real browser: robots, cameras and logs are seen, it survives a restart and stops without token."""

import math
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, sync_playwright

from cmr.bus.bus import Bus
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import CALIBRATION_STATUS, CAMERA_IMAGE, ESTOP, WORLD_STATE
from cmr.bus.world_state import WorldState
from cmr.msg import calibration_status_t, camera_image_t
from cmr.recordings.events import Event, event_bytes
from cmr.view.look import TITLE
from tests.support.bus_bench import our_command
from tests.support.typed_messages import all_of

CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.waits,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium; apt-get install chromium"),
]

PATIENCE = 60.0  # s; of a machine with much else to do, on which pages are drawn without a graphics card
TOKEN = "a secret of the test"
ROBOTS = 12
EPOCH = 1_700_000_000_000_000  # us
STOP = "EMERGENCY STOP"
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]
# Nobody looks at the picture: five a second are enough, as each costs a core a tenth of a second.
FEW_PICTURES = """
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (call) => setTimeout(() => draw(call), 200);
"""
# Where the page has the robots: x of each. [m]
PLACES = """() => {
    const node = window.__viserSceneTree?.getState()["/robots"];
    const bytes = node?.message?.props?.batched_positions;
    if (!bytes) return [];
    const end = bytes.byteOffset + bytes.byteLength;
    return Array.from(new Float32Array(bytes.buffer.slice(bytes.byteOffset, end))).filter((_, k) => k % 3 == 0);
}"""


# Width and height of the camera's picture, as the browser has decoded it. [pixels]
CAMERA_SIZE = """() => {
    const image = Array.from(document.images).find((image) => image.src.startsWith("blob:"));
    return image?.complete ? [image.naturalWidth, image.naturalHeight] : [];
}"""


# Of each chart: from when to when its axis goes, and its data do. [s]
SPANS = """() => Object.values(window.__viserTestpoints?.uplots ?? {}).map(({chart}) =>
    [[chart.scales.x.min, chart.scales.x.max], [chart.data[0][0], chart.data[0].at(-1)]])"""


# Drop a file on the page, of this name and with these bytes.
DROP = """([name, bytes]) => {
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([Uint8Array.from(bytes)], name));
    for (const type of ["dragover", "drop"])
        document.body.dispatchEvent(new DragEvent(type, {dataTransfer, bubbles: true, cancelable: true}));
}"""


def camera_image(utime: int, camera: str, width: int, height: int) -> Any:
    """A picture of one grey."""
    _, jpeg = cv2.imencode(".jpg", np.full((height, width, 3), 90, np.uint8))
    return make(camera_image_t, utime=utime, camera=camera, width=width, height=height, jpeg=jpeg.tobytes())


def calibration(utime: int, progress: float) -> Any:
    """A report of a calibration that knows all parameters."""
    known = {"k2_over_k3": 117.0 + progress, "k1": 0.054, "base_width": 0.16}
    deviations = {f"{name}_std": 0.01 * value for name, value in known.items()}
    rest = {"path_rmse_before": math.nan, "path_rmse_after": math.nan, "message": ""}
    state = calibration_status_t.COLLECTING
    return make(
        calibration_status_t, utime=utime, robot_id=0, state=state, progress=progress, **known, **deviations, **rest
    )


class World(threading.Thread):
    """Robots that drive to and fro on the bus under a camera; `stops` counts the ESTOP messages that engage it."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self.stops = 0
        self._ended = threading.Event()
        self._bus = Bus(url)
        self._bus.subscribe(ESTOP, every=True)

    def run(self) -> None:
        ids, still = np.arange(ROBOTS), np.zeros(ROBOTS)
        while not self._ended.wait(0.1):
            now = now_utime()
            x, y = np.sin(now / 1e6 + ids), np.linspace(0.0, 0.3 * (ROBOTS - 1), ROBOTS)
            self._bus.publish(WORLD_STATE, WorldState(now, ids, ids % 2, x, y, *[still] * 5))
            self._bus.publish(CAMERA_IMAGE, camera_image(now, "ceiling", 64, 36))
            self.stops += sum(bool(message.engaged) for message in all_of(ESTOP, self._bus.receive(0.0)))

    def __enter__(self) -> "World":
        self.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self.join()


@contextmanager
def serving(url: str, port: int, *log: str) -> Iterator[None]:
    """cmr-view, from when its page can be had."""
    command = [our_command("cmr-view"), "--lcm-url", url, "--port", str(port), "--token", TOKEN, *log]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr
        assert process.stderr.readline().startswith(f"cmr-view: http://127.0.0.1:{port} ")
        yield
    finally:
        process.terminate()
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert said.splitlines()[-1].endswith(" stopped"), said
    assert "Traceback" not in said


@contextmanager
def browser() -> Iterator[Page]:
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = chromium.new_page(viewport={"width": 700, "height": 500})
        page.set_default_timeout(PATIENCE * 1e3)
        page.add_init_script(FEW_PICTURES)
        try:
            yield page
        finally:
            chromium.close()


def until(is_true: Callable[[], bool], page: Page) -> None:
    """Wait until something is true; what the page does goes on meanwhile."""
    end = time.monotonic() + PATIENCE
    while not is_true():
        assert time.monotonic() < end
        page.wait_for_timeout(200)


def wait_for_motion(page: Page) -> None:
    """Wait until the page has all robots, and they are elsewhere than before."""
    until(lambda: len(page.evaluate(PLACES)) == ROBOTS, page)
    before = page.evaluate(PLACES)
    until(lambda: page.evaluate(PLACES) not in (before, []), page)


def log_of_two_cameras(path: Path) -> Path:
    """A log of two seconds with a calibration under two cameras with pictures of different size, as event log."""
    events = []
    for k in range(20):
        found = calibration(EPOCH + 100_000 * k, 0.05 * k)
        events.append(Event(k, found.utime, CALIBRATION_STATUS.channel(0), found.encode()))
        for camera, width, height in (("door", 40, 30), ("window", 48, 20)):
            utime = EPOCH + 100_000 * k
            events.append(Event(k, utime, CAMERA_IMAGE.name, camera_image(utime, camera, width, height).encode()))
    path.write_bytes(b"".join(event_bytes(event) for event in events))
    return path


def drop(page: Page, path: Path) -> None:
    page.evaluate(DROP, [path.name, list(path.read_bytes())])


def choose(page: Page, label: str, text: str) -> None:
    page.get_by_role("combobox", name=label, exact=True).fill(text)
    page.get_by_role("option", name=text, exact=True).click()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def check_stop_without_token(page: Page, world: World) -> None:
    """Without the token, nothing starts and no stop is reset, but Esc stops the robots, unless it closes a list."""
    page.get_by_role("button", name="start figure-eight").click()
    page.get_by_text("Refused").first.wait_for()
    page.get_by_role("tab", name="plots").click()
    page.get_by_role("combobox", name="channel", exact=True).click()
    page.get_by_role("option").first.wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("option").first.wait_for(state="hidden")
    page.wait_for_timeout(500)
    assert world.stops == 0, "Esc closed the list"
    page.keyboard.press("Escape")
    until(lambda: world.stops > 0, page)
    page.get_by_role("button", name="reset emergency stop").click()
    page.get_by_text("Refused").first.wait_for()


def check_camera_and_plot(page: Page) -> None:
    """The camera's picture is there, and a signal of a robot is plotted."""
    until(lambda: page.evaluate(CAMERA_SIZE) == [64, 36], page)
    page.get_by_text("ceiling, 64 x 36").wait_for()
    choose(page, "channel", "WORLD_STATE robot 2")
    choose(page, "signal", "WORLD_STATE.x[robot 2]")
    page.locator(".u-over").wait_for()


def check_dropped_files(page: Page, folder: Path) -> None:
    """A log that is dropped onto the page is shown, another file is refused, and the live world comes back."""
    (folder / "notes.txt").write_text("no log")
    drop(page, folder / "notes.txt")
    page.get_by_text("notes.txt is not an LCM event log.").wait_for()
    drop(page, log_of_two_cameras(folder / "brought.lcm"))
    page.get_by_text("LOG brought.lcm").wait_for()
    until(lambda: page.evaluate(CAMERA_SIZE) == [40, 30], page)
    page.get_by_role("button", name="back to the live world").click()
    page.get_by_text("LIVE · ").wait_for()


def check_stop_with_token(page: Page) -> None:
    """With the token, a stop can be reset, once that is confirmed; the page does not hold the token."""
    page.get_by_role("textbox").first.fill(TOKEN)
    page.get_by_text("token taken").wait_for()
    assert TOKEN not in page.content()
    page.get_by_role("button", name=STOP, exact=True).click()
    page.get_by_text("EMERGENCY STOP engaged by cmr-view").wait_for()
    page.get_by_role("button", name="reset emergency stop").click()
    page.get_by_role("button", name="leave it engaged").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("button", name="leave it engaged").wait_for(state="detached")
    page.get_by_text("EMERGENCY STOP engaged by cmr-view").wait_for()


def check_log(page: Page) -> None:
    """A log is accessible to everybody and has no stop; its charts follow the time that is gone to."""
    page.get_by_text("door, 40 x 30").wait_for()
    assert page.title() == TITLE
    found = Axe().run(page).response["violations"]
    assert [(one["id"], one["nodes"][0]["html"]) for one in found] == []
    assert page.get_by_role("button", name=STOP).count() == 0, "a log has nobody to stop"
    until(lambda: page.evaluate(CAMERA_SIZE) == [40, 30], page)
    page.get_by_role("tab", name="calibration").click()
    for seconds in (1.0, 0.5, 1.5):
        page.get_by_label("go to").fill(str(seconds))
        page.wait_for_timeout(1500)  # until what was typed is taken, and drawn
        until(lambda: len(page.evaluate(SPANS)) == 3, page)
        until(lambda: all(shown == there for shown, there in page.evaluate(SPANS)), page)


def test_the_page_has_robots_and_pictures_goes_on_after_a_restart_and_stops_them_for_everybody_here(
    url: str, tmp_path: Path
) -> None:
    port = free_port()
    with World(url) as world, browser() as page:
        with serving(url, port):
            page.goto(f"http://127.0.0.1:{port}")
            wait_for_motion(page)
            check_stop_without_token(page, world)
            check_camera_and_plot(page)
            check_dropped_files(page, tmp_path)
        with serving(url, port):
            wait_for_motion(page)
            page.get_by_text(f"LIVE · {ROBOTS // 2} real, {ROBOTS // 2} virtual").wait_for()
            check_stop_with_token(page)
        with serving(url, port, str(log_of_two_cameras(tmp_path / "run.lcm"))):
            check_log(page)
