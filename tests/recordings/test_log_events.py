"""Event logs are read event by event: damage costs only what is damaged, and all of it is counted."""

import tracemalloc
from pathlib import Path

import lcm
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.recordings import events as log_events
from cmr.recordings.events import HEADER, SYNC, Event, EventReader, event_bytes

CHANNELS = ("GYRO_0", "WORLD_STATE", "X", "Größe")


def a_log(lengths: list[int]) -> list[Event]:
    """Events of these lengths; none ends in a zero byte, so that it shows where zeros begin."""
    return [
        Event(number, 10**15 + 1000 * number, CHANNELS[number % 4], bytes([number % 7, 0, 9] * length)[-length:])
        for number, length in enumerate(lengths)
    ]


def read(path: Path, content: bytes) -> tuple[list[Event], EventReader]:
    path.write_bytes(content)
    reader = EventReader(path)
    return list(reader), reader


lengths = st.lists(st.integers(1, 60), min_size=1, max_size=12)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("log") / "run.lcm"


@pytest.fixture(params=[64, 1 << 20], ids=["small chunks", "large chunks"])
def _chunks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_events, "CHUNK", request.param)


@pytest.mark.usefixtures("_chunks")
def test_what_lcm_has_written_is_read_as_lcm_reads_it(path: Path) -> None:
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for event in a_log(list(range(1, 100))):
        log.write_event(event.utime, event.channel, event.data)
    log.close()
    by_lcm = [Event(e.eventnum, e.timestamp, e.channel, e.data) for e in lcm.EventLog(str(path), "r")]
    events, reader = read(path, path.read_bytes())
    assert events == by_lcm == a_log(list(range(1, 100)))
    assert (reader.damaged_bytes, reader.damaged_places, reader.position) == (0, 0, reader.size)
    assert list(reader) == events, "it can be read again"


@given(lengths, st.data())
@settings(max_examples=30)
def test_garbage_between_events_costs_none_and_is_counted(path: Path, sizes: list[int], data: st.DataObject) -> None:
    events = a_log(sizes)
    garbage = [data.draw(st.binary(max_size=40).filter(lambda some: SYNC not in some)) for _ in events]
    found, reader = read(path, b"".join(event_bytes(event) + some for event, some in zip(events, garbage, strict=True)))
    assert found == events
    assert reader.damaged_bytes == sum(map(len, garbage))
    assert reader.damaged_places == sum(map(bool, garbage))


@given(lengths, st.data())
@settings(max_examples=30)
def test_a_block_of_zeros_costs_the_events_that_it_touches(path: Path, sizes: list[int], data: st.DataObject) -> None:
    events = a_log(sizes)
    content = bytearray(b"".join(map(event_bytes, events)))
    first = data.draw(st.integers(0, len(content)))
    last = data.draw(st.integers(first, len(content)))
    content[first:last] = bytes(last - first)
    intact, end = [], 0
    for event in events:
        start, end = end, end + len(event_bytes(event))
        intact += [event] if content[start:end] == event_bytes(event) else []
    found, reader = read(path, bytes(content))
    assert [event for event in found if event in events] == intact
    # Zeros within the numbers or data of one event are not told from others; an event that they leave is not made up.
    assert len(found) - len(intact) <= (len(events) - len(intact) == 1)
    assert reader.damaged_bytes + sum(len(event_bytes(event)) for event in found) == len(content)


@given(lengths, st.data())
@settings(max_examples=30)
def test_a_truncated_log_gives_its_whole_events(path: Path, sizes: list[int], data: st.DataObject) -> None:
    events = a_log(sizes)
    content = b"".join(map(event_bytes, events))
    length = data.draw(st.integers(0, len(content)))
    found, reader = read(path, content[:length])
    whole = sum(len(event_bytes(event)) for event in found)
    assert found == events[: len(found)]
    assert 0 <= length - whole < len(event_bytes(events[min(len(found), len(events) - 1)]))
    assert reader.damaged_bytes == length - whole


@given(st.lists(st.sampled_from([SYNC, b"\0", b"\0\0\0\1", b"X", event_bytes(Event(0, 1, "X", b"abc"))]), max_size=40))
@settings(max_examples=50)
def test_whatever_the_file_holds_every_byte_is_an_event_or_damage(path: Path, parts: list[bytes]) -> None:
    content = b"".join(parts)
    found, reader = read(path, content)
    assert reader.damaged_bytes + sum(len(event_bytes(event)) for event in found) == len(content) == reader.position


@pytest.mark.parametrize("length", [0, 3, 100_000, 1 << 31, (1 << 32) - 1])
def test_a_damaged_length_costs_its_event_alone(path: Path, length: int) -> None:
    events = a_log([40] * 9)
    content = [event_bytes(event) for event in events]
    header = HEADER.pack(SYNC, 4, 0, 6, length)
    content[4] = header + content[4][HEADER.size :]
    found, _ = read(path, b"".join(content))
    assert [event for event in found if event.number != 4] == events[:4] + events[5:]


def test_an_event_that_the_zeros_behind_it_may_have_reached_is_not_trusted(path: Path) -> None:
    events = a_log([40] * 9)
    content = bytearray(b"".join(map(event_bytes, events)))
    size = len(event_bytes(events[0]))
    content[3 * size - 5 : 4 * size] = bytes(size + 5)
    found, reader = read(path, bytes(content))
    assert found == events[:2] + events[4:]
    assert (reader.damaged_bytes, reader.damaged_places) == (sum(len(event_bytes(event)) for event in events[2:4]), 1)


def test_a_megabyte_at_a_time_is_in_memory(path: Path) -> None:
    event = event_bytes(Event(0, 0, "X", bytes(1000)))
    with path.open("wb") as stream:
        for _ in range(6_000):
            stream.write(event)
    tracemalloc.start()
    count = sum(1 for _ in EventReader(path))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    path.unlink()
    assert count == 6_000
    assert most < 4e6


def test_a_file_that_cannot_be_read_raises_an_error_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        EventReader(tmp_path / "none.lcm")
    with pytest.raises(IsADirectoryError):
        EventReader(tmp_path)
