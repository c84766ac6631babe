"""Every command of the emulated RoboClaw, by frames as the manual lays them out."""

import dataclasses
import math
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

from robot_driver.emulator.boards.motor_channel import LOOP_PERIOD
from robot_driver.emulator.boards.roboclaw import KEY
from robot_driver.emulator.boards.roboclaw_commands import COMMANDS, Read, Write
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice, checksum
from robot_driver.emulator.roboclaw_pair_device import RoboclawPairDevice
from robot_driver.emulator.settings import Settings, load_settings
from tests.robot_driver.emulated_device import answer, let_pass
from tests.robot_driver.golden_vectors import ROBOCLAW_PID, ROBOCLAW_SPEEDS

pytestmark = pytest.mark.waits

QPPS = round(2048 / (2.0 * math.pi * 0.054))  # of the emulated robot
REFUSED_ABOVE_127 = (0, 1, *range(4, 14))


@cache
def emulated(**roboclaw: Any) -> Settings:
    settings = load_settings().ideal()
    return dataclasses.replace(settings, roboclaw=dataclasses.replace(settings.roboclaw, **roboclaw))


class Line:
    """A RoboClaw, and what is asked of it, one thing after another."""

    def __init__(self, settings: Settings | None = None) -> None:
        settings = settings or emulated()
        self.plant = Plant(settings)
        self.device = RoboclawDevice(settings, self.plant)
        self.time = 1.0
        let_pass(self.device, self.plant, self.time)

    def wait(self, seconds: float) -> None:
        self.time += seconds
        let_pass(self.device, self.plant, self.time)

    def send(self, packet: bytes) -> bytes:
        self.wait(0.02)
        return answer(self.device, packet, self.time)

    def write(self, command: int, layout: str = ">", *values: int) -> bytes:
        return self.send(packed(command, layout, *values))

    def read(self, command: int, layout: str) -> tuple[int, ...]:
        request = bytes((0x80, command))
        reply = self.send(request)
        assert int.from_bytes(reply[-2:], "big") == checksum(request + reply[:-2])
        return struct.unpack(layout, reply[:-2])

    @property
    def duty(self) -> tuple[int, ...]:
        return self.read(48, ">hh")

    def speeds(self) -> tuple[int, ...]:
        return self.read(79, ">ii")


def packed(command: int, layout: str = ">", *values: int) -> bytes:
    packet = bytes((0x80, command)) + struct.pack(layout, *values)
    return packet + checksum(packet).to_bytes(2, "big")


def about(*speeds: float) -> Any:
    return pytest.approx(speeds, abs=0.01 * QPPS)


@pytest.mark.parametrize(
    ("command", "byte", "duty"),
    [
        *((0, 0, (0, 0)), (0, 64, (16513, 0)), (0, 127, (32767, 0)), (1, 127, (-32767, 0)), (1, 64, (-16513, 0))),
        *((4, 127, (0, 32767)), (5, 127, (0, -32767)), (5, 1, (0, -258))),
        *((6, 0, (-32767, 0)), (6, 64, (0, 0)), (6, 127, (32767, 0)), (6, 32, (-16384, 0))),
        *((7, 0, (0, -32767)), (7, 64, (0, 0)), (7, 127, (0, 32767))),
    ],
)
def test_the_commands_of_one_byte(command: int, byte: int, duty: tuple[int, int]) -> None:
    line = Line()
    assert line.write(command, ">B", byte) == b"\xff"
    assert line.duty == duty


@pytest.mark.parametrize(
    ("forward", "turn", "duty"),
    [
        *(((8, 127), (10, 0), (32767, 32767)), ((9, 127), (11, 0), (-32767, -32767))),
        *(((8, 0), (10, 127), (32767, -32767)), ((8, 0), (11, 127), (-32767, 32767))),
        *(((8, 64), (10, 32), (24768, 8256)), ((8, 127), (10, 127), (32767, 0))),
        *(((12, 127), (13, 64), (32767, 32767)), ((12, 0), (13, 64), (-32767, -32767))),
        *(((12, 64), (13, 127), (32767, -32767)), ((12, 64), (13, 0), (-32767, 32767))),
    ],
)
def test_mixed_commands_move_nothing_before_both_have_come(
    forward: tuple[int, int], turn: tuple[int, int], duty: tuple[int, int]
) -> None:
    line = Line()
    assert line.write(forward[0], ">B", forward[1]) == b"\xff"
    assert line.duty == (0, 0)
    assert line.write(turn[0], ">B", turn[1]) == b"\xff"
    assert line.duty == pytest.approx(duty, abs=1)


@pytest.mark.parametrize("command", REFUSED_ABOVE_127)
def test_a_byte_beyond_the_manuals_range_is_met_with_silence_and_counted(command: int) -> None:
    line = Line()
    assert line.write(command, ">B", 128) == b""
    assert line.device.not_understood == {f"command {command}: value": 1}
    assert line.duty == (0, 0)


@pytest.mark.parametrize(
    ("command", "layout", "values"), [(34, ">hh", (-32768, -32768)), (54, ">hIhI", (-32768, 0, -32768, 0))]
)
def test_a_duty_of_one_more_than_all_backwards_is_all(command: int, layout: str, values: tuple[int, ...]) -> None:
    line = Line()
    assert line.write(command, layout, *values) == b"\xff"
    assert line.duty == (-32767, -32767)


@pytest.mark.parametrize(
    ("command", "layout", "values", "duty", "end"),
    [
        (52, ">hI", (20000, 10000), (5000, 0), (20000, 0)),
        (53, ">hI", (-20000, 10000), (0, -5000), (0, -20000)),
        (54, ">hIhI", (20000, 10000, -30000, 20000), (5000, -10000), (20000, -30000)),
    ],
)
def test_a_duty_with_an_acceleration_changes_by_so_much_a_second(
    command: int, layout: str, values: tuple[int, ...], duty: tuple[int, int], end: tuple[int, int]
) -> None:
    line = Line()
    assert line.write(command, layout, *values) == b"\xff"
    line.wait(0.48)
    assert line.duty == pytest.approx(duty, abs=30000 * LOOP_PERIOD)
    line.wait(3.0)
    assert line.duty == end


def test_the_fastest_acceleration_of_the_manual_goes_from_end_to_end_in_a_tenth_of_a_second() -> None:
    line = Line()
    line.write(32, ">h", -32767)
    line.write(52, ">hI", 32767, 655359)
    line.wait(0.06)
    assert -32767 < line.duty[0] < 32767  # 0.08 s
    line.wait(0.02)
    assert line.duty[0] == 32767


def test_the_default_acceleration_is_that_of_duties_without_one() -> None:
    line = Line()
    assert line.write(68, ">I", 10000) == line.write(69, ">I", 20000) == b"\xff"
    assert line.read(81, ">II") == (10000, 20000)
    line.write(34, ">hh", 30000, 30000)
    line.wait(0.48)
    assert line.duty == pytest.approx((5000, 10000), abs=200)


def test_speeds_that_another_client_sends_are_kept() -> None:
    line = Line()
    assert line.send(ROBOCLAW_SPEEDS) == b"\xff"
    line.wait(2.0)
    assert line.speeds() == about(1000, -2000)
    assert line.read(108, ">ii") == about(1000, -2000)
    before = line.read(78, ">II")
    line.wait(0.98)
    counted = [(new - old + 2**31) % 2**32 - 2**31 for new, old in zip(line.read(78, ">II"), before, strict=True)]
    assert counted == about(1000, -2000)


def test_a_speed_of_one_motor_leaves_the_other_alone() -> None:
    line = Line()
    line.write(33, ">h", 8000)
    assert line.write(35, ">i", -1500) == b"\xff"
    line.wait(2.0)
    assert line.speeds() == about(-1500, 8000 / 32767 * QPPS)
    assert line.duty[1] == 8000
    assert line.write(36, ">i", 500) == b"\xff"
    line.wait(2.0)
    assert line.speeds() == about(-1500, 500)
    assert line.write(34, ">hh", 0, 0) == b"\xff"
    assert line.duty == (0, 0)


@pytest.mark.parametrize(
    ("command", "layout", "values", "speeds"),
    [
        (38, ">Ii", (2000, 2000), (2000, 0)),
        (39, ">Ii", (2000, -2000), (0, -2000)),
        (40, ">Iii", (2000, 2000, -2000), (2000, -2000)),
        (50, ">IiIi", (2000, 2000, 1000, 1000), (2000, 1000)),
    ],
)
def test_a_speed_as_large_as_its_acceleration_is_reached_in_a_second(
    command: int, layout: str, values: tuple[int, ...], speeds: tuple[int, int]
) -> None:
    """As in the manual's example of 12,000 with 12,000, which is more than this robot can do."""
    line = Line()
    assert line.write(command, layout, *values) == b"\xff"
    line.wait(0.5)
    assert line.read(73, ">II8hIIiiiiHHHH")[12:14] == about(*(speed / 2 for speed in speeds))
    line.wait(0.5)
    assert line.read(73, ">II8hIIiiiiHHHH")[12:14] == about(*speeds)
    line.wait(1.0)
    assert line.speeds() == about(*speeds)
    assert line.read(111, ">II") == about(0, 0)


def test_a_speed_beyond_what_the_motor_can_do_is_all_it_can() -> None:
    line = Line()
    line.write(37, ">ii", 2**31 - 1, -(2**31))
    line.wait(2.0)
    assert line.duty == (32767, -32767)
    assert line.speeds() == about(QPPS, -QPPS)


def test_the_timeout_stops_a_speed_too_and_bytes_alone_do_not_bring_it_back() -> None:
    line = Line()
    line.write(14, ">B", 5)
    line.write(37, ">ii", 2000, 2000)
    line.wait(0.4)
    assert line.duty[0] > 0
    line.wait(2.0)
    assert line.duty == (0, 0)
    line.wait(2.0)
    assert line.speeds() == (0, 0)


def test_the_velocity_constants_are_those_that_were_sent_and_the_loop_has_them() -> None:
    line = Line()
    assert line.read(56, ">IIII") == (2 * 65536, 10 * 65536, 0, QPPS)
    assert line.send(ROBOCLAW_PID) == b"\xff"
    assert line.read(55, ">IIII") == (8631, 878, 0, 201562)  # P, I, D are answered in this order
    line.write(37, ">ii", 2000, 2000)
    line.wait(2.0)
    weak, tuned = line.speeds()
    assert weak < 200  # the motor is thought to be 33 times as fast
    assert tuned == pytest.approx(2000, rel=0.01)
    assert line.write(29, ">IIII", 0x4000, 0x10000, 0x8000, 44000) == b"\xff"  # the manual's defaults
    assert line.read(56, ">IIII") == (0x10000, 0x8000, 0x4000, 44000)


def test_counts_are_set() -> None:
    line = Line()
    line.write(34, ">hh", 8000, -8000)
    line.wait(1.0)
    assert line.write(34, ">hh", 0, 0) == b"\xff"
    line.wait(3.0)
    assert line.write(22, ">I", 1234) == line.write(23, ">I", 2**32 - 5) == b"\xff"
    assert line.read(78, ">II") == (1234, 2**32 - 5)
    assert line.write(20) == b"\xff"
    assert line.read(78, ">II") == (0, 0)


@pytest.mark.parametrize(
    ("command", "byte", "read", "place", "tenths"),
    [
        # The manual's examples: 6 V = 0, 8 V = 10 and 11 V = 25; 12 V = 62, 16 V = 82 and 24 V = 123.
        *((2, 0, 59, 0, 60), (2, 10, 59, 0, 80), (2, 25, 59, 0, 110)),
        *((3, 62, 59, 1, 121), (3, 82, 59, 1, 160), (3, 123, 59, 1, 240)),
        *((26, 10, 60, 0, 80), (27, 82, 60, 1, 160)),
    ],
)
def test_limits_of_voltages_in_one_byte(command: int, byte: int, read: int, place: int, tenths: int) -> None:
    line = Line()
    assert line.write(command, ">B", byte) == b"\xff"
    assert line.read(read, ">HH")[place] == tenths


@pytest.mark.parametrize(
    ("writes", "read"),
    [
        *(((57,), 59), ((58,), 60), ((70, 71), 72), ((74,), 75), ((76,), 77), ((92, 93), 91), ((98,), 99)),
        *(((100,), 101), ((102, 103), 104), ((105, 106), 107), ((109,), 110), ((112,), 113), ((115,), 116)),
        *(((117,), 118), ((133,), 135), ((134,), 136), ((148,), 149)),
    ],
)
def test_a_setting_is_read_as_it_was_written(writes: tuple[int, ...], read: int) -> None:
    line, number, written = Line(), 1, b""
    for command in writes:
        layout = of(command).layout
        assert layout is not None
        values = range(number, number + len(layout) - 1)
        number += len(values)
        assert line.write(command, layout, *values) == b"\xff"
        written += struct.pack(layout, *values)
    layout = of(read).layout
    assert layout is not None
    assert struct.pack(layout, *line.read(read, layout)) == written


def test_position_constants_are_read_with_p_first() -> None:
    line = Line()
    for write, read in ((61, 63), (62, 64)):
        assert line.write(write, ">5Iii", 1, 2, 3, 4, 5, -600, 600) == b"\xff"
        assert line.read(read, ">5Iii") == (2, 3, 1, 4, 5, -600, 600)


def test_settings_are_kept_without_power_when_they_were_saved_with_the_key() -> None:
    line = Line()
    line.write(57, ">HH", 110, 140)
    assert line.write(94, ">I", KEY + 1) == b""
    line.device.board.switch_on()
    assert line.read(59, ">HH") == (60, 340)
    line.write(57, ">HH", 110, 140)
    assert line.write(94, ">I", KEY) == b"\xff"
    assert line.device.board.saves == 1
    line.write(57, ">HH", 120, 150)
    assert line.write(95) == b"\xff"
    assert line.read(59, ">HH") == (110, 140)
    line.device.board.switch_on()
    assert line.read(59, ">HH") == (110, 140)
    assert line.write(80) == b"\xff"
    assert line.read(59, ">HH") == (60, 340)


def of(command: int) -> Read | Write:
    return COMMANDS[command]


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("baud", [38400, 115200])
def test_every_command_is_answered_and_no_byte_is_waited_for_longer_than_10_ms(command: int, baud: int) -> None:
    line = Line(emulated(baud=baud))
    entry = of(command)
    request = bytes((0x80, command))
    if isinstance(entry, Write):
        data = struct.pack(">I", KEY) if command == 94 else bytes(struct.calcsize(entry.layout))
        request = request + data + checksum(request + data).to_bytes(2, "big")
    (reply,) = line.device.receive(request, 2.0)
    assert reply.time == pytest.approx(2.0 + len(reply.data) * 10 / baud)  # it begins at once
    if isinstance(entry, Write):
        assert reply.data == b"\xff"
    elif entry.layout is not None:
        assert len(reply.data) == struct.calcsize(entry.layout) + 2


def test_every_command_that_is_not_known_is_met_with_silence_and_counted() -> None:
    line, unknown = Line(), sorted(set(range(256)) - set(COMMANDS))
    for number in unknown:
        assert line.write(number) == b""
        assert line.read(47, ">BB") == (0x80, 0x80)
    assert line.device.not_understood == {f"command {number}": 1 for number in unknown}


def test_every_packet_of_another_unit_is_passed_over() -> None:
    line = Line()
    for command, entry in COMMANDS.items():
        packet = bytes((0x81, command))
        if isinstance(entry, Write):
            packet += bytes(struct.calcsize(entry.layout) + 2)
        assert line.send(packet + bytes((0x80, 47)))[:2] == b"\x80\x80"
    assert line.device.not_understood == {}


@pytest.mark.parametrize("gap", [0.0005, 0.0095])
@pytest.mark.parametrize("baud", [38400, 115200])
def test_bytes_up_to_10_ms_apart_are_one_packet(baud: int, gap: float) -> None:
    assert in_pieces(Line(emulated(baud=baud)), lambda _: gap) == b"\xff"


@pytest.mark.parametrize("place", range(1, 12))
def test_a_packet_with_one_byte_more_than_10_ms_late_is_dropped(place: int) -> None:
    line = Line(emulated(baud=38400))
    assert in_pieces(line, lambda number: 0.0105 if number == place else 0.001) == b""
    line.time += 1.0
    assert line.duty == (0, 0)


def in_pieces(line: Line, gap: Callable[[int], float]) -> bytes:
    """Send two speeds byte by byte, each so long (s) after the one before has come; return the answer."""
    replies, time = b"", 2.0
    for number, byte in enumerate(ROBOCLAW_SPEEDS):
        time += line.device.byte_time + gap(number)
        line.plant.advance(time)
        replies += answer(line.device, bytes((byte,)), time)
    line.time = time
    return replies


def test_two_units_keep_the_speeds_of_wheels_that_the_ground_couples() -> None:
    settings = emulated()
    plant = Plant(settings)
    device = RoboclawPairDevice(settings, plant)
    for address in (0x80, 0x81):
        packet = bytes((address, 37)) + struct.pack(">ii", 2000, -1000)
        assert answer(device, packet + checksum(packet).to_bytes(2, "big"), 0.0) == b"\xff"
    let_pass(device, plant, 2.0)
    assert plant.encoder_speeds() == about(2000, -1000)
    assert answer(device, b"\x81\xf0", 2.1) == answer(device, b"\x80\xf0", 2.2) == b""
    assert device.not_understood == {"command 240": 2}
