"""The faults of the serial lines in a soak test."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from random import Random
from typing import Any

from soaking.robot import Order

PACKET_FAULTS = ("lose", "flip", "drop", "insert")  # throughout, in both directions
ANSWER_FAULTS = ("lose_answer", "delay_answer")  # throughout, for answers of the controller
PACKET_SHARE = 0.01
REST = (2.0, 8.0)  # s between two further faults
DIP_VOLTAGE = 9.0  # V; the robot stops if the voltage is that low for 2 s


@dataclass(frozen=True)
class Fault:
    """One fault of a line: the orders that begin and end it, its duration [s], and the streams that it interrupts."""

    name: str
    begin: tuple[Order, ...]
    end: tuple[Order, ...]
    seconds: float
    streams: tuple[str, ...] = ()


def always(share: float = PACKET_SHARE) -> list[Order]:
    """Return the orders for faults that last throughout: damaged packets, and lost or late answers."""
    faults = [("motor", fault) for fault in (*PACKET_FAULTS, *ANSWER_FAULTS)]
    faults += [("gyro", fault) for fault in PACKET_FAULTS]
    return [Order(line, "fail", (fault, share)) for line, fault in faults]


def faults(rng: Random) -> Iterator[Fault]:
    """Yield faults for ever: all kinds in random order, again and again."""
    while True:
        kinds = list(KINDS)
        rng.shuffle(kinds)
        for kind in kinds:
            yield kind(rng)


def _lasting(
    name: str, line: str, action: str, on: tuple[Any, ...], off: tuple[Any, ...], seconds: float, *streams: str
) -> Fault:
    return Fault(name, (Order(line, action, on),), (Order(line, action, off),), seconds, streams)


def _pieces(rng: Random) -> Fault:
    return _lasting("pieces", "motor", "fail", ("byte_gap", 0.002), ("byte_gap", 0.0), rng.uniform(2.0, 5.0))


def _latency(rng: Random) -> Fault:
    return _lasting("latency", "motor", "fail", ("latency", 0.012), ("latency", 0.0), rng.uniform(2.0, 5.0))


def _silence(rng: Random) -> Fault:
    seconds = rng.choice((rng.uniform(0.05, 0.5), rng.uniform(0.5, 4.0)))
    return _lasting("silence", "motor", "fail", ("silent", True), ("silent", False), seconds, "MOTOR_FEEDBACK")


def _silent_gyro(rng: Random) -> Fault:
    seconds = rng.choice((rng.uniform(0.05, 0.5), rng.uniform(0.5, 4.0)))
    return _lasting("silent gyro", "gyro", "fail", ("silent", True), ("silent", False), seconds, "GYRO")


def _burst(rng: Random) -> Fault:
    return _lasting("bursts", "gyro", "burst", (True,), (False,), rng.uniform(2.0, 8.0))


def _unplugged(rng: Random) -> Fault:
    seconds = rng.uniform(0.1, 4.0)
    return Fault("unplugged", (Order("motor", "pull"),), (Order("motor", "put_back"),), seconds, ("MOTOR_FEEDBACK",))


def _unplugged_gyro(rng: Random) -> Fault:
    seconds = rng.uniform(0.1, 4.0)
    return Fault("unplugged gyro", (Order("gyro", "pull"),), (Order("gyro", "put_back"),), seconds, ("GYRO",))


def _reset(rng: Random) -> Fault:
    begin, end = (Order("motor", "power_off"),), (Order("motor", "power_on"),)
    return Fault("controller reset", begin, end, rng.uniform(0.15, 1.0), ("MOTOR_FEEDBACK",))


def _power_cycle(rng: Random) -> Fault:
    begin, end = (Order("gyro", "power_off"),), (Order("gyro", "power_on"),)
    return Fault("power-cycled gyro", begin, end, rng.uniform(0.6, 3.0), ("GYRO",))


def _invalid(rng: Random) -> Fault:
    seconds = rng.uniform(0.1, 2.0)
    return Fault("invalid readings", (Order("gyro", "invalid", (seconds,)),), (), seconds + 0.5)


def _battery(rng: Random) -> Fault:
    seconds = rng.uniform(0.2, 1.5)
    return Fault("battery dip", (Order("motor", "dip", (DIP_VOLTAGE, seconds)),), (), seconds + 0.5)


KINDS: tuple[Callable[[Random], Fault], ...] = (
    _pieces,
    _latency,
    _silence,
    _silent_gyro,
    _burst,
    _unplugged,
    _unplugged_gyro,
    _reset,
    _power_cycle,
    _invalid,
    _battery,
)
