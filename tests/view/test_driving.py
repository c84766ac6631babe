"""The page with the joystick: nobody drives without the token, and what it says goes to a process of its own."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection
from websockets.typing import Origin

from cmr.view.curves import LiveCurves
from cmr.view.driving import DriveSessions
from cmr.view.entrance.door import Address
from cmr.view.entrance.guesses import Guesses
from cmr.view.entrance.refusals import Refusals
from cmr.view.orders import Orders
from cmr.view.server import PageServer
from cmr.view.visit import NO_ROOM
from tests.support.view_states import NOW, showing, three

TOKEN = "a secret of the test"
PATIENCE = 30.0  # s
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


class Serving:
    """A page that drives by processes that only write down what they hear."""

    def __init__(self, folder: Path) -> None:
        self.heard = folder / "heard.txt"
        live: Any = SimpleNamespace(
            **{"state": showing(three(NOW)), "orders": Orders(), "name": "live", "curves": LiveCurves()},
            **{"panel": lambda: None, "head": lambda: "", "sources": list},
        )

        def command(robot_id: int, takes_over: bool) -> list[str]:
            return [sys.executable, "-c", PROCESS, str(self.heard), str(robot_id), str(takes_over)]

        beside = [partial(DriveSessions, command)]
        self.server = PageServer(Address("127.0.0.1", 18280), TOKEN, NO_ROOM, live, beside)
        self.port = int(self.server.url.rsplit(":", 1)[1])

    def connect(self, origin: str | None = None) -> ClientConnection:
        named = Origin(origin) if origin is not None else None
        return connect(f"ws://127.0.0.1:{self.port}/drive/hands", origin=named, compression=None)

    def text(self) -> str:
        with suppress(FileNotFoundError):
            return self.heard.read_text()
        return ""

    def until(self, is_true: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not is_true():
            assert time.monotonic() < end, self.text()
            time.sleep(0.01)


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Serving]:
    serving = Serving(tmp_path)
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
        page.connect("http://elsewhere.example")
    page.connect(f"http://127.0.0.1:{page.port}").close()


def test_a_visitor_with_the_token_has_a_process_that_ends_with_the_page(page: Serving) -> None:
    with page.connect() as visitor:
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
        say(visitor, wish="stop")
        page.until(lambda: "stop" in page.text())
    page.until(lambda: "closed" in page.text())
    first, hands, wish, _ = page.text().splitlines()
    assert first == "['7', 'True']"
    assert json.loads(hands) == {"beat": 1, "forward": 0.5, "turn": -0.25}
    assert json.loads(wish)["wish"] == "stop"


def test_what_a_process_says_at_its_end_is_shown(page: Serving) -> None:
    with page.connect() as visitor:
        say(visitor, token=TOKEN)
        hear(visitor)
        say(visitor, robot=0)
        hear(visitor)
        say(visitor, wish="faster")
        assert hear(visitor) == {"ended": "somebody took over the robot."}


def test_too_many_do_not_drive_at_once(page: Serving) -> None:
    visitors = [page.connect() for _ in range(5)]
    for visitor in visitors:
        say(visitor, token=TOKEN)
        hear(visitor)
        say(visitor, robot=0)
    assert ["ended" in hear(visitor) for visitor in visitors] == [False, False, False, False, True]
    for visitor in visitors:
        visitor.close()


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"robot": -1}', '{"forward": 2}', '{"forward": "1"}', '{"wish": "release"}', '{"x": 1}', "{" * 500],
)
def test_what_no_page_says_is_refused(text: str) -> None:
    sessions = DriveSessions(lambda _robot, _takes_over: [], TOKEN, Guesses(Refusals()))
    assert not sessions.takes(text)
    assert not sessions.takes(text.encode())
