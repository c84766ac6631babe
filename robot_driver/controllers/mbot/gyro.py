"""The gyro on the MBot board, read from the port that drives the wheels."""

import math

from robot_driver.controllers.mbot.frames import Frame, FrameReader
from robot_driver.gate.wire_mbot import Topic
from robot_driver.gyros.gyro import Gyro, GyroReading

LARGEST_RATE = math.radians(2000.0)  # rad/s; the widest range of the sensor
UPWARD = 2  # index of the vertical axis


class MBotGyro(Gyro):
    """Reads the IMU's rate about the vertical axis, counter-clockwise positive, from the board's messages."""

    baud_rate = 115200  # has no meaning on USB

    def __init__(self) -> None:
        self._reader = FrameReader()

    @property
    def wake_up(self) -> bytes:
        """Do nothing: the board sends as long as it gets the time, which the motors' part does."""
        return b""

    def feed(self, data: bytes) -> list[GyroReading]:
        """Add bytes; return the readings in them."""
        return [_reading(frame) for frame in self._reader.feed(data) if frame.topic is Topic.IMU]


def _reading(frame: Frame) -> GyroReading:
    rate = frame.values[UPWARD]
    valid = abs(rate) <= LARGEST_RATE  # false for NaN
    return GyroReading(rate if valid else math.nan, valid, frame.bytes_since, frame.measured)
