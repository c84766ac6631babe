"""The gyro of one robot, in the thread of its port: keep it sending, and stamp its readings."""

import math
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from cmr.msg import gyro_t
from robot_driver.clock import Stamps
from robot_driver.clock_fit import ClockFit
from robot_driver.gyros import Gyro, GyroReading
from robot_driver.port_thread import Device
from robot_driver.serial_port import SerialPort

SILENCE_LIMIT = 0.5  # s without a reading, or an answer that leads to the next request: then the gyro is restarted
PATIENCE = 0.1  # s without an answer after which a request is repeated
GAP_READINGS, GAP_TIME = 5, 0.05  # missing readings, and delay by adapters (s); above, the gyro may have been off
LONGEST_READ = 0.05  # s
INVALID_LIMIT = 1.0  # s without a valid reading, longer than any supported gyro takes to settle
READ_SIZE = 4096  # bytes
FAREWELLS = 3  # repeated, as one may be damaged or ignored
FAREWELL_PAUSE = 0.05  # s
LONGEST_DELAY = 100_000_000  # ns; above, the sensor's clock is considered not set


class GyroDevice(Device):
    """Publishes a gyro_t for every reading; `sign` -1 is for a sensor mounted upside down.

    `counts` counts readings without a rate: lost ones, which the gyro sent but which never arrived or arrived damaged,
    as far as its protocol shows; and those that it marked invalid, or that may not be rates.
    """

    def __init__(
        self, port: SerialPort, gyro_type: type[Gyro], *, robot_id: int, sign: int, publish: Callable[[gyro_t], None]
    ) -> None:
        self._port = port
        self._host = port.host
        self._gyro_type = gyro_type
        self._gyro = gyro_type()
        self._robot_id = robot_id
        self._sign = sign
        self._publish = publish
        self.counts: Counter[str] = Counter()
        self._last_reading = self._last_valid = self._last_request = 0.0
        self._last_sign = 0.0  # when an expected answer last arrived
        self._heard: int | None = None  # when readings last arrived since the gyro was started (monotonic ns)
        self._stamps = Stamps(port.host.utime_at)
        self._clock_fit: ClockFit | None = None
        self._count = 0

    @property
    def lost(self) -> int:
        """Number of lost readings."""
        return self.counts["lost"]

    def connect(self, stop: threading.Event) -> None:  # noqa: ARG002 - this does not take long
        """Set the gyro's mode."""
        self._wake_up()
        self.problem = ""

    def turn(self, stop: threading.Event) -> None:  # noqa: ARG002 - a read does not take long
        """Publish the readings received; restart the gyro when nothing has arrived for a while."""
        data = self._port.read(READ_SIZE, LONGEST_READ)
        arrived = self._host.monotonic_ns()
        readings = self._gyro.feed(data)
        if readings:
            self._take(readings, arrived)
        now = self._host.monotonic()
        if request := self._gyro.next_request():
            self._ask(request)
            self._last_sign = now
        elif not readings and now - self._last_request > PATIENCE and self._gyro.unanswered:
            self._ask(self._gyro.unanswered)
        if readings:
            self._last_reading = self._last_sign = now
        elif now - self._last_reading > SILENCE_LIMIT:
            self._report_silence()
        if now - self._last_sign > SILENCE_LIMIT:
            self._wake_up()

    def _report_silence(self) -> None:
        self.problem = self._gyro.problem or (
            f"The gyro at {self._port.path} sends no readings. Check its power, its cable and its baud rate "
            f"({self._port.baud_rate})."
        )

    def _ask(self, request: bytes) -> None:
        self._port.write(request)
        self._last_request = self._host.monotonic()

    def _take(self, readings: list[GyroReading], arrived: int) -> None:
        """Publish readings; invalid if they follow a gap, or if their time is uncertain."""
        moments = self._measured(readings, arrived)
        may_have_been_off = self._follow_gap(len(readings), arrived)
        if may_have_been_off or (self._clock_fit is not None and not self._clock_fit.is_known):
            readings = [replace(reading, yaw_rate=math.nan, valid=False) for reading in readings]
        for reading, measured in zip(readings, moments, strict=True):
            self._publish(self._message(reading, measured, arrived))
        self.problem = self._why_no_rate(readings)
        if may_have_been_off:
            self._wake_up()

    def _follow_gap(self, count: int, arrived: int) -> bool:
        """Return whether there was a gap since the last readings that these (`count`) do not fill."""
        before, self._heard = self._heard, arrived
        if before is None or not self._gyro.nominal_rate:
            return False
        missing = (arrived - before) / 1e9 - GAP_TIME - count / self._gyro.nominal_rate
        return missing > GAP_READINGS / self._gyro.nominal_rate

    def _why_no_rate(self, readings: list[GyroReading]) -> str:
        """Count invalid readings; return why there has been no rate for a while, or ""."""
        now = self._host.monotonic()
        for reading in readings:
            if reading.valid:
                self._last_valid = now
            else:
                self.counts["not valid"] += 1
        if now - self._last_valid < INVALID_LIMIT:
            return ""
        return (
            f"The gyro at {self._port.path} says that its readings are not valid. Wait until it has started; if that "
            f"does not help, switch it off and on, and see its manual."
        )

    def leave(self) -> None:
        """Make the gyro send readings again, in case it was reporting its settings."""
        for _ in range(FAREWELLS if self._gyro.farewell else 0):
            self._port.write(self._gyro.farewell)
            self._host.sleep(FAREWELL_PAUSE)

    def _wake_up(self) -> None:
        """Start again with a gyro in an unknown state."""
        self._gyro = self._gyro_type()
        self._ask(self._gyro.wake_up)
        self._clock_fit = None
        self._heard = None
        self._last_reading = self._last_valid = self._last_sign = self._last_request

    def _measured(self, readings: list[GyroReading], arrived: int) -> list[int]:
        """Return when readings that arrived together were taken (monotonic ns), as accurately as possible."""
        numbered = []
        wire_time = self._port.wire_time
        for reading in readings:
            lost = reading.lost_before
            self._count += lost + 1  # including lost ones
            if lost:
                self.counts["lost"] += lost
            numbered.append((self._count, arrived - round(wire_time(reading.bytes_since) * 1e9)))
        if self._gyro.nominal_rate:
            self._clock_fit = self._clock_fit or ClockFit(self._gyro.nominal_rate, self._gyro.unnoticed)
            fitted = self._clock_fit.times_of(numbered)
        else:
            self._clock_fit, fitted = None, [latest for _, latest in numbered]
        return [
            reading.measured if reading.measured and 0 <= arrived - reading.measured < LONGEST_DELAY else time
            for reading, time in zip(readings, fitted, strict=True)
        ]

    def _message(self, reading: GyroReading, measured: int, arrived: int) -> gyro_t:
        pace = self._clock_fit.pace if reading.per_period and self._clock_fit else 1.0
        message = gyro_t()  # not by `make`, which is slow: there may be 5,000 a second
        message.utime = self._stamps.next(measured)
        message.robot_id = self._robot_id
        message.yaw_rate = self._sign * pace * reading.yaw_rate
        message.valid = int(reading.valid)
        message.received_utime = self._host.utime_at(arrived)
        return message
