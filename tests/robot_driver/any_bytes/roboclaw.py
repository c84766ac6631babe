"""RoboClaw packet serial: only 0xFF acknowledges, and every other reply has a right CRC."""

from collections.abc import Callable
from typing import Any

from robot_driver.controllers import Controller, Request
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.controllers.roboclaw_pair import RoboClawPair
from robot_driver.emulator.roboclaw_device import ACKNOWLEDGED, checksum
from tests.robot_driver.any_bytes.script import FILLER, Script, taken_as_reply, understood

READ_VERSION, READ_STATUS = 21, 90
REQUESTS: tuple[Callable[[Controller], list[Request[Any]]], ...] = (
    lambda unit: [unit.identify()],
    lambda unit: list(unit.learn()),
    lambda unit: [unit.set_watchdog(0.5), unit.read_watchdog()],
    lambda unit: [unit.drive(0.5, -0.25), *unit.stops()],
    lambda unit: [unit.read_encoders()],
    lambda unit: list(unit.read_telemetry()),
)


def check(data: bytes) -> None:
    """Check what the replies of one unit or two promise."""
    script = Script(data)
    unit: Controller = script.one_of((RoboClaw, RoboClawPair))()
    while not script.is_over:
        requests = script.one_of(REQUESTS)(unit)
        _exchange(script, script.one_of(requests))


def _exchange(script: Script, request: Request[Any]) -> None:
    """Answer a request, and what follows from the answer, by the script; what is not understood, once more rightly."""
    sizes = script.sizes()
    noise = script.number(4) == 0
    stream = script.take(script.number(64)) if noise else script.damaged(_reply(request, script))
    reply = taken_as_reply(request, stream if script.number(2) else stream + FILLER, sizes)
    assert len(reply) <= request.longest_reply
    said = understood(request, reply)
    if said is not None:
        assert _is_sound(request, reply)
    else:
        whole = _reply(request, Script(b""))
        assert taken_as_reply(request, whole + FILLER[:2] * (not request.ends_in_silence), sizes) == whole
        said = understood(request, whole)
    assert said is not None
    if request.then is not None:
        _exchange(script, request.then(said[0]))


def _is_sound(request: Request[Any], reply: bytes) -> bool:
    if len(request.data) > 2:
        return reply == ACKNOWLEDGED
    if request.data[1] == READ_VERSION and reply[-3:-2] != b"\0":
        return False
    return len(reply) > 2 and checksum(request.data + reply[:-2]) == int.from_bytes(reply[-2:], "big")


def _reply(request: Request[Any], script: Script) -> bytes:
    """Return a reply as a device sends it, with the next bytes of the script in it."""
    if len(request.data) > 2:
        return ACKNOWLEDGED
    length = request.longest_reply - 2
    if request.data[1] == READ_VERSION:
        text = script.take(script.number(length)).replace(b"\0", b"")
        data = text.ljust(length, b"x") if script.number(4) == 3 else text + b"\0"  # the former is none
    else:
        length = script.one_of((length, 1, 2)) if request.ends_in_silence else length
        data = script.take(length).ljust(length, b"\0")
    return data + checksum(request.data + data).to_bytes(2, "big")
