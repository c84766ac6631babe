"""Slow readings of a controller, besides its encoders, while they are recent."""

import math
from collections.abc import Iterable

from robot_driver.controllers import Request, Telemetry

OLDEST = 1.0  # s; older readings are outdated
CYCLES = 2  # cycles of requests, so that one missed reading does not count as old

WORDS = {
    "battery_voltage": "battery voltage",
    "currents": "motor currents",
    "temperature": "temperature",
    "status": "state of its emergency stop and of its faults",
}


class Readings:
    """The latest answers to the requests for telemetry, each valid only while it is recent.

    A quantity reported once is expected from then on, on all connections; those `needed` are expected from the
    beginning. Times are the driver's monotonic clock (s).
    """

    def __init__(self, period: float, needed: Iterable[str]) -> None:
        self.old_after = OLDEST  # s
        self._period = period
        self._answers: dict[str, tuple[float, Telemetry]] = {}  # by request, of this connection
        # Time of the last report, by quantity and request: several requests may each report a part of a quantity.
        self._answered: dict[tuple[str, str], float] = {(key, ""): -math.inf for key in needed}

    def begin(self, requests: int) -> None:
        """Forget all readings: a new connection was made, on which this many requests are made in turn."""
        self.old_after = max(OLDEST, CYCLES * (requests + 1) * self._period)
        self._answers.clear()
        self._answered = dict.fromkeys(self._answered, -math.inf)

    def take(self, request: Request[Telemetry], answer: Telemetry, now: float) -> None:
        """Store the answer to a request."""
        self._answers[request.name] = now, answer
        for key in answer:
            self._answered[key, request.name] = now
            self._answered.pop((key, ""), None)

    def recent(self, now: float) -> Telemetry:
        """Return all recent readings; the latest if a quantity was reported several times."""
        result = Telemetry()
        for moment, answer in sorted(self._answers.values(), key=lambda item: item[0]):
            if now - moment <= self.old_after:
                result.update(answer)
        return result

    def unknown(self, now: float) -> dict[str, float]:
        """Return how long ago overdue quantities were last reported, in whole or in part (s).

        Infinity: not on this connection.
        """
        result: dict[str, float] = {}
        for (key, _), moment in self._answered.items():
            if now - moment > self.old_after:
                result[key] = max(result.get(key, 0.0), now - moment)
        return result


def sentence_on(unknown: dict[str, float], path: str) -> str:
    """Return a sentence on `unknown` quantities of the controller at `path`; "" if all are known."""
    seconds = {key: "" if math.isinf(age) else f" for {age:.0f} s" for key, age in unknown.items()}
    moment = [f"{words} unknown{seconds[key]}" for key, words in WORDS.items() if key in unknown]
    return f"The controller at {path} does not report everything: {', '.join(moment)}." if moment else ""
