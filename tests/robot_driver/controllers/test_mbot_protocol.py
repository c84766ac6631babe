"""MBot frames: packed as the firmware packs them, found whatever happens to the stream, believed only when sure."""

import itertools
import math
import random
import re
import struct
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robot_driver.controllers import BadReply, Request
from robot_driver.controllers.mbot import MBot, MBotGyro
from robot_driver.controllers.mbot.clock import JITTER, SteadyClock
from robot_driver.controllers.mbot.frames import LAYOUTS, Frame, FrameReader
from robot_driver.emulator.mbot_device import MBotDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.gate.wire_mbot import REPEATED, START, Topic, packed
from tests.robot_driver.golden_vectors import MBOT_STOP


def said(topic: Topic, utime: int, *values: float) -> bytes:
    """Return what the board says; numbers that are not given are 0."""
    layout = LAYOUTS[topic]
    length = len(layout.unpack(bytes(layout.size)))
    return packed(topic, layout.pack(utime, *values, *[0] * (length - 1 - len(values))))


def without_arrival(frames: list[Frame]) -> list[tuple[Any, ...]]:
    return [(frame.topic, frame.utime, repr(frame.values)) for frame in frames]


class Clock:
    """Our monotonic clock, set by the test (us)."""

    def __init__(self, utime: int) -> None:
        self.utime = utime

    def monotonic_ns(self) -> int:
        return self.utime * 1000


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    result = Clock(7)
    monkeypatch.setattr(MBot, "monotonic_ns", result.monotonic_ns)
    return result


def answer(request: Request[Any], *stream: bytes) -> Any:
    """Return the answer to a request in this stream, None if it is not there."""
    assert request.missing(b"") > 0
    reply = b"".join(stream) + START  # a frame is believed when the next one begins
    return request.parse(reply) if request.missing(reply) == 0 else None


def test_a_board_that_speaks_is_told_the_time_four_times_a_second_and_never_without_duties(clock: Clock) -> None:
    mbot, told = MBot(), []
    for clock.utime in range(1000, 1_001_000, 10_000):
        request = mbot.drive(0.0, 0.0)
        assert MBOT_STOP[:7] in request.data
        told += [clock.utime] * (packed(Topic.TIMESYNC, struct.pack("<q", clock.utime)) in request.data)
        answer(request, said(Topic.MOTOR_PWM, clock.utime))
    assert [later - earlier for earlier, later in itertools.pairwise(told)] == [250_000] * 3


def test_a_board_that_fell_silent_is_told_the_time_with_every_duty_until_it_speaks(clock: Clock) -> None:
    mbot, told = MBot(), []
    for clock.utime in range(10_000, 410_000, 10_000):
        request = mbot.drive(0.0, 0.0)
        told += [clock.utime] * (packed(Topic.TIMESYNC, struct.pack("<q", clock.utime)) in request.data)
        if not 30_000 < clock.utime < 200_000:
            answer(request, said(Topic.MOTOR_PWM, clock.utime))
    assert told == [10_000, *range(130_000, 210_000, 10_000)]


@pytest.mark.usefixtures("clock")
@pytest.mark.parametrize("received", range(29))
@pytest.mark.parametrize("lost", range(REPEATED))
def test_half_a_frame_and_a_lost_one_have_no_silent_board_go_on_with_old_duties(received: int, lost: int) -> None:
    settings = load_settings().ideal()
    device = MBotDevice(settings, Plant(settings))
    old = packed(Topic.MOTOR_PWM_COMMAND, struct.pack("<q3f", 7, 0.5, -0.5, 0.0))
    device.receive(old + old[:received], 0.0)
    told = bytearray(MBot().drive(0.0, 0.0).data)
    zero = packed(Topic.MOTOR_PWM_COMMAND, struct.pack("<q3f", 7, 0.0, -0.0, 0.0))
    ends = [found.end() for found in re.finditer(re.escape(zero), told)]
    assert len(ends) == REPEATED
    told[ends[lost] - 1] ^= 1
    device.receive(bytes(told), 0.001)
    device.wake(0.002)
    assert device._is_told_time
    assert device.duty == (0.0, 0.0)


def test_only_these_duties_in_force_since_they_were_told_confirm_them(clock: Clock) -> None:
    mbot = MBot()
    clock.utime = 1000
    request = mbot.drive(0.1, 0.2)
    clock.utime = 2000
    left, right = struct.unpack("<2f", struct.pack("<2f", 0.1, 0.2))
    assert answer(request, said(Topic.MOTOR_PWM, 999, left, -right)) is None
    assert answer(request, said(Topic.MOTOR_PWM, 2001, left, -right)) is None
    assert answer(request, said(Topic.MOTOR_PWM, 1500, left, right)) is None
    with pytest.raises(BadReply):
        request.parse(b"")
    assert answer(request, said(Topic.MOTOR_PWM, 1500, left, -right)) == (left, right)


def test_a_board_that_did_not_hear_its_duties_is_not_waited_for(clock: Clock) -> None:
    mbot = MBot()
    clock.utime = 1000
    request = mbot.drive(0.1, 0.2)
    clock.utime = 40_000
    early, late = said(Topic.MOTOR_PWM, 20_999, 0.1, -0.1), said(Topic.MOTOR_PWM, 21_000, 0.1, -0.1)
    assert request.missing(early + START) > 0
    assert request.missing(early + late + START) == 0
    with pytest.raises(BadReply, match="did not say its duties"):
        request.parse(b"")


def test_encoders_count_forward_modulo_and_tell_when(clock: Clock) -> None:
    mbot = MBot()
    mbot.drive(0.0, 0.0)
    clock.utime = 50
    request = mbot.read_encoders()
    assert answer(request, said(Topic.ENCODERS, 40, -1, 5)) == (2**32 - 1, 2**32 - 5)
    assert request.measured is not None
    assert request.measured() == 40_000


@pytest.mark.usefixtures("clock")
def test_what_came_with_the_confirmation_is_not_waited_for() -> None:
    mbot = MBot()
    request = mbot.drive(0.0, 0.0)
    everything = [said(Topic.ENCODERS, 7, 3, -4), said(Topic.ANALOG_IN, 7, 0, 0, 0, 0, 0, 0, 0, 12.5)]
    assert answer(request, *everything, said(Topic.MOTOR_PWM, 7)) == (0.0, 0.0)
    encoders, (battery,) = mbot.read_encoders(), mbot.read_telemetry()
    assert encoders.missing(b"") == battery.missing(b"") == 0
    assert encoders.parse(b"") == (3, 4)
    assert battery.parse(b"") == {"battery_voltage": 12.5}


@pytest.mark.parametrize("duties", [(1.01, 0.0), (0.0, -1.01), (math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0)])
def test_an_impossible_duty_is_refused(duties: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="duty"):
        MBot().drive(*duties)


def test_the_watchdog_is_what_the_board_shows_once_and_has_as_long_as_it_talks(clock: Clock) -> None:
    mbot = MBot()
    with pytest.raises(ValueError, match="cannot be set"):
        mbot.set_watchdog(0.5)
    request = mbot.read_watchdog()
    assert answer(request, said(Topic.MOTOR_PWM, 400_007)) is None
    with pytest.raises(BadReply):
        request.parse(b"")
    assert answer(request, said(Topic.MOTOR_PWM, 1_004_000)) is None
    assert request.parse(b"") == 1.0
    clock.utime = 1_010_000
    assert mbot.read_watchdog().parse(b"") == 1.0
    clock.utime = 1_200_000
    with pytest.raises(BadReply):
        mbot.read_watchdog().parse(b"")
    clock.utime = 7
    ignored = MBot().read_watchdog()
    assert answer(ignored, said(Topic.MOTOR_PWM, 1_510_000)) == 1.5


def test_a_gyro_reading_is_the_upward_rate_at_the_boards_time() -> None:
    (reading,) = MBotGyro().feed(said(Topic.IMU, 40, 0.1, 0.2, 0.75) + START)
    assert (reading.yaw_rate, reading.valid, reading.measured) == (0.75, True, 40_000)


def test_the_boards_clock_keeps_its_pace_through_all_its_jumps() -> None:
    chance, steady = random.Random(0), SteadyClock()
    late, times, turns = 0, [], [turn for turn in range(4400) if turn % 97 != 5]  # some are lost
    for turn in turns:
        if turn % 55 == 0:
            late = chance.randrange(1000)
        true = 1_000_000 + round(turn * 1e6 / 220)
        for _ in range(2):
            times.append((true, steady.read(true - late)))
    pace = [(after[1] - before[1]) - (after[0] - before[0]) for before, after in itertools.pairwise(times[100:])]
    assert max(map(abs, pace)) < JITTER + 5
    assert all(-1000 <= shown - true <= 0 for true, shown in times)


def test_after_a_silence_the_clock_keeps_its_pace_at_once() -> None:
    steady = SteadyClock()
    for turn in range(100):
        steady.read(4545 * turn)
    silent_until = steady.read(2_000_000)
    assert steady.read(2_000_000 + 4545 - 3000) - silent_until == pytest.approx(4545, abs=JITTER)


def test_a_clock_that_is_set_for_the_first_time_is_followed_at_once() -> None:
    steady = SteadyClock()
    for utime in range(0, 200_000, 4545):
        steady.read(utime)
    assert steady.read(1_700_000_000_000_000) == 1_700_000_000_000_000


@pytest.mark.parametrize("rate", [math.nan, math.inf, 35.0, -35.0])
def test_an_impossible_rate_is_no_rate(rate: float) -> None:
    (reading,) = MBotGyro().feed(said(Topic.IMU, 40, 0.0, 0.0, rate) + START)
    assert not reading.valid
    assert math.isnan(reading.yaw_rate)


def test_a_lost_byte_that_the_checksum_does_not_miss_is_noticed() -> None:
    one, other = said(Topic.ENCODERS, 40, -1, 1), said(Topic.MOTOR_PWM, 40)
    damaged = one[:15] + one[16:]
    assert one[15] == 0xFF
    assert sum(damaged[5:] + other[:1]) % 256 == 255  # the sum is right
    frames = FrameReader().feed(damaged + other + START)
    assert [frame.topic for frame in frames] == [Topic.MOTOR_PWM]


numbers = st.one_of(st.just(-1), st.just(255), st.integers(-(2**31), 2**31 - 1))


@st.composite
def board_frames(draw: st.DrawFn) -> bytes:
    topic = draw(st.sampled_from(list(LAYOUTS)))
    utime = draw(st.one_of(st.just(-1), st.integers(0, 2**50)))
    if topic is Topic.ENCODERS:
        return said(topic, utime, draw(numbers), draw(numbers))
    if topic is Topic.ANALOG_IN:
        return said(topic, utime)
    return said(topic, utime, *draw(st.lists(st.floats(width=32), max_size=3)))


faults = st.one_of(
    st.tuples(st.just("flip"), st.integers(0, 8 * 84 - 1), st.just(b"")),
    st.tuples(st.just("drop"), st.integers(0, 83), st.binary(min_size=1, max_size=5)),
    st.tuples(st.just("insert"), st.integers(0, 83), st.binary(min_size=1, max_size=5)),
)


def damage(frame: bytes, fault: tuple[str, int, bytes]) -> bytes:
    kind, place, extra = fault
    if kind == "flip":
        place %= 8 * len(frame)
        return frame[: place // 8] + bytes((frame[place // 8] ^ 1 << place % 8,)) + frame[place // 8 + 1 :]
    place %= len(frame)
    return frame[:place] + (extra if kind == "insert" else b"") + frame[place + len(extra) * (kind == "drop") :]


def in_pieces(stream: bytes, sizes: list[int]) -> list[Frame]:
    reader = FrameReader()
    frames: list[Frame] = []
    for size in itertools.chain(sizes, itertools.repeat(1)):
        if not stream:
            return frames
        frames += reader.feed(stream[:size])
        stream = stream[size:]
    return frames


@pytest.mark.slow
@given(
    st.lists(board_frames(), min_size=6, max_size=10),
    st.dictionaries(st.integers(0, 9), faults, min_size=1, max_size=3),
    st.lists(st.integers(1, 100), max_size=5),
)
@example([said(Topic.ENCODERS, 9, -1, -1)] * 6, {2: ("drop", 15, b"x")}, [])
@example([said(Topic.MOTOR_PWM, 9)] * 6, {2: ("insert", 20, said(Topic.MOTOR_PWM, 9)[-1:])}, [])
def test_damage_never_becomes_data_and_costs_itself_and_the_frame_before(
    truth: list[bytes], damaged: dict[int, tuple[str, int, bytes]], sizes: list[int]
) -> None:
    stream = [damage(frame, damaged[index]) if index in damaged else frame for index, frame in enumerate(truth)]
    true = without_arrival(FrameReader().feed(b"".join(truth) + START))
    found = without_arrival(in_pieces(b"".join(stream) + START, sizes))
    remaining = iter(true)
    assert all(frame in remaining for frame in found)  # in order, too
    spared = [frame for index, frame in enumerate(true) if not {index, index + 1} & set(damaged)]
    remaining = iter(found)
    assert all(frame in remaining for frame in spared)
