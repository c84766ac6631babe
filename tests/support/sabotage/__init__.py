"""Drivers, gates and devices that break a promise on purpose, each in one way; for tests of the acceptance protocol."""

import re
from collections.abc import Callable
from typing import Any

from robot_driver import serial_port
from tests.support.accepted_robot import NUMBERED
from tests.support.sabotage import commands, line, readings
from tests.support.sabotage.replacing import break_gate


def start(broken: str) -> int:
    """Start cmr-driver, broken in this way, if in any."""
    from cmr.commands import driver

    serial_port.NUMBERED = re.compile(NUMBERED)
    if broken in DRIVERS:
        DRIVERS[broken]()
    return driver()


def ignores_silence(device: Any, _gyro: Any) -> None:
    device._motor_deadline = lambda: float("inf")


def keeps_no_watchdog(device: Any, _gyro: Any) -> None:
    board = type(device.board)
    device.board.__class__ = type("Board", (board,), {"timeout": property(lambda _: 0.0, lambda _, __: None)})


DEVICES: dict[str, Callable[[Any, Any], None]] = {
    "6 ignores silence": ignores_silence,
    "7 keeps none": keeps_no_watchdog,
}
DRIVERS: dict[str, Callable[[], None]] = {
    f"{promise} {way.__name__.replace('_', ' ')}": way
    for promise, ways in sorted((line.WAYS | commands.WAYS | readings.WAYS).items())
    for way in ways
}
DRIVERS["6 its gate stops nothing when it dies"] = lambda: break_gate("stops nothing at its end")
DRIVERS["6 its gate never stops anything"] = lambda: break_gate("never stops anything")
ALL = (*DRIVERS, *DEVICES)


def promise_of(way: str) -> int:
    """Return the promise that is broken."""
    return int(way.split()[0])
