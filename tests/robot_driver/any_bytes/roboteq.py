"""Roboteq lines: there is no checksum, so only what the device writes, to the last character, may answer a question."""

from collections.abc import Callable
from typing import Any

from robot_driver.controllers import Request
from robot_driver.controllers.roboteq import Roboteq
from tests.robot_driver.any_bytes.script import FILLER, Script, taken_as_reply, understood

DONE, REFUSED = b"+\r", b"-\r"
REQUESTS: tuple[Callable[[Roboteq], list[Request[Any]]], ...] = (
    lambda unit: [unit.identify()],
    lambda unit: unit.learn(),
    lambda unit: [unit.set_watchdog(0.5), unit.read_watchdog()],
    lambda unit: _duty_and_what_is_told_of_it(unit.drive(0.5, -0.25)),
    lambda unit: [unit.read_encoders()],
    lambda unit: unit.read_telemetry(),
)
# What may be told of this duty, and what it is then: one that holds its motors by itself may tell zero.
TOLD = {b"M=500:-250\r": (0.5, -0.25), b"M=0:0\r": (0.0, 0.0)}
COUNTS = {b"C": (2, 2), b"V": (3, 3), b"A": (2, 2), b"T": (1, 5), b"FM": (1, 2)}
COUNTS |= {b"M": (2, 2), b"MMOD": (1, 2), b"MXMD": (1, 2), b"CLIN": (1, 2)}

FORMS = (b"%d", b"%d", b"%d", b"%d", b"%d", b"%04d", b"%+d", b"% d")  # the last three are none


def check(data: bytes) -> None:
    """Check what the answers of a device promise, also of one that repeats what it receives."""
    script = Script(data)
    unit, echo_is_off = Roboteq(), False
    while not script.is_over:
        request = script.one_of(script.one_of(REQUESTS)(unit))
        reply = _reply(script, request)
        said = understood(request, reply)
        assert said is None or _is_sound(request.data, reply, said[0])
        whole = _answer(request.data, Script(b""))
        assert taken_as_reply(request, whole + FILLER, script.sizes()) == whole
        if echo_is_off and reply.startswith(request.data[:-1]):
            _check_restarted(unit)
            unit, echo_is_off = Roboteq(), False
        else:
            assert understood(request, whole) is not None
            echo_is_off |= request.data == b"^ECHOF 1\r"


def _duty_and_what_is_told_of_it(drive: Request[Any]) -> list[Request[Any]]:
    assert drive.then is not None
    return [drive, drive.then(None)]


def _reply(script: Script, request: Request[Any]) -> bytes:
    """Return what is taken as the reply, of all that comes by the script."""
    sizes, line = script.sizes(), request.data
    echo = script.one_of((b"", b"", b"", line, line[:-1]))
    noise = script.number(4) == 0
    stream = echo + (script.take(script.number(64)) if noise else script.damaged(_answer(line, script)))
    reply = taken_as_reply(request, stream if script.number(2) else stream + FILLER, sizes)
    assert len(reply) <= request.longest_reply
    return reply


def _check_restarted(unit: Roboteq) -> None:
    """Check that nothing is believed and nothing moves any more."""
    drive = unit.drive(0.5, 0.5)
    assert drive.data == b"!M 0 0\r"
    assert understood(drive, DONE) is None


def _is_sound(line: bytes, reply: bytes, said: Any) -> bool:
    echoed = reply.startswith(line[:-1])
    answer = reply[len(line) - 1 :].removeprefix(b"\r") if echoed else reply
    if line[:1] in b"!^":
        return answer == DONE
    if line == b"?M\r":
        return answer in TOLD and said == TOLD[answer]
    if line[:2] in (b"~M", b"~C") and answer == REFUSED:
        return True
    name = line[1:-1].split()[0]
    text = answer[len(name) + 1 : -1]
    if answer != name + b"=" + text + b"\r":
        return False
    if name == b"FID":
        return text != b"" and all(0x20 <= byte < 0x7F for byte in text)
    least, most = COUNTS.get(name, (1, 1))
    values = text.split(b":")
    return least <= len(values) <= most and all(b"%d" % int(value) == value for value in values)


def _answer(line: bytes, script: Script) -> bytes:
    """Return an answer as a device writes it, with numbers from the script in it."""
    if line[:1] in b"!^":
        return script.one_of((DONE, REFUSED))
    name = line[1:-1].split()[0]
    if name == b"M" and script.number(4) == 0:
        return script.one_of(tuple(TOLD))
    if name == b"FID":
        return b"FID=v" + script.take(script.number(80)).replace(b"\r", b"") + b"\r"
    least, most = COUNTS.get(name, (1, 1))
    count = least + script.number(most - least + 1)
    values = [script.one_of(FORMS) % script.numbers(script.one_of(("<B", "<h", "<i"))) for _ in range(count)]
    return name + b"=" + b":".join(values) + b"\r"
