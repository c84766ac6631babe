"""Frames of the MBot board: their contents, and how to find them in a stream.

The frame format is described in robot_driver/gate/wire_mbot.py.
"""

import struct
from typing import NamedTuple

from robot_driver.controllers.mbot.clock import SteadyClock
from robot_driver.gate.wire_mbot import HEADER_BYTES, START, Topic, check_of

MOST_FOREIGN = 10  # topics

# The board's messages, as `struct` formats. The first number of each is the time, in us of the board's clock.
LAYOUTS = {
    Topic.ODOMETRY: struct.Struct("<q3f"),  # x, y, theta
    Topic.IMU: struct.Struct("<q17f"),  # rates (rad/s), accelerations, field, roll pitch yaw, quaternion, temperature
    Topic.ENCODERS: struct.Struct("<q3q3ii"),  # counts, steps, us since the last steps
    Topic.ANALOG_IN: struct.Struct("<q4h4f"),  # raw, V
    Topic.MOTOR_VELOCITY: struct.Struct("<q3f"),  # rad/s
    Topic.MOTOR_PWM: struct.Struct("<q3f"),  # duties
    Topic.VELOCITY: struct.Struct("<q3f"),  # m/s, m/s, rad/s
}


class Frame(NamedTuple):
    """A message of the board: its time (us of its clock), and the other numbers of the layout.

    `measured` is the same time without clock jumps (ns). `bytes_since` is how many bytes had been received since the
    frame began.
    """

    topic: Topic
    utime: int
    values: tuple[float, ...]
    measured: int
    bytes_since: int


class FrameReader:
    """Finds the board's frames in a stream of pieces of any size.

    An 8-bit checksum misses much: a payload that lost a byte FF, and takes the next frame's FF, has the right sum. So a
    frame is accepted only when the next one begins right after it, and after a wrong one the search continues inside
    it: damage costs the damaged frame and the one before it. `foreign` holds unknown topics.
    """

    def __init__(self) -> None:
        self._data = b""
        self._clock = SteadyClock()
        self.foreign: set[int] = set()

    def feed(self, data: bytes) -> list[Frame]:
        """Add bytes; return the frames that can now be accepted."""
        self._data += data
        frames: list[Frame] = []
        position = 0
        while (start := self._data.find(START, position)) >= 0:
            end = _end(self._data, start)
            if end is None or (end and len(self._data) < end + len(START)):
                break
            if end and _is_sound(self._data, start, end):
                frames.append(self._frame(start))
                position = end
            else:
                self._note_foreign(start)
                position = start + len(START)
        # If nothing begins, the last byte may still be the first half of a start.
        self._data = self._data[start if start >= 0 else max(len(self._data) - 1, position) :]
        return frames

    def _note_foreign(self, start: int) -> None:
        """Record the topic of a frame with valid checksums but unknown topic."""
        header = self._data[start : start + HEADER_BYTES]
        length, check, topic = struct.unpack_from("<HBH", header, len(START))
        end = start + HEADER_BYTES + length + 1
        is_frame = length and end <= len(self._data) and check_of(header[2:4])[0] == check
        if is_frame and _is_sound(self._data, start, end) and topic not in LAYOUTS and len(self.foreign) < MOST_FOREIGN:
            self.foreign.add(topic)

    def _frame(self, start: int) -> Frame:
        (topic,) = struct.unpack_from("<H", self._data, start + 5)
        utime, *values = LAYOUTS[topic].unpack_from(self._data, start + HEADER_BYTES)
        return Frame(Topic(topic), utime, tuple(values), 1000 * self._clock.read(utime), len(self._data) - start)


def _end(data: bytes, start: int) -> int | None:
    """Return the end of a possible frame that begins here; 0 if it is not one of the board's, None if more bytes are
    needed.
    """
    header = data[start : start + HEADER_BYTES]
    if len(header) < HEADER_BYTES:
        return None
    length, check, topic = struct.unpack_from("<HBH", header, len(START))
    layout = LAYOUTS.get(topic)
    if layout is None or layout.size != length or check_of(header[2:4])[0] != check:
        return 0
    return start + HEADER_BYTES + layout.size + 1


def _is_sound(data: bytes, start: int, end: int) -> bool:
    return data.startswith(START, end) and check_of(data[start + 5 : end - 1]) == data[end - 1 : end]
