"""Yaw gyros: one module per protocol, which converts bytes to readings, and the table of known gyros.

A new gyro is one module with a subclass of `Gyro` and one entry in `GYROS`.
"""

from robot_driver.gyros.dsp3000 import Dsp3000
from robot_driver.gyros.gyro import Gyro, GyroReading
from robot_driver.gyros.kvh_binary import KvhBinary, KvhBinaryX, KvhBinaryY

GYROS: dict[str, type[Gyro]] = {
    "dsp3000": Dsp3000,
    "kvh-binary": KvhBinary,  # its z axis points up
    "kvh-binary-x": KvhBinaryX,
    "kvh-binary-y": KvhBinaryY,
}

__all__ = ["GYROS", "Gyro", "GyroReading"]
