"""The clock of a log, and the places from which reading can begin."""

from pathlib import Path

import pytest

from cmr.recordings.events import Event, EventReader, event_bytes
from cmr.recordings.log_clock import LogClock, measured_at, seconds_since, span_of, utime_after
from cmr.view.data.log_index import LogIndex
from cmr_tools.replay.tape import LogTape

SECOND = 1_000_000  # us
LOGGED = 1_700_000_000 * SECOND


def write(path: Path, stamps: list[int]) -> EventReader:
    path.write_bytes(b"".join(event_bytes(Event(k, stamp, "A", b"%d" % k)) for k, stamp in enumerate(stamps)))
    return EventReader(path)


@pytest.mark.parametrize("period", [SECOND // 10, SECOND // 2, SECOND, 3 * SECOND])
def test_the_view_and_replay_read_the_same_from_every_moment(tmp_path: Path, period: int) -> None:
    """Also from the very moment of an event just ahead of a checkpoint."""
    log = write(tmp_path / "a.lcm", [LOGGED + number * period for number in range(40)])
    index, tape = LogIndex(log), LogTape(EventReader(log.path))
    assert index.build(60.0)
    list(tape.read(0.0))
    for number in range(40):
        moment = LOGGED + number * period
        seen = [int(event.data) for _, event in index.read(moment)]
        assert seen == list(range(number, 40))
        assert [int(event.data) for _, event in tape.read(seconds_since(LOGGED, moment))] == seen


def test_the_clock_passes_over_disorder_and_over_a_clock_that_was_set() -> None:
    clock, year = LogClock(), 365 * 86_400 * SECOND
    stamps = [0, SECOND, SECOND // 2, 2 * SECOND, year, year + SECOND, 0, SECOND]
    assert [clock.advance(LOGGED + stamp) - LOGGED for stamp in stamps] == [
        part * SECOND for part in (0, 1, 1, 2, 2, 3, 3, 4)
    ]


def test_a_log_is_as_long_as_its_first_and_last_event_say(tmp_path: Path) -> None:
    assert span_of(write(tmp_path / "a.lcm", [LOGGED, LOGGED + 90 * SECOND])) == (LOGGED, LOGGED + 90 * SECOND)
    assert span_of(write(tmp_path / "b.lcm", [0, LOGGED])) == (0, None), "the clock was set"
    assert span_of(write(tmp_path / "c.lcm", [])) == (0, 0)


def test_seconds_and_moments_of_a_log_are_each_others_inverse() -> None:
    for seconds in (0.0, 0.1, 12.345678, 86_400.0):
        assert seconds_since(LOGGED, utime_after(LOGGED, seconds)) == pytest.approx(seconds, abs=1e-9)


def test_a_message_was_measured_as_long_ago_as_it_says_unless_its_clock_is_wrong() -> None:
    assert measured_at(5000, LOGGED, LOGGED - 30) == 4970
    assert measured_at(5000, LOGGED, LOGGED - 3600 * SECOND) == 5000
