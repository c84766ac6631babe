"""What happens when in a soak: faults of the lines one after the other, and what others do on the bus meanwhile."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from random import Random
from typing import Any

from soaking.robot import Order

PACKET_FAULTS = ("lose", "flip", "drop", "insert")  # of all packets, each way, all the time
ANSWER_FAULTS = ("lose_answer", "delay_answer")  # of all answers of the controller, all the time
PACKET_SHARE = 0.01
REST = (2.0, 8.0)  # s between two faults of the lines
DIPPED = 9.0  # V, below which the robot is to stop where it lasts for 2 s


@dataclass(frozen=True)
class Fault:
    """One fault of a line: what begins it and what ends it, how long it lasts (s), and the streams it interrupts."""

    name: str
    begin: tuple[Order, ...]
    end: tuple[Order, ...]
    seconds: float
    streams: tuple[str, ...] = ()


def always(share: float = PACKET_SHARE) -> list[Order]:
    """Return the orders that have both lines damage packets for the whole time, and answers get lost or be late."""
    faults = [("motor", fault) for fault in (*PACKET_FAULTS, *ANSWER_FAULTS)]
    faults += [("gyro", fault) for fault in PACKET_FAULTS]
    return [Order(line, "fail", (fault, share)) for line, fault in faults]


def faults(chance: Random) -> Iterator[Fault]:
    """Yield faults for ever: each kind once, in another order each time."""
    while True:
        kinds = list(KINDS)
        chance.shuffle(kinds)
        for kind in kinds:
            yield kind(chance)


def _lasting(
    name: str, line: str, action: str, on: tuple[Any, ...], off: tuple[Any, ...], seconds: float, *streams: str
) -> Fault:
    return Fault(name, (Order(line, action, on),), (Order(line, action, off),), seconds, streams)


def _pieces(chance: Random) -> Fault:
    return _lasting("pieces", "motor", "fail", ("byte_gap", 0.002), ("byte_gap", 0.0), chance.uniform(2.0, 5.0))


def _latency(chance: Random) -> Fault:
    return _lasting("latency", "motor", "fail", ("latency", 0.012), ("latency", 0.0), chance.uniform(2.0, 5.0))


def _silence(chance: Random) -> Fault:
    seconds = chance.choice((chance.uniform(0.05, 0.5), chance.uniform(0.5, 4.0)))
    return _lasting("silence", "motor", "fail", ("silent", True), ("silent", False), seconds, "MOTOR_FEEDBACK")


def _silent_gyro(chance: Random) -> Fault:
    seconds = chance.choice((chance.uniform(0.05, 0.5), chance.uniform(0.5, 4.0)))
    return _lasting("silent gyro", "gyro", "fail", ("silent", True), ("silent", False), seconds, "GYRO")


def _burst(chance: Random) -> Fault:
    return _lasting("bursts", "gyro", "burst", (True,), (False,), chance.uniform(2.0, 8.0))


def _unplugged(chance: Random) -> Fault:
    seconds = chance.uniform(0.1, 4.0)
    return Fault("unplugged", (Order("motor", "pull"),), (Order("motor", "put_back"),), seconds, ("MOTOR_FEEDBACK",))


def _unplugged_gyro(chance: Random) -> Fault:
    seconds = chance.uniform(0.1, 4.0)
    return Fault("unplugged gyro", (Order("gyro", "pull"),), (Order("gyro", "put_back"),), seconds, ("GYRO",))


def _reset(chance: Random) -> Fault:
    begin, end = (Order("motor", "power_off"),), (Order("motor", "power_on"),)
    return Fault("controller reset", begin, end, chance.uniform(0.15, 1.0), ("MOTOR_FEEDBACK",))


def _power_cycle(chance: Random) -> Fault:
    begin, end = (Order("gyro", "power_off"),), (Order("gyro", "power_on"),)
    return Fault("power-cycled gyro", begin, end, chance.uniform(0.6, 3.0), ("GYRO",))


def _invalid(chance: Random) -> Fault:
    seconds = chance.uniform(0.1, 2.0)
    return Fault("invalid readings", (Order("gyro", "invalid", (seconds,)),), (), seconds + 0.5)


def _battery(chance: Random) -> Fault:
    seconds = chance.uniform(0.2, 1.5)
    return Fault("battery dip", (Order("motor", "dip", (DIPPED, seconds)),), (), seconds + 0.5)


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
