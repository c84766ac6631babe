"""What a controller reports besides its encoders, for as long as it is recent."""

import math
from collections.abc import Iterable

from robot_driver.controllers import Request, Telemetry

OLDEST = 1.0  # s; an older reading says nothing about now
CYCLES = 2  # in which a reading may be missed once without being old

WORDS = {
    "battery_voltage": "battery voltage",
    "currents": "motor currents",
    "temperature": "temperature",
    "status": "state of its emergency stop and of its faults",
}


class Readings:
    """The latest answers to the requests for telemetry, each of which counts only while it is recent.

    What was reported once is expected from then on, over all connections, and what is `needed` is expected from the
    beginning. Times are the driver's monotonic clock (s).
    """

    def __init__(self, period: float, needed: Iterable[str]) -> None:
        self.old_after = OLDEST  # s
        self._period = period
        self._answers: dict[str, tuple[float, Telemetry]] = {}  # by request, of this connection
        # When each quantity was reported last, by quantity and request: several may report the same one, each in part.
        self._answered: dict[tuple[str, str], float] = {(key, ""): -math.inf for key in needed}

    def begin(self, requests: int) -> None:
        """Know nothing: a new connection has been made, on which so many requests are made in turn."""
        self.old_after = max(OLDEST, CYCLES * (requests + 1) * self._period)
        self._answers.clear()
        self._answered = dict.fromkeys(self._answered, -math.inf)

    def take(self, request: Request[Telemetry], answer: Telemetry, now: float) -> None:
        """Take what a request was answered."""
        self._answers[request.name] = now, answer
        for key in answer:
            self._answered[key, request.name] = now
            self._answered.pop((key, ""), None)

    def recent(self, now: float) -> Telemetry:
        """Return all that was reported lately, of the same quantity the latest."""
        result = Telemetry()
        for moment, answer in sorted(self._answers.values(), key=lambda item: item[0]):
            if now - moment <= self.old_after:
                result.update(answer)
        return result

    def unknown(self, now: float) -> dict[str, float]:
        """Return for how long each quantity has not been reported, in whole or in part, where that is too long (s).

        Infinity: not since the connection was made.
        """
        result: dict[str, float] = {}
        for (key, _), moment in self._answered.items():
            if now - moment > self.old_after:
                result[key] = max(result.get(key, 0.0), now - moment)
        return result


def sentence_on(unknown: dict[str, float], path: str) -> str:
    """Return what a person has to know of `unknown` quantities of the controller at `path`; "" when all are known."""
    seconds = {key: "" if math.isinf(age) else f" for {age:.0f} s" for key, age in unknown.items()}
    moment = [f"{words} unknown{seconds[key]}" for key, words in WORDS.items() if key in unknown]
    return f"The controller at {path} does not report everything: {', '.join(moment)}." if moment else ""
