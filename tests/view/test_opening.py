"""A visitor's own log is opened for that visitor alone; whatever is sent, the page of the others goes on."""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cmr.recordings.events import event_bytes
from cmr.view import opening, server
from cmr.view.data.state import ViewState
from cmr.view.entrance.door import Address
from cmr.view.opening import LARGEST_LOG, MOST_ARRIVING, MOST_OPENED, LogFolder, OpenedLog, RefusedLog, check_size
from cmr.view.orders import Orders
from cmr.view.requests import CLOSE, COME, JUMP, LEAVE, OPEN, STOP, Permission, Request
from cmr.view.uploads import Upload
from cmr.view.visit import NO_ROOM
from tests.support.small_log import small_log

LOG = b"".join(map(event_bytes, small_log()))


def keep(folder: LogFolder, name: str, content: bytes) -> OpenedLog:
    stream = folder.begin()
    stream.write(content)
    return folder.keep(name, stream)


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
        keep(folder, "../../picture.png", content)
    log = keep(folder, "../../etc/run.lcm", LOG[:-3])
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
            _thread_executor=SimpleNamespace(submit=lambda call, *arguments: call(*arguments)),
            add_upload_button=lambda *_text, **_look: self.button,
            add_folder=lambda *_text, **_look: nullcontext(),
            add_html=lambda _text: None,
        )


def start(size: int, parts: int, uuid: str = "b") -> Any:
    return SimpleNamespace(
        size_bytes=size, part_count=parts, source_component_uuid="a", transfer_uuid=uuid, filename="run.lcm"
    )


def part(index: int, content: bytes, uuid: str = "b") -> Any:
    return SimpleNamespace(part_index=index, content=content, transfer_uuid=uuid, source_component_uuid="a")


class Sending:
    """A visitor who sends files, with the folder into which they come."""

    def __init__(self) -> None:
        self.client, self.logs = FakeClient(), LogFolder()
        self.said: list[str] = []
        self.taken: list[OpenedLog] = []
        client: Any = self.client
        self.upload = Upload(
            client,
            self.logs,
            lambda size: check_size(size, self.upload.arriving),
            self.taken.append,
            self.said.append,
        )

    def start(self, message: Any) -> None:
        self.client.handlers["FileTransferStartUpload"](1, message)

    def part(self, message: Any) -> None:
        self.client.handlers["FileTransferPart"](1, message)

    def files(self) -> list[Path]:
        return list(self.logs._folder.iterdir())


def test_a_file_that_is_too_large_is_refused_before_anything_of_it_is_kept_and_the_browser_need_not_wait() -> None:
    sending = Sending()
    sending.start(start(10**12, 1))
    assert sending.client.kept == ["FileTransferPartAck"]
    assert "larger than" in sending.said[0]
    assert sending.files() == []


def test_a_file_comes_part_by_part_to_the_disk() -> None:
    sending = Sending()
    sending.start(start(len(LOG), 2))
    sending.part(part(0, LOG[:99]))
    assert sending.upload.arriving == len(LOG)
    sending.part(part(1, LOG[99:]))
    assert [log.path.read_bytes() for log in sending.taken] == [LOG]
    assert sending.upload.arriving == 0


@pytest.mark.parametrize(
    "parts",
    [
        [part(0, bytes(101))],
        [part(0, bytes(60)), part(1, bytes(60))],
        [part(0, bytes(60)), part(1, bytes(20))],
        [part(1, bytes(60))],
        [part(0, bytes(60)), part(0, bytes(40))],
        [part(0, b"")],
    ],
)
def test_nothing_is_kept_of_a_file_that_does_not_come_as_it_was_announced(parts: list[Any]) -> None:
    sending = Sending()
    sending.start(start(100, 2))
    for message in parts:
        sending.part(message)
    assert sending.files() == []
    assert sending.taken == []


def test_a_visitor_sends_one_file_at_a_time_and_nothing_is_kept_once_he_has_left() -> None:
    sending = Sending()
    for number in range(5):
        sending.start(start(100, 2, str(number)))
        sending.part(part(0, bytes(50), str(number)))
    assert len(sending.files()) == 1
    sending.upload.end()
    assert sending.files() == []


def test_a_full_disk_is_said_to_who_sends_a_log(monkeypatch: pytest.MonkeyPatch) -> None:
    sending = Sending()
    monkeypatch.setattr("shutil.disk_usage", lambda _path: SimpleNamespace(free=opening.LEFT_FREE + 99))
    sending.start(start(100, 2))
    assert "nearly full" in sending.said[0]
    monkeypatch.undo()
    sending.start(start(100, 2))
    assert sending.upload._transfer is not None
    sending.upload._transfer.stream.close()
    full = OSError(28, "No space left on device")
    broken: Any = SimpleNamespace(
        tell=lambda: 0, write=lambda _data: (_ for _ in ()).throw(full), close=lambda: None, name=sending.files()[0]
    )
    sending.upload._transfer = sending.upload._transfer._replace(stream=broken)
    sending.part(part(0, bytes(50)))
    assert sending.said[1] == "The log cannot be kept here: No space left on device."
    assert sending.files() == []


# For whom


class FakeVisit:
    """What a visitor sees; `drawn` counts how often."""

    def __init__(self, visitor: Any, _requests: Any, showing: Any, *rest: Any) -> None:
        self.visitor, self.showing, self.log = visitor, showing, rest[-1]
        self.refused: list[str] = []
        self.page = SimpleNamespace(refuse=self.refused.append, plotted=[])
        self.drawn = 0

    def show(self, *_what: Any) -> None:
        self.drawn += 1


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> server.PageServer:
    """A server of a live world with visitors 1 to 6."""
    panel = SimpleNamespace(dock_right=lambda: None)
    gui = SimpleNamespace(configure_theme=lambda **_look: None, main_panel=panel)
    fake = SimpleNamespace(gui=gui, initial_camera=SimpleNamespace(), get_port=lambda: 8080, stop=lambda: None)
    fake._websock_server = SimpleNamespace(_live_connections={})
    fake.on_client_connect = fake.on_client_disconnect = lambda _call: None
    monkeypatch.setattr(server, "_Server", lambda *_address, **_look: fake)
    monkeypatch.setattr(server, "Visit", FakeVisit)
    curves = SimpleNamespace(windows={"all": 0.0}, want=lambda _names: None)
    live: Any = SimpleNamespace(
        state=ViewState(), orders=Orders(), name="live", curves=curves, panel=lambda: None, head=lambda: ""
    )
    monkeypatch.setattr(server, "guarding", lambda _door, _beside: nullcontext())
    result = server.PageServer(Address("127.0.0.1", 8080), "secret of ours", NO_ROOM, live)
    for visitor in range(1, 7):
        result.requests.put(Request(COME, visitor, SimpleNamespace(client_id=visitor, gui=FakeClient().gui)))
    result.requested(0)
    return result


def kept(pages: server.PageServer) -> OpenedLog:
    return keep(pages._logs, "run.lcm", LOG)


def do(pages: server.PageServer, *requests: Request) -> list[Request]:
    for request in requests:
        pages.requests.put(request)
    return pages.requested(0)


def test_a_log_is_shown_to_the_visitor_who_opened_it_until_he_goes_back(pages: server.PageServer) -> None:
    log = kept(pages)
    assert do(pages, Request(OPEN, 1, log)) == []
    assert [visit.showing.name for visit in pages.visits.values() if visit.log] == ["run.lcm"]
    assert do(pages, Request(JUMP, 1, 0)) == [], "the request moves his own log alone"
    assert do(pages, Request(STOP, 1)) == [Request(STOP, 1)], "the emergency stop is everybody's"
    pages.show(0.05)
    do(pages, Request(CLOSE, 1))
    assert pages.visits[1].showing.name == "live"
    assert not log.path.exists()


def test_a_log_that_breaks_the_playback_closes_and_the_others_see_nothing_of_it(
    pages: server.PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    do(pages, Request(OPEN, 1, kept(pages)))
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
    do(pages, *(Request(OPEN, visitor + 1, log) for visitor, log in enumerate(logs)))
    visits: Any = pages.visits
    assert "Close one of them" in visits[MOST_OPENED + 1].refused[0]
    assert [log.path.exists() for log in logs] == [True] * MOST_OPENED + [False]
    do(pages, Request(LEAVE, 1), Request(OPEN, 1, logs[1]))
    assert [log.path.exists() for log in logs[:2]] == [False, False]
    folder: Path = logs[0].path.parent
    pages.stop()
    assert not folder.exists()
