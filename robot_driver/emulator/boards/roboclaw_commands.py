"""The commands that an emulated RoboClaw knows, by number: layouts of request and answer, and what each does.

Source: RoboClaw user manual, "Packet Serial", for firmware 4.2; layouts as for `struct`, high bytes first. A command in
no table is not answered, as by a real device with another firmware.
"""

import struct
from collections.abc import Callable
from typing import NamedTuple

from robot_driver.emulator.boards import roboclaw
from robot_driver.emulator.boards.roboclaw import FULL_DUTY, TIMEOUT_UNIT, RefusedError, RoboclawBoard

BUFFER_EMPTY = 0x80
BACKWARD, COUNTS_BACKWARD = 1, 2  # status byte of the speed commands, and of the encoder commands
VERSION = b"USB Roboclaw 2x15a v4.2.8\n\x00"
LARGEST_BYTE = 127  # of the commands with one byte for a duty
MIDDLE = 64


class Write(NamedTuple):
    """A command that is acknowledged with 0xFF: layout of its data, and the action."""

    what: str
    layout: str
    do: Callable[..., object]


class Read(NamedTuple):
    """A command that is answered: layout of the answer, None if its length varies, and the function that composes
    it.
    """

    what: str
    layout: str | None
    say: Callable[[RoboclawBoard], bytes]


def _keep(what: str, layout: str, *names: str) -> Write:
    """Return a command that sets registers."""
    return Write(what, layout, lambda board, *values: board.registers.update(zip(names, values, strict=True)))


def _tell(what: str, layout: str, *names: str) -> Read:
    """Return a command that reads registers."""
    return Read(what, layout, lambda board: struct.pack(layout, *(board.registers[name] for name in names)))


def _numbers(what: str, layout: str, numbers: Callable[[RoboclawBoard], tuple[int, ...] | list[int]]) -> Read:
    """Return a command that reads numbers."""
    return Read(what, layout, lambda board: struct.pack(layout, *numbers(board)))


def _part(byte: int) -> int:
    """Return the duty for 0 to 127, where 127 is full duty."""
    if byte > LARGEST_BYTE:
        raise RefusedError
    return round(FULL_DUTY * byte / LARGEST_BYTE)


def _either_way(byte: int) -> int:
    """Return the duty for 0 to 127: full backwards, none at 64, full forwards."""
    if byte > LARGEST_BYTE:
        raise RefusedError
    return round(FULL_DUTY * (byte - MIDDLE) / (MIDDLE if byte < MIDDLE else LARGEST_BYTE - MIDDLE))


def _share(duty: int) -> float:
    return duty / FULL_DUTY


def _tenths(value: float) -> int:
    """Return a quantity in tenths of its unit as the device sends it, not below 0."""
    return max(0, round(value * 10.0))


def _lowest_volts(byte: int) -> int:
    """Convert a byte to tenths of a volt: steps of 0.2 V from 6 V."""
    return 60 + 2 * byte


def _highest_volts(byte: int) -> int:
    """Convert a byte to tenths of a volt: steps of 1/5.12 V."""
    return round(10.0 * byte / 5.12)


def _set(name: str, value: Callable[[int], int]) -> Callable[[RoboclawBoard, int], None]:
    """Return a function that sets a register from one byte."""
    return lambda board, byte: board.registers.update({name: value(byte)})


def _encoder(board: RoboclawBoard, motor: int) -> bytes:
    return struct.pack(">IB", board.encoders()[motor], COUNTS_BACKWARD if board.speeds()[motor] < 0 else 0)


def _speed(board: RoboclawBoard, motor: int) -> bytes:
    speed = board.speeds()[motor]
    return struct.pack(">iB", speed, BACKWARD if speed < 0 else 0)


def _status(board: RoboclawBoard) -> bytes:
    return roboclaw.HEALTHY.to_bytes(board.settings.roboclaw.status_bytes, "big")


def _everything(board: RoboclawBoard) -> bytes:
    """Return the 56 bytes of command 73."""
    temperature, logic = _tenths(board.settings.electrics.temperature), _tenths(board.settings.electrics.logic_voltage)
    battery, milliseconds = _tenths(board.plant.battery_voltage()), round(board.plant.time * 1000.0) & 0xFFFFFFFF
    errors = [min(error, 0xFFFF) for error in board.speed_errors()]
    return (
        struct.pack(">IIHHHH", milliseconds, roboclaw.HEALTHY, temperature, temperature, battery, logic)
        + struct.pack(">hhhh", *board.duty, *board.currents())
        + struct.pack(">IIiiii", *board.encoders(), *board.set_speeds(), *board.speeds())
        + struct.pack(">HHHH", *errors, 0, 0)
    )


DRIVING = {
    0: Write("duty of motor 1, forwards, 0 to 127", ">B", lambda board, part: board.drive((_part(part), None))),
    1: Write("duty of motor 1, backwards", ">B", lambda board, part: board.drive((-_part(part), None))),
    4: Write("duty of motor 2, forwards", ">B", lambda board, part: board.drive((None, _part(part)))),
    5: Write("duty of motor 2, backwards", ">B", lambda board, part: board.drive((None, -_part(part)))),
    6: Write("duty of motor 1, 64 for none", ">B", lambda board, way: board.drive((_either_way(way), None))),
    7: Write("duty of motor 2, 64 for none", ">B", lambda board, way: board.drive((None, _either_way(way)))),
    8: Write("mixed: forwards", ">B", lambda board, part: board.mix(forward=_share(_part(part)))),
    9: Write("mixed: backwards", ">B", lambda board, part: board.mix(forward=-_share(_part(part)))),
    10: Write("mixed: to the right", ">B", lambda board, part: board.mix(right=_share(_part(part)))),
    11: Write("mixed: to the left", ">B", lambda board, part: board.mix(right=-_share(_part(part)))),
    12: Write("mixed: forwards, 64 for none", ">B", lambda board, way: board.mix(forward=_share(_either_way(way)))),
    13: Write("mixed: to the right, 64 for none", ">B", lambda board, way: board.mix(right=_share(_either_way(way)))),
    32: Write("duty of motor 1", ">h", lambda board, duty: board.drive((duty, None))),
    33: Write("duty of motor 2", ">h", lambda board, duty: board.drive((None, duty))),
    34: Write("duties", ">hh", lambda board, *duties: board.drive(duties)),
    52: Write("duty of motor 1, its change a second", ">hI", lambda board, to, by: board.drive((to, None), (by, 0))),
    53: Write("duty of motor 2, its change a second", ">hI", lambda board, to, by: board.drive((None, to), (0, by))),
    54: Write("duties, each with its change a second", ">hIhI", lambda board, *two: board.drive(two[::2], two[1::2])),
    35: Write("speed of motor 1", ">i", lambda board, speed: board.turn((speed, None))),
    36: Write("speed of motor 2", ">i", lambda board, speed: board.turn((None, speed))),
    37: Write("speeds", ">ii", lambda board, *speeds: board.turn(speeds)),
    38: Write("change a second, speed of motor 1", ">Ii", lambda board, by, to: board.turn((to, None), (by, 0))),
    39: Write("change a second, speed of motor 2", ">Ii", lambda board, by, to: board.turn((None, to), (0, by))),
    40: Write("change a second, speeds", ">Iii", lambda board, by, *speeds: board.turn(speeds, (by, by))),
    50: Write("speeds, each after its change a second", ">IiIi", lambda board, *two: board.turn(two[1::2], two[::2])),
}
SENSING: dict[int, Write | Read] = {
    14: Write("timeout, 0.1 s", ">B", lambda board, tenths: setattr(board, "timeout", tenths * TIMEOUT_UNIT)),
    15: _numbers("timeout, 0.1 s", ">B", lambda board: [round(board.timeout / TIMEOUT_UNIT)]),
    16: Read("count of encoder 1, status", ">IB", lambda board: _encoder(board, 0)),
    17: Read("count of encoder 2, status", ">IB", lambda board: _encoder(board, 1)),
    18: Read("speed of motor 1, direction", ">iB", lambda board: _speed(board, 0)),
    19: Read("speed of motor 2, direction", ">iB", lambda board: _speed(board, 1)),
    20: Write("counts to 0", ">", lambda board: [board.set_count(motor, 0) for motor in roboclaw.MOTORS]),
    21: Read("version, with a line end and a NUL", None, lambda _: VERSION),
    22: Write("count of encoder 1", ">I", lambda board, count: board.set_count(0, count)),
    23: Write("count of encoder 2", ">I", lambda board, count: board.set_count(1, count)),
    24: _numbers("battery, 0.1 V", ">H", lambda board: [_tenths(board.plant.battery_voltage())]),
    25: _numbers("logic battery, 0.1 V", ">H", lambda board: [_tenths(board.settings.electrics.logic_voltage)]),
    30: Read("speed of motor 1 now, direction", ">iB", lambda board: _speed(board, 0)),
    31: Read("speed of motor 2 now, direction", ">iB", lambda board: _speed(board, 1)),
    47: _numbers("buffers, empty", ">BB", lambda _: [BUFFER_EMPTY, BUFFER_EMPTY]),
    48: _numbers("duties", ">hh", lambda board: board.duty),
    49: _numbers("currents, 10 mA", ">hh", lambda board: board.currents()),
    73: Read("all at once", ">IIHHHHhhhhIIiiiiHHHH", _everything),
    78: _numbers("counts", ">II", lambda board: board.encoders()),
    79: _numbers("speeds now", ">ii", lambda board: board.speeds()),
    82: _numbers("temperature, 0.1 °C", ">H", lambda board: [_tenths(board.settings.electrics.temperature)]),
    83: _numbers("temperature 2, 0.1 °C", ">H", lambda board: [_tenths(board.settings.electrics.temperature)]),
    90: Read("status, by firmware 1, 2 or 4 bytes", None, _status),
    108: _numbers("speeds in the last full second", ">ii", lambda board: board.average_speeds),
    111: _numbers("errors of the speeds", ">II", lambda board: board.speed_errors()),
    114: _numbers("errors of the positions, 0", ">II", lambda _: [0, 0]),
}
SETTINGS: dict[int, Write | Read] = {
    2: Write("lowest battery voltage, 0.2 V above 6 V", ">B", _set("main_min", _lowest_volts)),
    3: Write("highest battery voltage, 1/5.12 V", ">B", _set("main_max", _highest_volts)),
    26: Write("lowest logic voltage, 0.2 V above 6 V", ">B", _set("logic_min", _lowest_volts)),
    27: Write("highest logic voltage, 1/5.12 V", ">B", _set("logic_max", _highest_volts)),
    28: _keep(
        *("velocity D, P, I of motor 1, speed at full duty", ">IIII"),
        *("velocity_d_1", "velocity_p_1", "velocity_i_1", "velocity_qpps_1"),
    ),
    29: _keep(
        *("velocity D, P, I of motor 2, speed at full duty", ">IIII"),
        *("velocity_d_2", "velocity_p_2", "velocity_i_2", "velocity_qpps_2"),
    ),
    55: _tell(
        *("velocity P, I, D of motor 1, speed at full duty", ">IIII"),
        *("velocity_p_1", "velocity_i_1", "velocity_d_1", "velocity_qpps_1"),
    ),
    56: _tell(
        *("velocity P, I, D of motor 2, speed at full duty", ">IIII"),
        *("velocity_p_2", "velocity_i_2", "velocity_d_2", "velocity_qpps_2"),
    ),
    57: _keep("battery limits, 0.1 V", ">HH", "main_min", "main_max"),
    58: _keep("logic battery limits, 0.1 V", ">HH", "logic_min", "logic_max"),
    59: _tell("battery limits, 0.1 V", ">HH", "main_min", "main_max"),
    60: _tell("logic battery limits, 0.1 V", ">HH", "logic_min", "logic_max"),
    61: _keep(
        *("position D, P, I of motor 1 and limits", ">IIIIIii", "position_d_1", "position_p_1", "position_i_1"),
        *("position_max_i_1", "position_deadzone_1", "position_min_1", "position_max_1"),
    ),
    62: _keep(
        *("position D, P, I of motor 2 and limits", ">IIIIIii", "position_d_2", "position_p_2", "position_i_2"),
        *("position_max_i_2", "position_deadzone_2", "position_min_2", "position_max_2"),
    ),
    63: _tell(
        *("position P, I, D of motor 1 and limits", ">IIIIIii", "position_p_1", "position_i_1", "position_d_1"),
        *("position_max_i_1", "position_deadzone_1", "position_min_1", "position_max_1"),
    ),
    64: _tell(
        *("position P, I, D of motor 2 and limits", ">IIIIIii", "position_p_2", "position_i_2", "position_d_2"),
        *("position_max_i_2", "position_deadzone_2", "position_min_2", "position_max_2"),
    ),
    68: _keep("change a second of duties of motor 1", ">I", "duty_acceleration_1"),
    69: _keep("change a second of duties of motor 2", ">I", "duty_acceleration_2"),
    70: _keep("default speed of motor 1", ">H", "default_speed_1"),
    71: _keep("default speed of motor 2", ">H", "default_speed_2"),
    72: _tell("default speeds", ">HH", "default_speed_1", "default_speed_2"),
    74: _keep("use of pins S3, S4, S5", ">BBB", "pin_s3", "pin_s4", "pin_s5"),
    75: _tell("use of pins S3, S4, S5", ">BBB", "pin_s3", "pin_s4", "pin_s5"),
    76: _keep("dead band", ">BB", "deadband_reverse", "deadband_forward"),
    77: _tell("dead band", ">BB", "deadband_reverse", "deadband_forward"),
    80: Write("factory settings", ">", lambda board: board.restore_factory_settings()),
    81: _tell("change a second of duties", ">II", "duty_acceleration_1", "duty_acceleration_2"),
    91: _tell("modes of encoders", ">BB", "encoder_mode_1", "encoder_mode_2"),
    92: _keep("mode of encoder 1", ">B", "encoder_mode_1"),
    93: _keep("mode of encoder 2", ">B", "encoder_mode_2"),
    94: Write("settings to the memory, with a key", ">I", lambda board, key: board.save(key)),
    95: Write("settings from the memory", ">", lambda board: setattr(board, "registers", dict(board.memory))),
    98: _keep("configuration", ">H", "configuration"),
    99: _tell("configuration", ">H", "configuration"),
    100: _keep("modes of control pins", ">BB", "control_mode_1", "control_mode_2"),
    101: _tell("modes of control pins", ">BB", "control_mode_1", "control_mode_2"),
    102: _keep("control pin 1", ">H", "control_1"),
    103: _keep("control pin 2", ">H", "control_2"),
    104: _tell("control pins", ">HH", "control_1", "control_2"),
    105: _keep("homing of motor 1: speed, timeout", ">HI", "homing_speed_1", "homing_timeout_1"),
    106: _keep("homing of motor 2: speed, timeout", ">HI", "homing_speed_2", "homing_timeout_2"),
    107: _tell(
        *("homing: speed, timeout", ">HIHI"),
        *("homing_speed_1", "homing_timeout_1", "homing_speed_2", "homing_timeout_2"),
    ),
    109: _keep("limits of errors of speeds", ">II", "speed_error_1", "speed_error_2"),
    110: _tell("limits of errors of speeds", ">II", "speed_error_1", "speed_error_2"),
    112: _keep("limits of errors of positions", ">II", "position_error_1", "position_error_2"),
    113: _tell("limits of errors of positions", ">II", "position_error_1", "position_error_2"),
    115: _keep("offsets of battery voltages, 0.1 V", ">BB", "main_offset", "logic_offset"),
    116: _tell("offsets of battery voltages, 0.1 V", ">BB", "main_offset", "logic_offset"),
    117: _keep("blanking of currents", ">HH", "blanking_1", "blanking_2"),
    118: _tell("blanking of currents", ">HH", "blanking_1", "blanking_2"),
    133: _keep("largest current of motor 1, 10 mA; 0", ">II", "current_max_1", "current_min_1"),
    134: _keep("largest current of motor 2, 10 mA; 0", ">II", "current_max_2", "current_min_2"),
    135: _tell("largest current of motor 1, 10 mA; 0", ">II", "current_max_1", "current_min_1"),
    136: _tell("largest current of motor 2, 10 mA; 0", ">II", "current_max_2", "current_min_2"),
    148: _keep("PWM mode", ">B", "pwm_mode"),
    149: _tell("PWM mode", ">B", "pwm_mode"),
}
COMMANDS: dict[int, Write | Read] = {**DRIVING, **SENSING, **SETTINGS}
