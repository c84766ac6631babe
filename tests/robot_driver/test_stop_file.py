"""The file of an emergency stop: a robot stands for whatever is in it, and only for its own file."""

import json
import multiprocessing
import os
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robot_driver.stop_file import SYSTEM_FOLDER, EngagedStop, StopFile, StopKeeper, bus_address, state_folder
from tests.support.driver_bench import wait_for

URL = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304"
STOP = EngagedStop(1_700_000_000_000_000, "cmr-view", "the button on the page")
FILE_IN_USE_AGAIN = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def file(tmp_path: Path) -> StopFile:
    return StopFile(tmp_path, 3, URL)


def test_a_stop_is_kept_until_it_is_released(tmp_path: Path, file: StopFile) -> None:
    assert file.load() is None
    file.store(STOP)
    assert StopFile(tmp_path, 3, URL).load() == STOP
    file.store(None)
    assert StopFile(tmp_path, 3, URL).load() is None
    assert not list(file.path.parent.iterdir())
    file.store(None)


def test_each_robot_and_each_bus_has_a_file_of_its_own(tmp_path: Path, file: StopFile) -> None:
    file.store(STOP)
    assert StopFile(tmp_path, 30, URL).load() is None
    assert StopFile(tmp_path, 3, URL.replace("7667", "7668")).load() is None
    assert StopFile(tmp_path, 3, URL.replace(".67:", ".68:")).load() is None
    assert StopFile(tmp_path, 3, "tcpq://localhost:7700").load() is None


def test_how_a_bus_is_used_makes_no_other_bus_of_it(tmp_path: Path, file: StopFile) -> None:
    file.store(STOP)
    assert StopFile(tmp_path, 3, "udpm://239.255.76.67:7667?ttl=1").load() == STOP
    assert bus_address("udpm://") == bus_address(URL) == "udpm://239.255.76.67:7667"


@FILE_IN_USE_AGAIN
@given(content=st.binary(max_size=300))
def test_whatever_is_in_the_file_the_stop_is_engaged(file: StopFile, content: bytes) -> None:
    file.path.parent.mkdir(exist_ok=True)
    file.path.write_bytes(content)
    found = file.load()
    assert found is not None
    assert str(file.path) in found.doubt


@FILE_IN_USE_AGAIN
@given(data=st.data())
def test_a_torn_or_altered_file_is_an_engaged_stop(file: StopFile, data: st.DataObject) -> None:
    file.store(STOP)
    whole = file.path.read_bytes()
    end = data.draw(st.integers(0, len(whole)))
    altered = bytearray(whole[:end] + bytes(data.draw(st.sampled_from((0, len(whole) - end)))))
    for place in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=3)):
        if place < len(altered):
            altered[place] = data.draw(st.integers(0, 255))
    file.path.write_bytes(altered)
    found = file.load()
    assert found is not None
    assert found.source.isprintable()
    assert found.reason.isprintable()


@FILE_IN_USE_AGAIN
@given(since=st.integers(0, 2**62), source=st.text(max_size=500), reason=st.text(max_size=500))
def test_any_words_are_kept_as_far_as_a_terminal_can_show_them(
    file: StopFile, since: int, source: str, reason: str
) -> None:
    file.store(EngagedStop(since, source, reason))
    found = file.load()
    assert found is not None
    assert (found.since, found.doubt) == (since, "")
    for kept, given_words in ((found.source, source), (found.reason, reason)):
        assert kept == "".join(letter if letter.isprintable() else "?" for letter in given_words[:200])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("robot_id", 4),
        ("bus", "udpm://239.255.76.67:7668"),
        ("engaged", False),
        ("schema", 2),
        ("since", -1),
        ("since", 1e300),
        ("since", True),
        ("reason", None),
    ],
)
def test_a_file_of_another_robot_or_of_another_kind_is_an_engaged_stop(file: StopFile, key: str, value: object) -> None:
    file.store(STOP)
    file.path.write_text(json.dumps(json.loads(file.path.read_text()) | {key: value}))
    found = file.load()
    assert found is not None
    assert "It is taken for an emergency stop that is engaged." in found.doubt


def test_what_is_no_file_is_an_engaged_stop_and_keeps_nobody_waiting(file: StopFile) -> None:
    file.path.parent.mkdir()
    for make, remove in ((os.mkfifo, Path.unlink), (os.mkdir, Path.rmdir)):
        make(file.path)
        found = file.load()
        assert found is not None
        assert found.doubt
        remove(file.path)
    file.path.symlink_to("/dev/zero")
    assert file.load() is not None
    file.path.unlink()
    file.path.write_bytes(b"[" * 60_000)
    assert file.load() is not None


def _change_again_and_again(folder: Path, name: str, seconds: float) -> None:
    file, end = StopFile(folder, 3, URL), time.monotonic() + seconds
    while time.monotonic() < end:
        file.store(EngagedStop(time.time_ns() // 1000, name, "x" * 150))
        file.store(None)


@pytest.mark.slow
def test_while_several_write_a_reader_finds_a_whole_file_or_none(tmp_path: Path, file: StopFile) -> None:
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=_change_again_and_again, args=(tmp_path, f"writer {k}", 0.7)) for k in range(2)]
    for writer in writers:
        writer.start()
    found = []
    while any(writer.is_alive() for writer in writers):
        found.append(file.load())
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert any(stop is not None for stop in found)
    assert not [stop for stop in found if stop is not None and stop.doubt]
    assert not list(file.path.parent.iterdir())


def test_what_was_left_half_written_is_removed_when_it_is_old(file: StopFile) -> None:
    file.path.parent.mkdir()
    old, new = (file.path.with_name(f".{file.path.name}.{name}") for name in ("old", "new"))
    for litter in (old, new):
        litter.write_text("{")
    os.utime(old, (1.0, 1.0))
    assert file.prepare() == ""
    assert list(file.path.parent.iterdir()) == [new]


def test_the_folder_is_the_services_own_or_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/cmr:/var/lib/other")
    assert state_folder() == Path("/var/lib/cmr")
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", "/home/ada/state")
    assert state_folder() == Path("/home/ada/state/cmr")
    for unusable in ("", "relative"):
        monkeypatch.setenv("XDG_STATE_HOME", unusable)
        assert state_folder() == Path.home() / ".local" / "state" / "cmr"

    def nobodys_home() -> Path:
        raise RuntimeError

    monkeypatch.setattr(Path, "home", nobodys_home)
    assert state_folder() == SYSTEM_FOLDER


# The thread that writes


def test_the_newest_wish_is_on_disk_at_the_end(file: StopFile) -> None:
    for number in range(20):
        with StopKeeper(file) as keeper:
            for k in range(number):
                keeper.keep(EngagedStop(k, "test", "test") if k % 2 else None)
        assert file.load() == (EngagedStop(number - 1, "test", "test") if number and number % 2 == 0 else None)
        file.store(None)


def test_what_the_disk_refuses_is_reported_and_tried_again(file: StopFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot_driver.stop_file.AGAIN_AFTER", 0.02)
    store, refusing = file.store, True

    def refuse(stop: EngagedStop | None) -> None:
        store(stop)  # all but the last word of the disk
        if refusing:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(file, "store", refuse)
    with StopKeeper(file) as keeper:
        assert keeper.stored
        keeper.keep(STOP)
        wait_for(lambda: "restart forgets that the emergency stop is engaged" in keeper.problem)
        assert "No space left on device" in keeper.problem
        keeper.keep(None)
        wait_for(lambda: "restart finds the emergency stop engaged" in keeper.problem)
        assert not keeper.stored
        refusing = False
        wait_for(lambda: keeper.stored and keeper.problem == "")
    assert file.load() is None


def test_a_folder_that_cannot_be_made_is_reported_before_it_is_needed(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    keeper = StopKeeper(StopFile(tmp_path / "taken", 0, URL))
    assert "An emergency stop would be forgotten at a restart" in keeper.problem
    assert keeper.loaded is not None, "whether one was engaged cannot be known"
