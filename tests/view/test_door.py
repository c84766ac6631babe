"""Strangers at the page: nobody comes in from a foreign page, and nothing that is sent stops it for the others."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from http.client import HTTPConnection, HTTPSConnection, RemoteDisconnected
from pathlib import Path
from ssl import create_default_context
from types import SimpleNamespace
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection
from websockets.typing import Origin, Subprotocol

from cmr.cli.errors import CommandError
from cmr.commands.view import _encryption
from cmr.view.camera import FOLLOW
from cmr.view.curves import LiveCurves
from cmr.view.entrance import door, guesses
from cmr.view.entrance.door import Address
from cmr.view.entrance.guesses import FREE, Guesses
from cmr.view.entrance.refusals import Refusals
from cmr.view.orders import Orders
from cmr.view.requests import Permission
from cmr.view.server import PageServer
from cmr.view.visit import NO_ROOM
from tests.support.page_visitor import CAMERA, PROTOCOL, Stranger, camera, names_of_parts, packed, told
from tests.support.view_states import NOW, showing, three

TOKEN = "a secret of the test"
PATIENCE = 30.0  # s


class Serving:
    """A page of three robots that is served at some port of this computer."""

    def __init__(self, names: tuple[str, ...] = (), tls: Any = None) -> None:
        live: Any = SimpleNamespace(
            **{"state": showing(three(NOW)), "orders": Orders(), "name": "live", "curves": LiveCurves()},
            **{"panel": lambda: None, "head": lambda: "", "sources": list},
        )
        self.server = PageServer(Address("127.0.0.1", 18080, names, tls), TOKEN, NO_ROOM, live)
        self.port = int(self.server.url.rsplit(":", 1)[1])

    def connect(self, origin: str | None = None, **options: Any) -> ClientConnection:
        asked = [Subprotocol(PROTOCOL)]
        named = Origin(origin) if origin is not None else None
        address = f"ws://127.0.0.1:{self.port}"
        return connect(address, origin=named, subprotocols=asked, compression=None, **options)

    def visit(self) -> ClientConnection:
        """Return a connection whose page is there."""
        connection, before = self.connect(), set(self.server.visits)
        connection.send(camera())
        self.until(lambda: bool(set(self.server.visits) - before))
        return connection

    def turn(self) -> None:
        """Do what cmr-view does twenty times a second."""
        self.server.requested(NOW)
        self.server.show(0.05)

    def until(self, is_true: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not is_true():
            assert time.monotonic() < end
            self.turn()
            time.sleep(0.01)


@pytest.fixture(scope="module")
def page() -> Iterator[Serving]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(door, "MOST_A_SECOND", 1e6)  # the tests have no time
        serving = Serving()
        yield serving
        serving.server.stop()


def answer(page: Serving, path: str = "/", **headers: str) -> tuple[int, str]:
    with closing(HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE)) as connection:
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        return response.status, response.read().decode(errors="replace")


def reason_of_closing(connection: Connection) -> str:
    try:
        while True:
            connection.recv(timeout=PATIENCE)
    except ConnectionClosed as closed:
        return closed.rcvd.reason if closed.rcvd else ""


# Who comes in


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "LOCALHOST:9", "localhost.:80"])
def test_the_page_is_had_under_our_own_names(page: Serving, host: str) -> None:
    assert answer(page, Host=host)[0] == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:18080", "192.0.2.7", "localhost.evil.example", "", "[", "::1"]
)
def test_a_foreign_name_that_points_here_is_refused(page: Serving, host: str) -> None:
    status, text = answer(page, Host=host)
    assert status == 403
    assert "--allow-host" in text


@pytest.mark.parametrize("host", ["203.0.113.1", "nowhere.invalid", "2001:db8::1"])
def test_an_address_that_is_not_ours_is_said_instead_of_waiting(host: str) -> None:
    with pytest.raises(OSError, match=r"(Cannot assign|not known|failure|No address)"):
        Address(host, 8080).check()


def test_names_that_are_allowed_and_this_hosts_own_address_are_taken() -> None:
    checked = door.Door(Address("0.0.0.0", 8080, ("robots.lab",)), Refusals())
    named: dict[str, list[str]] = {}
    request: Any = SimpleNamespace(path="/", headers=SimpleNamespace(get_all=lambda name: named[name]))
    for host, own, is_taken in (
        ("robots.lab:8080", "10.0.0.4", True),
        ("10.0.0.4:8080", "10.0.0.4", True),
        ("10.0.0.5:8080", "10.0.0.4", False),
        ("[fe80::1]:8080", "fe80::1%eth0", True),
    ):
        named = {"Host": [host], "Origin": []}
        assert (checked.why_not(request, own) == "") == is_taken, host
        named = {"Host": [host], "Origin": [f"https://{host}"]}
        assert (checked.why_not(request, own) == "") == is_taken, host
    named = {"Host": ["localhost", "robots.lab"], "Origin": []}
    assert checked.why_not(request, "10.0.0.4")


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://localhost:3000", "http://[", "file://"])
def test_a_page_from_elsewhere_cannot_connect(page: Serving, origin: str) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        page.connect(origin)


def test_our_own_page_can_connect(page: Serving) -> None:
    page.connect(f"http://127.0.0.1:{page.port}").close()


def test_our_page_is_not_sent_to_a_foreign_server_and_shown_in_no_foreign_page(page: Serving) -> None:
    assert answer(page, "/?websocket=wss://evil.example")[0] == 403
    with closing(HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE)) as connection:
        connection.request("GET", "/")
        assert connection.getresponse().headers["X-Frame-Options"] == "DENY"


def test_so_many_pages_are_open_at_once(page: Serving, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "MOST_VISITORS", 2)
    connections = [page.connect() for _ in range(3)]
    assert reason_of_closing(connections[-1]) == "2 pages are open."
    for connection in connections:
        connection.close()


# What they send


@pytest.mark.parametrize(
    "changed",
    [
        {"image_height": 0},
        {"image_width": 0, "image_height": 0},
        {"fov": 0.0},
        {"fov": float("nan")},
        {"position": [float("nan")] * 3},
        {"position": [1e300] * 3},
        {"position": []},
        {"position": CAMERA["look_at"]},
        {"up_direction": [0.0, 0.0, 0.0]},
        {"wxyz": "none"},
    ],
)
def test_a_camera_that_cannot_be_does_not_stop_the_page(page: Serving, changed: dict[str, Any]) -> None:
    with page.visit() as connection:
        visit = list(page.server.visits.values())[-1]
        visit.page._mode.value = FOLLOW  # type: ignore[misc]
        visit.page._mode_changed, refused = True, page.server.refusals.total
        connection.send(camera(**changed))
        page.until(lambda: page.server.refusals.total > refused)
        page.turn()
        assert visit in page.server.visits.values(), "also the visitor who sent it goes on"


def test_a_page_that_cannot_be_drawn_closes_and_the_others_go_on(
    page: Serving, monkeypatch: pytest.MonkeyPatch
) -> None:
    with page.visit(), page.visit() as connection:
        broken = list(page.server.visits.values())[-1]
        monkeypatch.setattr(broken, "show", lambda *_what: 1 // 0)
        page.turn()
        assert broken not in page.server.visits.values()
        assert page.server.visits
        assert reason_of_closing(connection) == "This page cannot be drawn."


def test_the_page_survives_a_thousand_odd_messages(page: Serving, capfd: pytest.CaptureFixture[str]) -> None:
    stranger = Stranger(seed=1)
    with page.visit() as other, page.visit() as connection:
        while len(stranger.parts) < 10:
            packet = connection.recv(timeout=PATIENCE)
            assert isinstance(packet, bytes)
            stranger.parts += names_of_parts(told(packet))
        for number in range(1000):
            connection.send(stranger.message())
            if number % 20 == 0:
                page.turn()
        refused = page.server.refusals.total
        connection.send(packed({"type": "ShareUrlRequest"}))
        page.until(lambda: page.server.refusals.total > refused)
        other.send(camera())
        page.turn()
        assert len(page.server.visits) >= 2, "neither was dismissed"
        assert not any(visit.visitor.permission.granted for visit in page.server.visits.values())
    said = capfd.readouterr()
    assert "Traceback" not in said.err + said.out


def test_who_sends_faster_than_a_page_has_to_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "MOST_A_SECOND", 200.0)
    serving = Serving()
    try:
        with serving.visit() as connection:
            begun = time.monotonic()
            for _ in range(int(door.AT_ONCE + door.MOST_A_SECOND)):
                connection.send(b"")
            serving.until(lambda: serving.server.refusals.total >= door.AT_ONCE + door.MOST_A_SECOND - 5)
            assert time.monotonic() - begun > 0.8
    finally:
        serving.server.stop()


# The token


def test_wrong_tokens_are_looked_at_ever_more_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, refusals = [1000.0], Refusals()
    monkeypatch.setattr(guesses, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    counted = Guesses(refusals)
    for number in range(6000):  # ten minutes, ten a second, each over a connection of its own
        Permission(TOKEN, guesses=counted, address="10.0.0.7").try_token(f"guess {number}")
        clock[0] += 0.1
    looked_at = refusals._new["wrong tokens"]
    assert FREE < looked_at < 25
    stranger = Permission(TOKEN, guesses=counted, address="10.0.0.7")
    assert not stranger.try_token(TOKEN), "not even the right one is looked at before its time"
    assert Permission(TOKEN, guesses=counted, address="10.0.0.8").try_token(TOKEN), "others need not wait"
    clock[0] += stranger.wait + 0.1
    assert stranger.try_token(TOKEN)
    assert stranger.wait == 0.0


def test_guesses_from_a_network_count_together_and_take_a_bounded_memory() -> None:
    counted = Guesses()
    for number in range(FREE):
        counted.count(f"2001:db8::{number:x}", False)
    assert counted.wait("2001:db8::ffff") > 0.0
    for number in range(3 * guesses.MOST_ADDRESSES):
        counted.count(f"10.{number >> 16}.{number >> 8 & 255}.{number & 255}", False)
    assert len(counted._wrong) == guesses.MOST_ADDRESSES


def test_a_token_that_is_typed_counts_once_it_is_there(page: Serving) -> None:
    with page.visit():
        visit = list(page.server.visits.values())[-1]
        field, refused = visit.page._token, page.server.refusals.total
        for end in range(1, len(TOKEN) + 1):
            field.value = TOKEN[:end]  # type: ignore[misc]
            visit.page._note_typing(None)
            page.turn()
        page.until(lambda: visit.visitor.permission.granted)
        assert page.server.refusals.total == refused
        assert field.value == ""


def test_what_is_refused_is_said_in_a_sentence_of_bounded_length() -> None:
    refusals = Refusals()
    assert refusals.news() == ""
    refusals.count("wrong tokens", "10.0.0.7")
    assert refusals.news() == "Refused: 1 wrong tokens; from 10.0.0.7."
    for number in range(1000):
        refusals.count("wrong tokens", f"10.0.0.{number}")
    assert refusals.news() == "", "not so soon again"
    refusals._due = 0.0
    assert len(refusals.news()) < 200


# Encryption


@pytest.fixture
def certificate(tmp_path: Path) -> Path:
    made = "-x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -addext subjectAltName=DNS:localhost"
    command = ["openssl", "req", *made.split(), "-keyout", "key.pem", "-out", "page.pem"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    return tmp_path / "page.pem"


def test_the_page_is_encrypted_with_a_certificate(certificate: Path) -> None:
    options: Any = SimpleNamespace(certificate=str(certificate), key=str(certificate.with_name("key.pem")))
    serving = Serving(tls=_encryption(options))
    try:
        assert serving.server.url.startswith("https://")
        context = create_default_context(cafile=str(certificate))
        with closing(HTTPSConnection("localhost", serving.port, context=context, timeout=PATIENCE)) as connection:
            connection.request("GET", "/")
            assert connection.getresponse().status == 200
        with pytest.raises((RemoteDisconnected, ConnectionResetError)):
            answer(serving)
    finally:
        serving.server.stop()


def test_a_certificate_that_is_none_is_said_in_a_sentence(tmp_path: Path, certificate: Path) -> None:
    no_key, nowhere = certificate.with_name("no.pem"), str(tmp_path / "nowhere.pem")
    no_key.write_text("no key")
    for given, key, says in (
        (str(certificate), None, "do not fit together"),
        (str(certificate), str(no_key), "do not fit together"),
        (nowhere, None, "No such file"),
        (None, nowhere, "no use without --certificate"),
    ):
        options: Any = SimpleNamespace(certificate=given, key=key)
        with pytest.raises(CommandError, match=says):
            _encryption(options)
