"""Yaw gyros: one module per protocol, bytes in and readings out, and the table of those we know.

A new gyro is one module with a subclass of `Gyro` and one entry in `GYROS`.
"""

from robot_driver.gyros.dsp3000 import Dsp3000
from robot_driver.gyros.gyro import Gyro, GyroReading

GYROS: dict[str, type[Gyro]] = {"dsp3000": Dsp3000}

__all__ = ["GYROS", "Gyro", "GyroReading"]
