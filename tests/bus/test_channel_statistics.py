"""What the statistics of a channel say is right, by a clock of the test."""

import math
import random

import pytest

from cmr.bus.channel_statistics import Line
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.streams import STREAMS, Stream
from cmr.bus.wire import ROBOT_ID_AT, offsets
from cmr.msg import gyro_t, pose_xyt_t
from cmr_tools.spy.statistics import Statistics, type_name

SECOND = 1_000_000  # us
BEGIN = 1_700_000_000 * SECOND
POSE = make(pose_xyt_t, utime=BEGIN, robot_id=0, x=1.0, y=2.0, theta=3.0).encode()


def line(statistics: Statistics, now: int, channel: str = "POSE_0") -> Line:
    return next(line for line in statistics.lines(now) if line.channel == channel)


def run(statistics: Statistics, period: float, seconds: float, begin: int = BEGIN, spread: float = 0.0) -> int:
    """Send a message each `period` [s] for so long, looking twice a second; return the time [us] in the end."""
    noise = random.Random(0)
    now, looked = begin, begin
    for number in range(round(seconds / period)):
        now = begin + round((number * period + noise.gauss(0.0, spread)) * SECOND)
        statistics.handle(now, "POSE_0", POSE)
        while looked <= now:
            statistics.lines(now)
            looked += SECOND // 2
    return now


@pytest.mark.parametrize("period", [0.0005, 0.01, 1.0, 8.0])
@pytest.mark.parametrize("messages_seen", [3, 30])
def test_rate_and_bytes_per_second_are_those_of_a_steady_sender(period: float, messages_seen: int) -> None:
    statistics = Statistics()
    now = run(statistics, period, messages_seen * period)
    seen = line(statistics, now + round(0.5 * period * SECOND))
    assert seen.rate == pytest.approx(1.0 / period, rel=1e-3)
    assert seen.bytes_per_second == pytest.approx(len(POSE) / period, rel=1e-3)
    assert seen.jitter == pytest.approx(0.0, abs=1e-6)
    assert seen.age == pytest.approx(0.5 * period, abs=1e-6)
    assert (seen.messages, seen.errors, type_name(seen), seen.data) == (messages_seen, 0, "pose_xyt_t", POSE)


def test_jitter_is_the_standard_deviation_of_the_intervals() -> None:
    statistics = Statistics()
    now = run(statistics, 0.02, 5.0, spread=0.001)
    assert line(statistics, now).jitter == pytest.approx(0.001 * math.sqrt(2.0), rel=0.15)


def test_one_message_tells_neither_rate_nor_jitter() -> None:
    statistics = Statistics()
    statistics.handle(BEGIN, "POSE_0", POSE)
    seen = line(statistics, BEGIN)
    assert (seen.rate, seen.messages) == (0.0, 1)
    assert math.isnan(seen.jitter)


def test_who_falls_silent_has_no_rate_any_more_and_gets_the_right_one_when_back() -> None:
    statistics = Statistics()
    now = run(statistics, 0.01, 10.0)
    for later in range(1, 600):
        seen = line(statistics, now + later * SECOND)
        assert seen.rate <= 100.0
    assert (seen.rate, seen.bytes_per_second, seen.age) == (0.0, 0.0, 599.0)
    now = run(statistics, 0.01, 0.5, begin=now + 600 * SECOND)
    assert line(statistics, now).rate == pytest.approx(100.0, rel=1e-3)


def test_a_change_of_the_rate_shows_within_the_window() -> None:
    statistics = Statistics()
    now = run(statistics, 0.01, 20.0)
    now = run(statistics, 0.05, 6.0, begin=now + 50_000)
    assert line(statistics, now).rate == pytest.approx(20.0, rel=0.05)


def test_what_is_no_message_of_its_channel_is_an_error() -> None:
    statistics = Statistics()
    gyro = make(gyro_t, utime=BEGIN, robot_id=0, yaw_rate=0.0, valid=1, received_utime=BEGIN).encode()
    other_robot = make(pose_xyt_t, utime=BEGIN, robot_id=1, x=1.0, y=2.0, theta=3.0).encode()
    for data in (POSE, gyro, other_robot, POSE[:-1], b"", POSE):
        statistics.handle(BEGIN, "POSE_0", data)
    assert line(statistics, BEGIN).errors == 4


def test_other_peoples_channels_are_counted_and_their_types_named_where_they_are_known() -> None:
    statistics = Statistics()
    statistics.handle(BEGIN, "CAMERA", b"whatever it is")
    statistics.handle(BEGIN, "TRUE_POSE", POSE)
    seen = {line.channel: (type_name(line), line.errors) for line in statistics.lines(BEGIN)}
    assert seen == {"CAMERA": ("unknown", 0), "TRUE_POSE": ("pose_xyt_t", 0)}


def test_the_robot_is_where_it_is_looked_for() -> None:
    places = {offsets(stream.message_type)["robot_id"] for stream in STREAMS if stream.per_robot}
    assert places == {ROBOT_ID_AT}


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: str(stream.name))
def test_the_shortest_message_of_each_type_is_no_error(stream: Stream[Message]) -> None:
    statistics = Statistics()
    statistics.handle(BEGIN, stream.channel(0 if stream.per_robot else None), stream.message_type().encode())
    assert statistics.lines(BEGIN)[0].errors == 0
