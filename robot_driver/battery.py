"""When a battery is too empty to drive: a warning first, then a stop that holds until a person has seen to it."""

import math
from dataclasses import dataclass

HYSTERESIS = 0.02  # share above the threshold that ends a warning
DELAY = 2.0  # s below a threshold before it counts: motors that start pull any battery down for a moment


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


class BatteryGuard:
    """Watches one battery. `low` warns; `empty` stays True once it has become so, for as long as the process lives."""

    def __init__(self, thresholds: Thresholds) -> None:
        self.low = False
        self.empty = False
        self._thresholds = thresholds
        self._voltage = math.nan
        self._below_warn_since = self._below_stop_since = math.inf

    def take(self, voltage: float, now: float) -> None:
        """Take a voltage measured at `now` (s); NaN is no measurement."""
        if math.isnan(voltage):
            return
        self._voltage = voltage
        self._below_warn_since = min(self._below_warn_since, now) if voltage < self._thresholds.warn else math.inf
        self._below_stop_since = min(self._below_stop_since, now) if voltage < self._thresholds.stop else math.inf
        if now - self._below_warn_since >= DELAY:
            self.low = True
        elif voltage >= self._thresholds.warn * (1.0 + HYSTERESIS):
            self.low = False
        self.empty = self.empty or now - self._below_stop_since >= DELAY

    @property
    def sentence(self) -> str:
        """What a person has to know and do; "" when the battery is fine."""
        if self.empty:
            return (
                f"Stopped: the battery fell below {self._thresholds.stop:g} V and is at {self._voltage:.1f} V. "
                f"Charge it, then start the driver again."
            )
        if self.low:
            return f"The battery is low: {self._voltage:.1f} V. Below {self._thresholds.stop:g} V the robot stops."
        return ""
