"""The page with the joystick: nobody drives without the token, and what it says goes to a process of its own."""

import json
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.connection import Connection

from cmr.view.driving import DriveSessions
from cmr.view.entrance.guesses import Guesses
from cmr.view.entrance.refusals import Refusals
from tests.view.serving import PATIENCE, TOKEN, Serving

HANDS = "/drive/hands"
# Says a beat, repeats what it hears in a file, and complains at its end.
PROCESS = """
import sys
with open(sys.argv[1], "a", buffering=1) as heard:
    print(sys.argv[2:], file=heard)
    print('{"beat": 1}', flush=True)
    for line in sys.stdin:
        heard.write(line)
        if "faster" in line:
            sys.exit("somebody took over the robot.")
    print("closed", file=heard)
"""


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Serving]:
    serving = Serving(tmp_path, DriveSessions, PROCESS, 18280)
    yield serving
    serving.server.stop()


def say(connection: Connection, **what: object) -> None:
    connection.send(json.dumps(what))


def hear(connection: Connection) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(connection.recv(PATIENCE))
    return answer


def test_the_page_is_served_and_only_its_own_scripts_connect(page: Serving) -> None:
    request = HTTPConnection("127.0.0.1", page.port)
    request.request("GET", "/drive")
    answer = request.getresponse()
    assert answer.status == 200
    assert b"joystick" in answer.read()
    assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
    with pytest.raises(InvalidStatus, match="403"):
        page.connect(HANDS, "http://elsewhere.example")
    page.connect(HANDS, f"http://127.0.0.1:{page.port}").close()


def test_a_visitor_with_the_token_has_a_process_that_ends_with_the_page(page: Serving) -> None:
    with page.connect(HANDS) as visitor:
        say(visitor, robot=7)
        say(visitor, token="a guess")
        assert hear(visitor)["granted"] is False
        assert page.text() == ""
        say(visitor, token=TOKEN)
        assert hear(visitor)["granted"] is True
        visitor.send("nonsense")
        say(visitor, robot=7, take_over=True)
        assert hear(visitor) == {"beat": 1}
        say(visitor, beat=1, forward=0.5, turn=-0.25)
        say(visitor, beat=1, forward=7.5)
        say(visitor, request="stop")
        page.until(lambda: "stop" in page.text())
    page.until(lambda: "closed" in page.text())
    first, hands, request, _ = page.text().splitlines()
    assert first == "['7', 'True']"
    assert json.loads(hands) == {"beat": 1, "forward": 0.5, "turn": -0.25}
    assert json.loads(request)["request"] == "stop"


def test_what_a_process_says_at_its_end_is_shown(page: Serving) -> None:
    with page.connect(HANDS) as visitor:
        say(visitor, token=TOKEN)
        hear(visitor)
        say(visitor, robot=0)
        hear(visitor)
        say(visitor, request="faster")
        assert hear(visitor) == {"ended": "somebody took over the robot."}


def test_too_many_do_not_drive_at_once(page: Serving) -> None:
    visitors = [page.connect(HANDS) for _ in range(5)]
    for visitor in visitors:
        say(visitor, token=TOKEN)
        hear(visitor)
        say(visitor, robot=0)
    assert ["ended" in hear(visitor) for visitor in visitors] == [False, False, False, False, True]
    for visitor in visitors:
        visitor.close()


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"robot": -1}', '{"forward": 2}', '{"forward": "1"}', '{"request": "release"}', '{"x": 1}', "{" * 500],
)
def test_what_no_page_says_is_refused(text: str) -> None:
    sessions = DriveSessions(lambda _robot, _takes_over: [], TOKEN, Guesses(Refusals()))
    assert not sessions.takes(text)
    assert not sessions.takes(text.encode())
