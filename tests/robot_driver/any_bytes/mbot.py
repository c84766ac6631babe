"""MBot frames: believed only when both checks are right and the next frame begins right behind."""

import math
import struct
from collections.abc import Callable, Iterator
from typing import Any, TypeVar
from unittest.mock import patch

from robot_driver.controllers import Request
from robot_driver.controllers.mbot import MBot, MBotGyro
from robot_driver.controllers.mbot.frames import LAYOUTS, Frame, FrameReader
from robot_driver.emulator.mbot_device import frame
from robot_driver.gate.wire_mbot import HEADER_BYTES, OVERHEAD_BYTES, START, Topic
from tests.robot_driver.any_bytes.script import Script, in_pieces, taken_as_reply, understood

T = TypeVar("T")

LONGEST = 84  # bytes: the IMU's
TOPICS = list(LAYOUTS)
DUTIES = (1.0, 0.5, 0.1, 0.0, -0.3, -1.0)
TURN = 10_000  # us; times in scripts are mostly whole turns after our clock's 0
WATCHDOG = 1.0  # s; what is built in
NOW = 3_000_000_000  # ns; our clock when the driver looks at what has come


def check(data: bytes) -> None:
    """Check what frames, and the motors and the gyro behind them, promise."""
    script = Script(data)
    sizes, duties = script.sizes(), (script.one_of(DUTIES), script.one_of(DUTIES))
    stream = script.stream(_whole) + TAIL
    reader, frames = FrameReader(), _frames(stream)
    found = list(in_pieces(reader.feed, stream, sizes))
    assert {end - one.bytes_since: (one.topic, repr((one.utime, *one.values))) for end, one in found} == frames
    assert len(reader._data) <= LONGEST + len(START)
    assert [one.measured for _, one in found] == [one.measured for one in FrameReader().feed(stream)]
    _check_gyro(stream, [one for _, one in found], sizes)
    _check_motors(stream, [one for _, one in found], duties, sizes)


def _frames(stream: bytes) -> dict[int, tuple[int, str]]:
    """Return topics and numbers of the frames by where they begin; the first wins where two overlap."""
    found: dict[int, tuple[int, str]] = {}
    free = 0
    for start in range(len(stream) - OVERHEAD_BYTES):
        topic = int.from_bytes(stream[start + 5 : start + 7], "little")
        layout = LAYOUTS.get(topic)  # type: ignore[call-overload]  # an IntEnum is found by its number
        if start < free or layout is None:
            continue
        payload = stream[start + HEADER_BYTES : start + HEADER_BYTES + layout.size]
        whole = frame(topic, payload)
        if len(payload) == layout.size and stream.startswith(whole + START, start):
            found[start] = (topic, repr(layout.unpack(payload)))
            free = start + len(whole)
    return found


def _check_gyro(stream: bytes, found: list[Frame], sizes: Iterator[int]) -> None:
    told = [reading for _, reading in in_pieces(MBotGyro().feed, stream, sizes)]
    rates = [one.values[2] for one in found if one.topic is Topic.IMU]
    assert len(told) == len(rates)
    for reading, rate in zip(told, rates, strict=True):
        assert reading.valid == (abs(rate) <= math.radians(2000.0))
        assert reading.yaw_rate == rate if reading.valid else math.isnan(reading.yaw_rate)


def _check_motors(stream: bytes, found: list[Frame], duties: tuple[float, float], sizes: Iterator[int]) -> None:
    """Check that each answer is in a frame; the clock stands at 0 whenever the board is told something."""
    mbot, position = MBot(), 0

    def answer(ask: Callable[[], Request[T]]) -> T | None:
        nonlocal position
        with patch.object(mbot, "monotonic_ns", lambda: 0):
            request = ask()
        with patch.object(mbot, "monotonic_ns", lambda: NOW):
            reply = taken_as_reply(request, stream[position:], sizes)
            position += len(reply)
            said = understood(request, reply)
        return None if said is None else said[0]

    assert answer(mbot.identify) in (None, "MBot control board")
    counts = answer(mbot.read_encoders)
    wheels = [(left % 2**32, -right % 2**32) for left, right in _values(found, Topic.ENCODERS, 0, 1)]
    assert counts is None or counts in wheels
    battery = answer(lambda: mbot.read_telemetry()[0])
    assert battery is None or (battery["battery_voltage"],) in _values(found, Topic.ANALOG_IN, 7)
    confirmed = answer(lambda: mbot.drive(*duties))
    assert confirmed is None or (confirmed[0], -confirmed[1]) in _values(found, Topic.MOTOR_PWM, 0, 1)
    seconds = answer(mbot.read_watchdog)
    assert seconds is None or seconds >= WATCHDOG


def _values(found: list[Frame], topic: Topic, *places: int) -> list[tuple[Any, ...]]:
    return [tuple(one.values[place] for place in places) for one in found if one.topic is topic]


def _whole(script: Script) -> bytes:
    topic = script.one_of(TOPICS)
    layout = LAYOUTS[topic]
    if script.number(8) == 0:
        return frame(topic, script.take(layout.size).ljust(layout.size, b"\0"))
    utime = struct.pack("<q", TURN * script.number(256))
    if topic is Topic.MOTOR_PWM:
        return frame(topic, utime + struct.pack("<3f", script.one_of(DUTIES), -script.one_of(DUTIES), 0.0))
    return frame(topic, utime + script.take(layout.size - 8).ljust(layout.size - 8, b"\0"))


# What noise may reach into, and what must be found whatever came before it.
TAIL = 6 * frame(Topic.MOTOR_VELOCITY, bytes(20)) + START
