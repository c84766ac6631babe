"""What a replay sends: every message of the log and nothing else, from any place on, changed only where asked for."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lcm
import pytest

from cmr.bus.messages import decode, make
from cmr.bus.streams import STREAMS
from cmr.bus.wire import offsets
from cmr.msg import gyro_t, pose_xyt_t
from cmr.recordings.events import Event, EventReader
from cmr_tools.replay.changes import Changes, ChannelFilter, moved_to
from cmr_tools.replay.tape import LogTape
from tests.support.typed_messages import as_a

SECOND = 1_000_000  # us
LOGGED = 1_700_000_000 * SECOND
OLD = 3 * SECOND  # how long before they were logged the messages here were stamped


def pose(utime: int = LOGGED - OLD) -> bytes:
    return bytes(make(pose_xyt_t, utime=utime, robot_id=0, x=1.0, y=2.0, theta=3.0).encode())


def gyro(utime: int) -> bytes:
    fields = {"robot_id": 0, "yaw_rate": 0.5, "valid": 1, "received_utime": utime + 7}
    return bytes(make(gyro_t, utime=utime, **fields).encode())


def write(path: Path, utimes: Sequence[int], size: int = 0) -> LogTape:
    """Write a log of messages logged at these times [us], each of `size` bytes more than its number."""
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for number, utime in enumerate(utimes):
        log.write_event(utime, "A", b"%d," % number + bytes(size))
    log.close()
    return LogTape(EventReader(path))


def read(tape: LogTape, begin: float = 0.0) -> tuple[list[float], list[int]]:
    """Return the moments and the numbers of the messages from `begin` on."""
    entries = [(seconds, int(event.data.partition(b",")[0])) for seconds, event in tape.read(begin)]
    return [seconds for seconds, _ in entries], [number for _, number in entries]


# Where in the log


def test_time_runs_from_the_first_message(tmp_path: Path) -> None:
    tape = write(tmp_path / "a.lcm", [LOGGED, LOGGED + SECOND, LOGGED + 90 * SECOND])
    assert read(tape) == ([0.0, 1.0, 90.0], [0, 1, 2])
    assert tape.duration() == 90.0


def test_any_moment_can_be_read_from_again_and_again(tmp_path: Path) -> None:
    tape = write(tmp_path / "a.lcm", [LOGGED + 100_000 * number for number in range(200)], size=20_000)
    for begin in (15.0, 0.0, 3.05, 19.85, 4.0, 30.0):
        moments, numbers = read(tape, begin)
        first = -int(-begin * 10 // 1)
        assert numbers == list(range(first, 200))
        assert moments == pytest.approx([number / 10 for number in numbers])
    assert tape.duration() == pytest.approx(19.9), "told by the end of the log alone"


def test_messages_at_one_moment_are_all_read_from_there_on(tmp_path: Path) -> None:
    tape = write(tmp_path / "a.lcm", [LOGGED + 2 * SECOND * (number // 3) for number in range(12)])
    read(tape)
    assert read(tape, 2.0)[1] == list(range(3, 12))
    assert read(tape, 4.0)[1] == list(range(6, 12))


def test_a_clock_that_was_set_takes_no_time(tmp_path: Path) -> None:
    years, back = 50 * 365 * 86_400 * SECOND, 3600 * SECOND
    utimes = [0, SECOND, years, years + SECOND, years - back, years - back + SECOND]
    tape = write(tmp_path / "a.lcm", utimes)
    assert read(tape)[0] == [0.0, 1.0, 1.0, 2.0, 2.0, 3.0]
    assert tape.duration() is None, "first and last message do not tell it"


def test_a_little_disorder_is_neither_time_nor_a_clock_that_was_set(tmp_path: Path) -> None:
    tape = write(tmp_path / "a.lcm", [LOGGED, LOGGED + SECOND, LOGGED + SECOND // 2, LOGGED + 2 * SECOND])
    assert read(tape) == ([0.0, 1.0, 1.0, 2.0], [0, 1, 2, 3])


def test_an_empty_log_is_empty(tmp_path: Path) -> None:
    tape = write(tmp_path / "a.lcm", [])
    assert read(tape) == ([], [])


# Which channels


@pytest.mark.parametrize(
    ("only", "without", "wanted"),
    [
        ([], [], ["POSE_0", "POSE_1", "GYRO_0"]),
        (["POSE_*"], [], ["POSE_0", "POSE_1"]),
        (["POSE_*", "GYRO_0"], ["*_1"], ["POSE_0", "GYRO_0"]),
        ([], ["POSE_?"], ["GYRO_0"]),
        (["pose_0"], [], []),
    ],
)
def test_channels_are_chosen_by_patterns(only: list[str], without: list[str], wanted: list[str]) -> None:
    chosen = ChannelFilter(only, without)
    names = ["POSE_0", "POSE_1", "GYRO_0", "CMR_SELF_TEST", "LCM_SELF_TEST"]
    assert [name for name in names if chosen(name)] == wanted, "tests of the bus are never replayed"
    assert list(chosen.seen) == names


# Changes


def test_unchanged_messages_keep_every_byte() -> None:
    for data in (pose(), b"", b"foreign", pose()[:-1]):
        assert Changes({}).changed(Event(0, LOGGED, "POSE_0", data)) == ("POSE_0", data)


def test_the_messages_of_a_renamed_channel_speak_of_its_robot() -> None:
    channel, data = Changes({"POSE_0": "POSE_7"}).changed(Event(0, LOGGED, "POSE_0", pose()))
    message = as_a(pose_xyt_t, decode(channel, data).message)
    assert (channel, message.robot_id) == ("POSE_7", 7)
    assert (message.utime, message.x, message.y, message.theta) == (LOGGED - OLD, 1.0, 2.0, 3.0)


@pytest.mark.parametrize("name", ["GYRO_7", "TRUE_POSE", "WORLD_STATE"])
def test_a_name_of_another_kind_leaves_the_message_as_it_is(name: str) -> None:
    assert Changes({"POSE_0": name}).changed(Event(0, LOGGED, "POSE_0", pose())) == (name, pose())


def test_other_channels_keep_their_names() -> None:
    assert Changes({"POSE_0": "POSE_7"}).changed(Event(0, LOGGED, "POSE_1", pose())) == ("POSE_1", pose())


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: str(stream.name))
def test_every_time_of_every_type_can_be_moved(stream: Any) -> None:
    times = {name for name in stream.message_type.__slots__ if name.endswith("utime")}
    assert times <= set(offsets(stream.message_type))


@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_moved_messages_are_as_old_as_when_they_were_logged(speed: float) -> None:
    now = LOGGED + 10**9 * SECOND
    event = Event(0, LOGGED, "GYRO_0", gyro(LOGGED - OLD))
    channel, data = Changes({}).changed(event, moved_to(now, LOGGED, speed))
    message = as_a(gyro_t, decode(channel, data).message)
    assert (message.utime, message.received_utime) == (now - OLD, now - OLD + 7)
    assert (message.yaw_rate, message.valid, message.robot_id) == (0.5, 1, 0)


def test_at_a_higher_speed_times_keep_their_order() -> None:
    stamped, logged = [0, 10_000, 20_000], [9_000, 11_000, 21_000]  # us; the first was logged late
    due = [utime // 10 for utime in logged]
    moved = [moved_to(moment, event, 10.0)(utime) for moment, event, utime in zip(due, logged, stamped, strict=True)]
    assert moved == [0, 1000, 2000]


def test_damaged_times_do_no_harm() -> None:
    event = Event(0, LOGGED, "POSE_0", pose(utime=2**63 - 1))
    _, data = Changes({}).changed(event, moved_to(LOGGED + SECOND, LOGGED, 1.0))
    assert decode("POSE_0", data).message.utime == 2**63 - 1
    assert Changes({}).changed(Event(0, 0, "POSE_0", pose()[:12]), moved_to(0, 0, 1.0))[1] == pose()[:12]
