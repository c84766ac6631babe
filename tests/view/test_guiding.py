"""The page that guides through bring-up: steps of a process are shown and answered, a motion is ended in a browser."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, sync_playwright

from cmr.view.entrance.guesses import Guesses
from cmr.view.entrance.refusals import Refusals
from cmr.view.guiding import GuideSessions
from tests.view.serving import PATIENCE, TOKEN, Serving

CHROMIUM = shutil.which("chromium")
in_browser = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium; apt-get install chromium")
pytestmark = pytest.mark.waits

STEPS = "/bringup/steps"
# Guides through four steps, as cmr bringup does, and writes down what was answered.
PROCESS = """
import sys, time
from robot_driver.guided import Choice, Guide, Left, Remote
with open(sys.argv[1], "a", buffering=1) as heard:
    print(sys.argv[2:], file=heard)
    guide = Guide(Remote(silence=float("inf")), time.sleep)
    try:
        print(guide.ask("a", "Is it lifted?", (Choice("yes", "its wheels are off the floor"),)), file=heard)
        guide.say("note", "== Step motors ==")
        print(guide.number("b", "How large is the radius?", "mm", 5.0, 1000.0), file=heard)
        start = time.monotonic()
        with guide.motion("c", "The motor turns now.", 600.0) as motion:
            while not motion.ended(time.monotonic() - start):
                time.sleep(0.01)
        print("ended", motion.by_person, file=heard)
        guide.ask("d", "What did you see?", (Choice("lf", "the left wheel, forward"), Choice("no", "nothing")))
    except Left:
        print("left", file=heard)
        sys.exit("The page is closed.")
    guide.say("e", "motors: both motors were seen to turn.")
"""


@pytest.fixture
def serving(tmp_path: Path) -> Iterator[Serving]:
    serving = Serving(tmp_path, GuideSessions, PROCESS, 18380)
    yield serving
    serving.server.stop()


def test_nobody_brings_up_without_the_token_and_a_page_that_closes_ends_it(serving: Serving) -> None:
    def say(**what: object) -> None:
        page.send(json.dumps(what))

    def hear() -> dict[str, Any]:
        told: dict[str, Any] = json.loads(page.recv(PATIENCE))
        return told

    with serving.connect(STEPS) as page:
        say(robot=7)
        say(token="a guess")
        assert hear()["granted"] is False
        assert serving.text() == ""
        say(token=TOKEN)
        assert hear()["granted"] is True
        say(robot=7, steps=["gyro", "floor"])
        assert hear()["text"] == "Is it lifted?"
        with serving.connect(STEPS) as second:
            second.send(json.dumps({"token": TOKEN}))
            second.recv(PATIENCE)
            second.send(json.dumps({"robot": 8}))
            assert "another page" in json.loads(second.recv(PATIENCE))["ended"]
        say(step=1, answer="yes")
        serving.until(lambda: "yes" in serving.text())
    serving.until(lambda: "left" in serving.text())
    assert serving.text().splitlines()[0] == "['7', 'gyro', 'floor']"


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"robot": -1}', '{"steps": ["--page"]}', '{"steps": "gyro"}', '{"step": 1, "answer": 2}', '{"x": 1}'],
)
def test_what_no_page_says_is_refused(text: str) -> None:
    sessions = GuideSessions(lambda _robot, _steps: [], TOKEN, Guesses(Refusals()))
    assert not sessions.takes(text)


@in_browser
def test_a_person_is_guided_in_a_browser_and_stops_a_motion(serving: Serving) -> None:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 420, "height": 800})
        page.set_default_timeout(1e3 * PATIENCE)
        page.goto(f"http://127.0.0.1:{serving.port}/bringup")
        page.fill("#token", TOKEN)
        page.click("text=begin")
        page.click("text=its wheels are off the floor")
        page.fill("#value", "4")
        page.click("text=continue")
        page.wait_for_selector("text=from 5 to 1000")
        assert_accessible(page)
        page.fill("#value", "40")
        page.click("text=continue")
        page.wait_for_selector("text=The motor turns now.")
        page.click("#stop")
        page.click("text=the left wheel, forward")
        page.wait_for_selector("text=motors: both motors were seen to turn.")
        assert_accessible(page)
        browser.close()
    assert serving.text().splitlines()[1:] == ["yes", "40.0", "ended True"]


def assert_accessible(page: Page) -> None:
    assert Axe().run(page).violations_count == 0
