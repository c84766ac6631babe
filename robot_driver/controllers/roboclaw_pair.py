"""Two RoboClaws on one line, for four motors: unit 0x80 in front, 0x81 behind, M1 on the same side in both."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from robot_driver.controllers.controller import COUNTER_RANGE, Controller, Request, Telemetry, signed_step
from robot_driver.controllers.roboclaw import RoboClaw

T = TypeVar("T")

ADDRESSES = (0x80, 0x81)


class RoboClawPair(Controller):
    """Both units get the same duty; the count of a side is the mean of its two wheels.

    The rear unit is addressed after the front one has answered; duties are sent to it in any case. Both must be armed,
    and either can report a fault.
    """

    default_baud_rate = RoboClaw.default_baud_rate
    other_baud_rates = RoboClaw.other_baud_rates
    link = "packet serial, addresses 0x80 and 0x81,"
    essential = frozenset({"status"})

    def __init__(self) -> None:
        self._front, self._rear = (RoboClaw(address) for address in ADDRESSES)
        self._before = (0, 0, 0, 0)
        self._steps = [0, 0]  # of both sides since their counts were zero, sum of front and rear

    def identify(self) -> Request[str]:
        """Read the firmware's name of both."""
        return _both(self._front.identify(), self._rear.identify(), lambda front, rear: f"{front} and {rear}")

    def learn(self) -> list[Request[None]]:
        """Determine the status format of each; their firmware may differ."""
        return [*self._front.learn(), *self._rear.learn()]

    def set_watchdog(self, seconds: float) -> Request[None]:
        """Set the watchdog of both."""
        return _both(self._front.set_watchdog(seconds), self._rear.set_watchdog(seconds), lambda _front, _rear: None)

    def read_watchdog(self) -> Request[float]:
        """Read both; if they differ, return the one that is not as required."""

        def wrong_one(front: float, rear: float) -> float:
            return max(front, rear, key=lambda seconds: abs(seconds - self.watchdog_seconds))

        return _both(self._front.read_watchdog(), self._rear.read_watchdog(), wrong_one)

    def drive(self, first: float, second: float) -> Request[tuple[float, float]]:
        """Set the duty of M1 and of M2 in both; in the rear unit even if the front one does not answer."""
        rear = self._rear.drive(first, second)
        return replace(_both(self._front.drive(first, second), rear, lambda front, _rear: front), otherwise=rear)

    def stops(self) -> list[Request[tuple[float, float]]]:
        """Stop each for itself: if one is dead, the other must still be stopped."""
        return [self._front.drive(0.0, 0.0), self._rear.drive(0.0, 0.0)]

    def read_encoders(self) -> Request[tuple[int, int]]:
        """Read the counts of both; the result for each side is the mean over its two wheels."""
        return _both(self._front.read_encoders(), self._rear.read_encoders(), self._mean_counts)

    def read_telemetry(self) -> list[Request[Telemetry]]:
        """Read the telemetry of both, one after the other."""
        pairs = zip(self._front.read_telemetry(), self._rear.read_telemetry(), strict=True)
        return [_both(front, rear, together) for front, rear in pairs]

    def _mean_counts(self, front: tuple[int, int], rear: tuple[int, int]) -> tuple[int, int]:
        counts = (*front, *rear)
        steps = [signed_step(then, now) for then, now in zip(self._before, counts, strict=True)]
        self._before = counts
        self._steps = [self._steps[side] + steps[side] + steps[side + 2] for side in (0, 1)]
        return self._steps[0] // 2 % COUNTER_RANGE, self._steps[1] // 2 % COUNTER_RANGE


def together(front: Telemetry, rear: Telemetry) -> Telemetry:
    """Combine the measurements of two units with one battery: the lower voltage, the total current, the higher
    temperature.
    """
    result = Telemetry()
    if "battery_voltage" in front:
        result["battery_voltage"] = min(front["battery_voltage"], rear["battery_voltage"])
    if "currents" in front:
        result["currents"] = (front["currents"][0] + rear["currents"][0], front["currents"][1] + rear["currents"][1])
    if "temperature" in front:
        result["temperature"] = max(front["temperature"], rear["temperature"])
    if "status" in front:
        result["status"] = front["status"] | rear["status"]
    return result


def _both(front: Request[T], rear: Request[T], combine: Callable[[T, T], T]) -> Request[T]:
    """Return a request to the front unit followed by one to the rear unit, with a combined answer."""
    return replace(front, then=lambda said: replace(rear, parse=lambda reply: combine(said, rear.parse(reply))))
