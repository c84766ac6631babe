"""Drivers and gates that break promises about commands and stops: 8, 9, 18 and 19."""

import time
from contextlib import suppress
from typing import Any

from cmr.model import duty_ramp
from robot_driver import command_gate, motors
from robot_driver.controllers import BadReply
from tests.support.sabotage.replacing import break_gate, replace_with, wrap

# 8: stale commands


def obeys_for_long() -> None:
    replace_with(command_gate, "COMMAND_LIFETIME", 2.0)
    break_gate("lets commands live")


def jumps() -> None:
    replace_with(duty_ramp.Ramp, "towards", lambda _ramp, left, right, _now: (left, right))


def obeys_old_commands() -> None:
    def offer(original: Any, self: Any, _decided: int, *duties: float, now: float, utime: int) -> bool:
        return bool(original(self, utime, *duties, now=now, utime=utime))

    wrap(command_gate.CommandGate, "offer", offer)


# 9: signals


def leaves_the_motors_on() -> None:
    replace_with(motors.Motors, "leave", lambda self: setattr(self, "_connection", None))
    break_gate("stops nothing at its end")


def ignores_signals() -> None:
    from cmr.bus.process import Process

    replace_with(Process, "_note_signal", lambda *_: None)


def asks_once_for_zero() -> None:
    def leave(_original: Any, self: Any) -> None:
        if self._connection is not None:
            with suppress(BadReply):
                self._port.exchange(self._connection.controller.drive(0.0, 0.0))
        self._connection = None

    wrap(motors.Motors, "leave", leave)
    break_gate("stops nothing at its end")


# 18: emergency stop


def goes_on_after_a_release() -> None:
    def hold(original: Any, self: Any, stop: Any) -> None:
        original(self, stop)
        self._zero_first = False

    def offer(original: Any, self: Any, *arguments: Any, **named: Any) -> bool:
        self._zero_first = False
        return bool(original(self, *arguments, **named))

    wrap(command_gate.CommandGate, "hold", hold)
    wrap(command_gate.CommandGate, "offer", offer)


def obeys_before_it_listens() -> None:
    from robot_driver import bus_stop

    replace_with(command_gate, "LISTENING_TIME", 0.0)
    begun = time.monotonic()

    def handle(original: Any, self: Any, *arguments: Any, **named: Any) -> None:
        if time.monotonic() > begun + 2.5:
            original(self, *arguments, **named)

    wrap(bus_stop.BusStop, "handle", handle)


def takes_old_releases() -> None:
    def take(original: Any, self: Any, engaged: bool, decided: int, *, utime: int) -> bool:
        return bool(original(self, engaged, decided if engaged else utime, utime=utime))

    wrap(command_gate.CommandGate, "take_estop", take)


# 19: the stop that lasts


def keeps_no_stop() -> None:
    from robot_driver import stop_file

    replace_with(stop_file.StopKeeper, "keep", lambda _self, _stop: None)


def takes_releases_without_a_name() -> None:
    from robot_driver import bus_stop

    replace_with(bus_stop.BusStop, "_objection", lambda _self, _release: "")


def reads_no_stop() -> None:
    from robot_driver import stop_file

    def path(original: Any, *arguments: Any, **named: Any) -> None:
        original(*arguments, **named)
        arguments[0].path.unlink(missing_ok=True)

    wrap(stop_file.StopFile, "__init__", path)


WAYS = {
    8: (obeys_for_long, jumps, obeys_old_commands),
    9: (leaves_the_motors_on, ignores_signals, asks_once_for_zero),
    18: (goes_on_after_a_release, obeys_before_it_listens, takes_old_releases),
    19: (keeps_no_stop, takes_releases_without_a_name, reads_no_stop),
}
