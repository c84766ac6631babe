"""The device's side of the KVH DSP-3000 fibre-optic gyro, 100 Hz asynchronous digital output.

Sources: KVH DSP-3000 technical manual 54-0215; line layout and sign as clients of real units read them
(kvh_drivers, libdsp3000, Autoboat): 21 characters a line, clockwise positive seen from above.
"""

import math

from robot_driver.emulator.device import Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import YawGyro
from robot_driver.emulator.settings import Settings

RATE, INCREMENTAL_ANGLE, INTEGRATED_ANGLE, ZERO = b"RAPZ"
MODES = (RATE, INCREMENTAL_ANGLE, INTEGRATED_ANGLE)


class Dsp3000Device:
    """A DSP-3000 bolted upright to the robot of `plant`; powered up at time 0, in rate mode."""

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self.byte_time = byte_time(settings.dsp3000.baud)
        self.wake_time = self._period = 1.0 / settings.dsp3000.rate
        self._start_up = settings.dsp3000.start_up
        self._gyro = YawGyro(settings, plant)
        self._mode = RATE
        self._integrated = 0.0

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process mode letters; all other bytes, including line ends, are ignored, and nothing is answered."""
        del time  # a letter takes effect at the next sample
        for byte in data:
            if byte in MODES:
                self._mode = byte
            elif byte == ZERO:
                self._integrated = 0.0
        return []

    def wake(self, time: float) -> list[Transmission]:
        """Sample; the line has arrived when its last byte has left the wire."""
        self.wake_time += self._period
        clockwise_rate = -math.degrees(self._gyro.rate(self._period))
        increment = clockwise_rate * self._period
        self._integrated = (self._integrated + increment) % 360.0
        value = {RATE: clockwise_rate, INCREMENTAL_ANGLE: increment, INTEGRATED_ANGLE: self._integrated}[self._mode]
        valid = time >= self._start_up
        line = b"%15.6f   %d\r\n" % (value, valid)
        return [Transmission(time + len(line) * self.byte_time, line)]
