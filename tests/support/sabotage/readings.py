"""Drivers that break promises about what they measure and report: 13 to 17."""

import re
import time
from typing import Any

from robot_driver import rhythm
from tests.support.sabotage.replacing import replace_with, wrap

# 13: counts


def knows_no_wrap() -> None:
    from robot_driver import encoders

    replace_with(encoders, "signed_step", lambda before, after: after - before)


def counts_jumps() -> None:
    from robot_driver import encoders

    def update(original: Any, self: Any, counts: Any, moment: int, _fastest: float) -> Any:
        return original(self, counts, moment, 1e12)

    replace_with(encoders, "FASTEST_WHEEL", 1e12)
    wrap(encoders.WheelEncoders, "update", update)


def takes_a_reset_for_a_jump() -> None:
    from robot_driver import encoders

    def update(original: Any, self: Any, *arguments: Any) -> Any:
        try:
            return original(self, *arguments)
        except encoders.CountersReset:
            self.jumps += 1
            return None

    wrap(encoders.WheelEncoders, "update", update)


# 14: stamps


def goes_back_in_time() -> None:
    from robot_driver import clock, feedback, gyro_device

    class Backwards(clock.Stamps):
        count = 0

        def next(self, moment: int) -> int:
            self.count += 1
            return super().next(moment) - (50_000 if self.count % 20 == 0 else 0)

    replace_with(feedback, "Stamps", Backwards)
    replace_with(gyro_device, "Stamps", Backwards)


def stamps_on_arrival() -> None:
    from robot_driver.gyro_device import GyroDevice

    def measured(original: Any, self: Any, readings: Any, arrived: int) -> list[int]:
        original(self, readings, arrived)
        return [arrived] * len(readings)

    wrap(GyroDevice, "_measured", measured)


def stamps_late() -> None:
    from robot_driver.gyro_device import GyroDevice

    def measured(original: Any, self: Any, readings: Any, arrived: int) -> list[int]:
        return [moment + 30_000_000 for moment in original(self, readings, arrived)]

    wrap(GyroDevice, "_measured", measured)


# 15: rates


def takes_all_readings_for_valid() -> None:
    from robot_driver.gyros import dsp3000

    def reading(original: Any, line: bytes, *arguments: int) -> Any:
        return original(re.sub(rb"0(\r?\n)$", rb"1\1", line), *arguments)

    wrap(dsp3000, "_reading", reading)


def mends_damaged_lines() -> None:
    from robot_driver.gyros.dsp3000 import Dsp3000

    def feed(original: Any, self: Any, data: bytes) -> Any:
        return original(self, bytes(byte for byte in data if byte < 128))

    wrap(Dsp3000, "feed", feed)


def repeats_the_last_rate() -> None:
    from robot_driver.gyro_device import GyroDevice
    from robot_driver.gyros import GyroReading

    def turn(original: Any, self: Any, stop: Any) -> None:
        count = self._count
        original(self, stop)
        if self._count == count and count:
            now = time.monotonic_ns()
            self._publish(self._message(GyroReading(0.0123, True), now, now))

    wrap(GyroDevice, "turn", turn)


# 16: battery


def warns_of_no_battery() -> None:
    from robot_driver.battery import BatteryGuard

    def take(original: Any, self: Any, *arguments: float) -> None:
        original(self, *arguments)
        self.low = False

    wrap(BatteryGuard, "take", take)


def forgives_a_battery() -> None:
    from robot_driver.battery import BatteryGuard
    from robot_driver.command_gate import Stop
    from robot_driver.health import Health

    def take(original: Any, self: Any, voltage: float, now: float) -> None:
        original(self, voltage, now)
        self.empty = self.empty and voltage < self._thresholds.stop

    def decide(original: Any, self: Any, stop: Any, *, hold: bool, release: bool) -> None:
        original(self, stop, hold=hold, release=not hold if stop is Stop.BATTERY else release)

    wrap(BatteryGuard, "take", take)
    wrap(Health, "_decide", decide)


def trusts_an_unknown_battery() -> None:
    from robot_driver.health import Health

    def missing(original: Any, self: Any, now: float) -> set[str]:
        return set(original(self, now)) - {"battery_voltage"}

    wrap(Health, "missing", missing)


# 17: status


def states_nothing() -> None:
    replace_with(rhythm.Rhythm, "sentence", lambda _rhythm: "")


def states_what_was_asked_for() -> None:
    def sentence(original: Any, measured: Any) -> str:
        return re.sub(r"at [\d.]+ Hz", "at 100.0 Hz", original(measured))

    wrap(rhythm.Rhythm, "sentence", sentence)


def states_a_fast_device() -> None:
    def sentence(original: Any, measured: Any) -> str:
        return re.sub(r"answers in .*", "answers in 1.0 ms (99 % within 1.2 ms).", original(measured))

    wrap(rhythm.Rhythm, "sentence", sentence)


WAYS = {
    13: (knows_no_wrap, counts_jumps, takes_a_reset_for_a_jump),
    14: (goes_back_in_time, stamps_on_arrival, stamps_late),
    15: (takes_all_readings_for_valid, mends_damaged_lines, repeats_the_last_rate),
    16: (warns_of_no_battery, forgives_a_battery, trusts_an_unknown_battery),
    17: (states_nothing, states_what_was_asked_for, states_a_fast_device),
}
