"""Emulated controllers: whatever clients send, they neither die nor answer what is no answer, and then go on.

Scripts hold noise and what real clients write, whole or damaged, in pieces with pauses between them.
"""

import math
import re
import struct
from collections.abc import Callable
from functools import cache
from typing import TypeAlias

from robot_driver.emulator.boards.mbot_topics import SAID, TAKEN, TIMESYNC
from robot_driver.emulator.boards.roboclaw_commands import COMMANDS, VERSION, Read, Write
from robot_driver.emulator.boards.roboteq_commands import ACTIONS, IDENTITY, QUERIES, SETTINGS
from robot_driver.emulator.device import Device
from robot_driver.emulator.mbot_device import START, MBotDevice, frame
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import ACKNOWLEDGED, RoboclawDevice, checksum
from robot_driver.emulator.roboclaw_pair_device import RoboclawPairDevice
from robot_driver.emulator.roboteq_device import LONGEST_LINE, RoboteqDevice
from robot_driver.emulator.settings import Settings, load_settings
from tests.robot_driver.any_bytes.script import Script
from tests.robot_driver.emulated_device import answer, said_until

Whole: TypeAlias = Callable[[Script], bytes]

PAUSES = (0.0, 0.0, 0.001, 0.02, 0.1)  # s
LONGEST_PACKET = 64  # bytes
READS = {number: entry for number, entry in COMMANDS.items() if isinstance(entry, Read)}
WRITES = {number: entry for number, entry in COMMANDS.items() if isinstance(entry, Write)}
LINE = re.compile(rb"(?:\+|-|([A-Z]+)=(?:-?[0-9]+(?::-?[0-9]+)*|" + re.escape(IDENTITY).encode() + rb"))\r")
# As clients write them: a name and a number or two go into each.
LINES = (b"!%b %d %d\r", b"!%b %d %d +\r", b"?%b [%d]+\r", b"?%b %d %d\r", b"^%b %d %d\r", b"~%b %d\r_", b"%b%d_")
# Numbers of the kinds that `struct` knows, of those that are in frames of an MBot.
EXTREMES: dict[str, tuple[float, ...]] = {
    "f": (0.0, 0.5, -0.5, 1.0, -20.0, 1e-40, 3.4e38, -3.4e38, math.inf, -math.inf, math.nan),
    **{kind: (0, 7, 2**bits - 1, -(2**bits)) for kind, bits in {"h": 15, "i": 31, "q": 63}.items()},
}
NAMES = [name.encode() for name in (*ACTIONS, *QUERIES, *SETTINGS) if name != "ECHOF"]


def check_roboclaw(data: bytes) -> None:
    """Check that one or two units answer nothing but 0xFF and what has a right checksum."""
    script, settings = Script(data), _settings()
    plant = Plant(settings)
    device: RoboclawDevice | RoboclawPairDevice = script.one_of((RoboclawDevice, RoboclawPairDevice))(settings, plant)
    units = [device] if isinstance(device, RoboclawDevice) else device.units

    def is_sound(said: bytes) -> bool:
        assert all(len(unit._packet) <= LONGEST_PACKET for unit in units)
        assert all(abs(duty) <= 32767 for unit in units for duty in unit.duty)
        return said == ACKNOWLEDGED or any(_is_answer(said, address) for address in (0x80, 0x81))

    _play(script, device, plant, _packet, is_sound)
    plant.advance(plant.time + 0.02)
    assert answer(device, b"\x80\x2f", plant.time)[:2] == b"\x80\x80"


def _is_answer(said: bytes, address: int) -> bool:
    body, crc = said[:-2], int.from_bytes(said[-2:], "big")
    fit = [
        number
        for number, entry in READS.items()
        if (entry.layout is None and len(body) in (4, len(VERSION)))
        or (entry.layout is not None and struct.calcsize(entry.layout) == len(body))
    ]
    return any(checksum(bytes((address, number)) + body) == crc for number in fit)


def _packet(script: Script) -> bytes:
    number, address = script.one_of(list(COMMANDS)), script.one_of((0x80, 0x80, 0x81, 0x87))
    packet = bytes((address, number))
    if number in READS:
        return packet
    size = struct.calcsize(WRITES[number].layout)
    packet += script.take(size).ljust(size, b"\0")
    return packet + checksum(packet).to_bytes(2, "big")


def check_roboteq(data: bytes) -> None:
    """Check that every answer is a line as the manual has it, to a query that there is."""
    script, settings = Script(data), _settings()
    plant = Plant(settings)
    device = RoboteqDevice(settings, plant)
    assert answer(device, b"^ECHOF 1\r", 0.0).endswith(b"+\r")

    def is_sound(said: bytes) -> bool:
        assert len(device._line) <= LONGEST_LINE
        assert all(abs(duty) <= 1000 for duty in device.duty)
        found = LINE.fullmatch(said)
        known = {*QUERIES, *SETTINGS, "FID"}
        echoes = not device.configuration["ECHOF"][0]
        return echoes or (found is not None and (found[1] is None or found[1].decode() in known))

    _play(script, device, plant, _line, is_sound)
    assert re.search(rb"(^|\r)FF=(0|16)\r$", answer(device, b"\r?FF\r", plant.time))


def _line(script: Script) -> bytes:
    form, name = script.one_of(LINES), script.one_of(NAMES)
    count = form.count(b"%d")
    small = script.number(2)
    numbers = [script.number(4) if small else script.numbers(script.one_of(("<h", "<i")))[0] for _ in range(count)]
    return form % (name, *numbers)


def check_mbot(data: bytes) -> None:
    """Check that all that it says are whole frames, and that it hears the time after whatever came before."""
    script, settings = Script(data), _settings()
    plant = Plant(settings)
    device = MBotDevice(settings, plant)

    def is_sound(said: bytes) -> bool:
        assert len(device._waiting) <= LONGEST_PACKET
        return _are_frames(said)

    _play(script, device, plant, _frame, is_sound)
    device.receive(6 * frame(TIMESYNC, bytes(8)), plant.time)
    (said,) = said_until(device, plant, device.wake_time)[-1:]
    assert _are_frames(said)


def _are_frames(said: bytes) -> bool:
    while said:
        topic = int.from_bytes(said[5:7], "little")
        if topic not in SAID:
            return False
        size = struct.calcsize(SAID[topic].layout)
        if said[: 8 + size] != frame(topic, said[7 : 7 + size]):
            return False
        said = said[8 + size :]
    return True


def _frame(script: Script) -> bytes:
    topic = script.one_of([TIMESYNC, *TAKEN, *TAKEN, *SAID])
    layout = (TAKEN | SAID)[topic].layout
    if script.number(4) == 0:
        return frame(topic, script.take(struct.calcsize(layout)).ljust(struct.calcsize(layout), b"\0"))
    numbers = [script.one_of(EXTREMES[kind]) for kind in _kinds(layout)]
    return frame(topic, struct.pack(layout, *numbers))


def _kinds(layout: str) -> str:
    """Return the kinds of numbers of a layout, as many as there are."""
    return "".join(kind * int(count or 1) for count, kind in re.findall("([0-9]*)([a-z])", layout))


def _play(script: Script, device: Device, plant: Plant, whole: Whole, is_sound: Callable[[bytes], bool]) -> None:
    """Send a script to a device; check each thing that it says, and that the robot stays one."""
    time = plant.time
    while not script.is_over:
        noise = script.number(4) == 0
        sent = script.take(script.number(64)) if noise else script.damaged(whole(script) + START[: script.number(2)])
        time += script.one_of(PAUSES)
        said = said_until(device, plant, time)
        said += [one.data for one in device.receive(sent, time)] if sent else []
        assert all(is_sound(one) for one in said)
        assert device.wake_time > time or not math.isfinite(device.wake_time)
    said_until(device, plant, time + 0.1)
    state = (plant.x, plant.y, plant.theta, plant.left.velocity, plant.right.velocity)
    assert all(map(math.isfinite, state))
    assert max(map(abs, state)) < 1000.0


@cache
def _settings() -> Settings:
    return load_settings()
