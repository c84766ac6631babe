"""Battery protection: a warning first, then a stop that holds until a person intervenes."""

import math
from dataclasses import dataclass

HYSTERESIS = 0.02  # share above a threshold from which the voltage is well above it
DELAY = 2.0  # s below a threshold before it counts: motors that start pull any battery down for a moment
LONGEST_GAP = 1.5  # s between measurements; longer gaps count as unknown


@dataclass(frozen=True)
class Thresholds:
    """Voltages below which to warn and to stop; 0 for never.

    Raises ValueError when the warning would not come before the stop.
    """

    warn: float = 0.0
    stop: float = 0.0

    def __post_init__(self) -> None:
        in_order = self.stop < self.warn if self.warn and self.stop else True
        if not (0.0 <= self.warn < math.inf and 0.0 <= self.stop < math.inf and in_order):
            raise ValueError(
                f"The battery is to warn below {self.warn:g} V and stop below {self.stop:g} V: the warning must come "
                f"first."
            )


class TimeBelow:
    """Accumulates how many `seconds` longer a voltage has been below a threshold than well above it; 0 to DELAY.

    So a battery that is below most of the time is detected, however often it recovers briefly.
    """

    def __init__(self, threshold: float) -> None:
        self.seconds = 0.0
        self._threshold = threshold
        self._side = 0  # 1 below, -1 well above, 0 between

    def take(self, voltage: float, elapsed: float) -> None:
        """Process a voltage (V) measured `elapsed` seconds after the last one."""
        above = voltage >= self._threshold * (1.0 + HYSTERESIS)
        before, self._side = self._side, 1 if voltage < self._threshold else -1 if above else 0
        self.seconds = min(max(self.seconds + elapsed * (before + self._side) / 2.0, 0.0), DELAY)


class BatteryGuard:
    """Monitors one battery. `low` warns; `empty` stays True for the life of the process."""

    def __init__(self, thresholds: Thresholds) -> None:
        self.low = False
        self.empty = False
        self._thresholds = thresholds
        self._voltage = math.nan
        self._measured = math.inf  # before the first measurement no time has passed
        self._below_warn = TimeBelow(thresholds.warn)
        self._below_stop = TimeBelow(thresholds.stop)

    def take(self, voltage: float, now: float) -> None:
        """Process a voltage measured at `now` (s); NaN is no measurement."""
        if math.isnan(voltage):
            return
        elapsed = min(max(now - self._measured, 0.0), LONGEST_GAP)
        self._voltage, self._measured = voltage, now
        for time_below in (self._below_warn, self._below_stop):
            time_below.take(voltage, elapsed)
        self.low = self._below_warn.seconds >= DELAY or (self.low and self._below_warn.seconds > 0.0)
        self.empty = self.empty or self._below_stop.seconds >= DELAY

    @property
    def sentence(self) -> str:
        """A sentence for a person on what to do; "" when the battery is fine."""
        if self.empty:
            return (
                f"Stopped: the battery fell below {self._thresholds.stop:g} V and is at {self._voltage:.1f} V. "
                f"Charge it, then start the driver again."
            )
        if self.low:
            stops = f" Below {self._thresholds.stop:g} V the robot stops." if self._thresholds.stop else ""
            return f"The battery is low: {self._voltage:.1f} V.{stops}"
        return ""
