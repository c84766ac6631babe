"""Exchanges with devices: none may fail, but where the machine stood still."""

import time
from collections.abc import Callable
from typing import Any

from robot_driver.controllers import Request
from robot_driver.serial_port import Answer, SerialPort
from tests.support.stalls import Interval, Stalls

Exchange = Callable[[SerialPort, Request[Any]], Answer[Any]]


class Exchanges:
    """Notes each exchange: from when to when it lasted, and whether it failed."""

    def __init__(self, stalls: Stalls) -> None:
        self._stalls = stalls
        self._made: list[tuple[Interval, bool]] = []

    def noting(self, exchange: Exchange) -> Exchange:
        """Return what takes the place of a port's method `exchange`."""

        def noted(port: SerialPort, request: Request[Any]) -> Answer[Any]:
            asked, failed = time.monotonic(), True
            try:
                answer = exchange(port, request)
                failed = False
                return answer
            finally:
                self._made.append((Interval(asked, time.monotonic()), failed))

        return noted

    def assert_only_stalls_failed(self) -> None:
        """No exchange failed; but where the machine stood still it may, and the next one with it."""
        made = list(self._made)
        assert made
        stalled = set(self._stalls.excused([interval for interval, failed in made if failed], len(made)))
        is_excused = [interval in stalled for interval, _ in made]
        spoilt = [False, *is_excused]
        assert not [
            interval
            for (interval, failed), excused, after_excused in zip(made, is_excused, spoilt, strict=False)
            if failed and not excused and not after_excused
        ]
