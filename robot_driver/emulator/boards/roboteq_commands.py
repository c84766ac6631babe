"""The commands that an emulated Roboteq knows, by name: actions (!), queries (?) and settings (^, read by ~).

Source: Roboteq "Advanced Digital Motor Controller User Manual", commands reference. Commands in no table are refused.
"""

from collections.abc import Callable, Container
from typing import NamedTuple

from robot_driver.emulator.boards.roboteq import (
    CLOSED_LOOP_SPEED,
    CLOSED_LOOP_SPEED_POSITION,
    OPEN_LOOP,
    RoboteqBoard,
)

IDENTITY = "Roboteq v1.6 SDC2160 05/01/2016"
INTERNAL_VOLTAGE, FIVE_VOLTS = 135, 4730  # 0.1 V, mV


class Action(NamedTuple):
    """An action: the function to call with the numbers after its name."""

    what: str
    do: Callable[..., object]


class Query(NamedTuple):
    """A query: the function that reads its values, mostly one per channel."""

    what: str
    read: Callable[[RoboteqBoard], list[int]]


class Setting(NamedTuple):
    """A setting, of each channel or of the whole device, and the values that it can have."""

    what: str
    is_of_channel: bool
    values: Container[int]


def _temperatures(board: RoboteqBoard) -> list[int]:
    """Return those of the processor and of both sides, all alike (deg C)."""
    return [round(board.settings.electrics.temperature)] * 3


ACTIONS = {
    "AC": Action("channel, its ramp upwards, 0.1 rpm/s", lambda board, *both: board.set_ramp("MAC", *both)),
    "C": Action("channel, its count", lambda board, channel, count: board.set_count(channel, count)),
    "DC": Action("channel, its ramp downwards, 0.1 rpm/s", lambda board, *both: board.set_ramp("MDEC", *both)),
    "EES": Action("settings to the flash; counted only", lambda board: board.save()),
    "EX": Action("emergency stop", lambda board: board.stop_for_emergency()),
    "G": Action("channel, 0.001 of its power or speed", lambda board, channel, value: board.want(channel, value)),
    "M": Action("0.001 of power or speed of both channels", lambda board, *both: board.want_both(*both)),
    "MG": Action("release of the emergency stop", lambda board: board.release()),
    "MS": Action("channel that stops", lambda board, channel: board.want(channel, 0)),
    "S": Action("channel, its speed in rpm", lambda board, channel, speed: board.want_rpm(channel, speed)),
}
QUERIES = {
    "A": Query("currents of the motors, 0.1 A", lambda board: board.currents()),
    "BA": Query("currents from the battery, 0.1 A", lambda board: board.battery_currents()),
    "C": Query("counts", lambda board: board.encoders()),
    "CR": Query("counts since they were asked for", lambda board: board.encoders_since_asked()),
    "FF": Query("fault flags", lambda board: [board.faults]),
    "FM": Query("flags of the motors", lambda board: board.motor_flags),
    "M": Query("commands in force", lambda board: board.wanted),
    "P": Query("powers, 0.001", lambda board: board.duty),
    "S": Query("speeds in rpm", lambda board: [round(speed) for speed in board.speeds()]),
    "SR": Query("speeds, 0.001 of the largest", lambda board: board.relative_speeds()),
    "T": Query("temperatures, °C", _temperatures),
    "V": Query(
        "voltages: internal and battery in 0.1 V, 5 V output in mV",
        lambda board: [INTERNAL_VOLTAGE, round(board.plant.battery_voltage() * 10), FIVE_VOLTS],
    ),
}
SETTINGS = {
    "CLIN": Setting("0: commands are taken as they are", True, (0,)),
    "ECHOF": Setting("1: no echo", False, (0, 1)),
    "EPPR": Setting("pulses a turn of the encoder", True, range(1, 5001)),
    "KD": Setting("gain D of the speed loop, 0.1 s", True, range(251)),
    "KI": Setting("gain I of the speed loop, 0.1/s", True, range(251)),
    "KP": Setting("gain P of the speed loop, 0.1", True, range(251)),
    "MAC": Setting("ramp upwards, 0.1 rpm/s; 0: none", True, range(500001)),
    "MDEC": Setting("ramp downwards, 0.1 rpm/s; 0: none", True, range(500001)),
    "MMOD": Setting(
        "0: open loop, 1: speed, 6: speed and position",
        True,
        (OPEN_LOOP, CLOSED_LOOP_SPEED, CLOSED_LOOP_SPEED_POSITION),
    ),
    "MXMD": Setting("0: each channel for itself", False, (0,)),
    "MXPF": Setting("largest power forwards, %", True, range(25, 101)),
    "MXPR": Setting("largest power backwards, %", True, range(25, 101)),
    "MXRPM": Setting("largest speed, rpm", True, range(10, 65536)),
    "RWD": Setting("watchdog, ms; 0: none", False, range(65001)),
}
