"""A visitor's own log is opened for that visitor alone; whatever is sent, the page of the others goes on."""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from viser import UploadedFile

from cmr.recordings.events import event_bytes
from cmr.view import server
from cmr.view.opening import LARGEST_LOG, MOST_ARRIVING, MOST_OPENED, LogFolder, OpenedLog, RefusedLog, check_size
from cmr.view.orders import Orders
from cmr.view.state import ViewState
from cmr.view.uploads import Upload, arriving
from cmr.view.visit import NO_ROOM
from cmr.view.wishes import CLOSE, COME, JUMP, LEAVE, OPEN, STOP, Permission, Wish
from tests.support.small_log import small_log

LOG = b"".join(map(event_bytes, small_log()))


# What is taken


def test_files_that_are_too_large_or_too_many_are_refused_with_what_to_do() -> None:
    check_size(LARGEST_LOG, 0)
    with pytest.raises(RefusedLog, match=r"larger than 200 MB. Run `cmr-view FILE`"):
        check_size(LARGEST_LOG + 1, 0)
    with pytest.raises(RefusedLog, match="try again"):
        check_size(LARGEST_LOG, MOST_ARRIVING)


@pytest.mark.parametrize("content", [b"", b"\x89PNG" + bytes(5000), LOG[:20], LOG + 1_000_000 * LOG[:4]])
def test_what_is_no_log_is_refused_with_what_is_expected_and_not_kept(content: bytes) -> None:
    folder = LogFolder()
    with pytest.raises(RefusedLog, match=r"picture.png is not an LCM event log. Expected is a file such as run.lcm"):
        folder.keep("../../picture.png", content)
    log = folder.keep("../../etc/run.lcm", LOG[:-3])
    assert log.name == "run.lcm"
    assert list(log.path.parent.iterdir()) == [log.path]
    folder.clean()
    assert not log.path.exists()


def test_opening_needs_the_token_but_on_this_computer() -> None:
    assert not Permission("secret of ours").asks(OPEN)
    assert Permission("secret of ours", on_this_computer=True).asks(OPEN)


class FakeClient:
    """A visitor as viser has it, as far as transfers of files go."""

    def __init__(self) -> None:
        self.kept: list[Any] = []
        self.handlers: dict[str, Callable[[int, Any], None]] = {}
        self.button = SimpleNamespace(value=None, _impl=SimpleNamespace(value=None), on_upload=lambda _call: None)
        connection = SimpleNamespace(
            unregister_handler=lambda _kind: None,
            register_handler=lambda kind, call: self.handlers.update({kind.__name__: call}),
            queue_message=lambda message: self.kept.append(type(message).__name__),
        )
        self.gui = SimpleNamespace(
            _websock_interface=connection,
            _current_file_upload_states={},
            _handle_file_transfer_start=lambda _client, message: self.kept.append(message),
            _handle_file_transfer_part=lambda _client, message: self.kept.append(message),
            add_upload_button=lambda *_text, **_look: self.button,
            add_folder=lambda *_text, **_look: nullcontext(),
            add_html=lambda _text: None,
        )


def test_nothing_of_a_file_that_is_refused_or_larger_than_announced_is_kept_in_memory() -> None:
    client, said = FakeClient(), list[str]()
    taken: list[tuple[str, bytes]] = []
    upload = Upload(
        client,  # type: ignore[arg-type]
        lambda size: check_size(size, arriving(client)),  # type: ignore[arg-type]
        lambda name, content: taken.append((name, content)),
        said.append,
    )
    start, part = client.handlers["FileTransferStartUpload"], client.handlers["FileTransferPart"]
    start(1, SimpleNamespace(size_bytes=10**12, source_component_uuid="a", transfer_uuid="b"))
    assert client.kept == ["FileTransferPartAck"], "the browser need not wait"
    assert "larger than" in said[0]
    client.gui._current_file_upload_states["c"] = {"transferred_bytes": 90, "total_bytes": 100}
    assert arriving(client) == 100  # type: ignore[arg-type]
    part(1, SimpleNamespace(transfer_uuid="c", content=bytes(20)))
    assert client.gui._current_file_upload_states == {}
    client.button.value = UploadedFile("run.lcm", LOG)
    upload._arrived(None)
    assert taken == [("run.lcm", LOG)]
    assert client.button._impl.value.content == b""


# For whom


class FakeVisit:
    """What a visitor sees; `drawn` counts how often."""

    def __init__(self, visitor: Any, _wishes: Any, showing: Any, *rest: Any) -> None:
        self.visitor, self.showing, self.log = visitor, showing, rest[-1]
        self.refused: list[str] = []
        self.page = SimpleNamespace(refuse=self.refused.append, plotted=[])
        self.drawn = 0

    def show(self, *_what: Any) -> None:
        self.drawn += 1


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> server.PageServer:
    """A server of a live world with visitors 1 to 6."""
    gui = SimpleNamespace(configure_theme=lambda **_look: None)
    fake = SimpleNamespace(gui=gui, initial_camera=SimpleNamespace(), get_port=lambda: 8080, stop=lambda: None)
    fake.on_client_connect = fake.on_client_disconnect = lambda _call: None
    monkeypatch.setattr(server, "_Server", lambda *_address, **_look: fake)
    monkeypatch.setattr(server, "Visit", FakeVisit)
    curves = SimpleNamespace(windows={"all": 0.0}, want=lambda _names: None)
    live: Any = SimpleNamespace(
        state=ViewState(), orders=Orders(), name="live", curves=curves, panel=lambda: None, head=lambda: ""
    )
    result = server.PageServer("127.0.0.1", 8080, "secret of ours", NO_ROOM, live)
    for visitor in range(1, 7):
        result.wishes.put(Wish(COME, visitor, SimpleNamespace(client_id=visitor, gui=FakeClient().gui)))
    result.wished(0)
    return result


def kept(pages: server.PageServer) -> OpenedLog:
    return pages._logs.keep("run.lcm", LOG)


def do(pages: server.PageServer, *wishes: Wish) -> list[Wish]:
    for wish in wishes:
        pages.wishes.put(wish)
    return pages.wished(0)


def test_a_log_is_shown_to_the_visitor_who_opened_it_until_he_goes_back(pages: server.PageServer) -> None:
    log = kept(pages)
    assert do(pages, Wish(OPEN, 1, log)) == []
    assert [visit.showing.name for visit in pages.visits.values() if visit.log] == ["run.lcm"]
    assert do(pages, Wish(JUMP, 1, 0)) == [], "the wish moves his own log alone"
    assert do(pages, Wish(STOP, 1)) == [Wish(STOP, 1)], "the emergency stop is everybody's"
    pages.show(0.05)
    do(pages, Wish(CLOSE, 1))
    assert pages.visits[1].showing.name == "live"
    assert not log.path.exists()


def test_a_log_that_breaks_the_playback_closes_and_the_others_see_nothing_of_it(
    pages: server.PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    do(pages, Wish(OPEN, 1, kept(pages)))
    monkeypatch.setattr(pages.visits[1].showing, "advance", lambda _seconds: 1 // 0)
    pages.show(0.05)
    visits: Any = pages.visits
    assert [visits[visitor].drawn for visitor in range(2, 7)] == [1] * 5
    assert visits[1].showing.name == "live"
    assert visits[1].refused == ["run.lcm cannot be played: integer division or modulo by zero"]
    pages.show(0.05)
    assert visits[1].drawn == 1


def test_only_so_many_logs_are_open_and_those_of_who_left_are_deleted(pages: server.PageServer) -> None:
    logs = [kept(pages) for _ in range(MOST_OPENED + 1)]
    do(pages, *(Wish(OPEN, visitor + 1, log) for visitor, log in enumerate(logs)))
    visits: Any = pages.visits
    assert "Close one of them" in visits[MOST_OPENED + 1].refused[0]
    assert [log.path.exists() for log in logs] == [True] * MOST_OPENED + [False]
    do(pages, Wish(LEAVE, 1), Wish(OPEN, 1, logs[1]))
    assert [log.path.exists() for log in logs[:2]] == [False, False]
    folder: Path = logs[0].path.parent
    pages.stop()
    assert not folder.exists()
