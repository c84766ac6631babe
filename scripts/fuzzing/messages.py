"""Messages for fuzzing: valid ones, and some with wrong fields, timestamps, lengths, strings or bytes."""

import copy
import hashlib
import json
import math
import socket
from collections.abc import Callable
from functools import cache
from typing import Any

from cmr.bus.fields import BYTES, Field, fields_of
from cmr.bus.message import FINGERPRINT_BYTES, Message
from cmr.bus.older import OLDER
from cmr.bus.streams import STREAMS, Stream
from fuzzing.draws import Draws
from tests.support.small_log import FIELDS

INT_BITS = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64, "byte": 8, "boolean": 8}
LARGEST_FLOAT = 3.4e38  # in 4 bytes; a larger one cannot be encoded
SECOND, HOUR = 1_000_000, 3_600_000_000  # us
STAMPS = (
    0,
    0,
    0,
    0,
    0,
    -1,
    1,
    -100_000,
    100_000,
    -SECOND,
    SECOND,
    -3 * SECOND,
    3 * SECOND,
    -HOUR,
    HOUR,
)  # us relative to now
ABSURD_STAMPS = (0, 1, -1, 2**63 - 1, -(2**63), 2**62, 10**18)
REALS = (
    *(math.nan, math.inf, -math.inf, 1e300, -1e300, 1.7e308, 5e-324, 1e-300, 0.0, -0.0, 1.0, -1.0, 1.0000001),
    *(1e-9, 0.5, 2.0, math.pi, -math.pi, 199.9, 200.1, 1e4, -1e5, 2e7, 1e9, 1e18, 2.0**63, -(2.0**64)),
)
WHOLES = (0, 1, -1, 2, 3, 7, 10, 127, -128, 255, 2**31 - 1, -(2**31), 2**32, 2**53, 2**62, 2**63 - 1, -(2**63))
TEXTS = (
    *(
        "",
        "0",
        "a",
        "\0",
        "\n" * 50,
        "\x1b[2J\x1b]0;title\x07",
        "\r\x08\x7f\x9b",
        "=1+1",
        "../../etc/passwd",
        "%s%n{0}",
    ),
    *(
        "\u202e\u2066\ufeff\U0001f916",
        "x" * 300,
        "y" * 70_000,
        "\x1b" * 5000,
        "null",
        "[" * 3000,
        '{"a":' * 300,
        "'\"<&>",
    ),
)
YAMLS = (
    *("", "schema: 1", "[" * 5000, "a: &a [*a]", "{" * 3000, "? " * 3000, "- " * 5000, "schema: 1\nschema: 1\n"),
    *("!!python/object/apply:os.system [ls]", "a: &a [x,x,x,x]\nb: [*a,*a,*a,*a]\n", "\t", "\0", "x: " + "9" * 9000),
)
NUMBERS = ("0.04", "118.0", "0.054", "0.161")  # as in fuzzing.programs.PARAMETERS
YAML = (
    "schema: 1\nrobot_id: {robot_id}\nwritten: 2026-11-22T00:00:00Z\nparameters:\n"
    "  wheel_radius: {{value: {0}, unit: m}}\n  k2_over_k3: {{value: {1}, unit: rad/s^2}}\n"
    "  k1: {{value: {2}, unit: s/rad}}\n"
    "  base_width: {{value: {3}, unit: m}}\neffects: []\nprovenance: {{}}\n"
)
ODD_NUMBERS = (
    "0",
    "-1",
    "1e300",
    ".nan",
    ".inf",
    "1e-300",
    "0.08",
    "[]",
    "{}",
    "null",
    "'x'",
    "0x10",
    "1_0",
    "9" * 400,
)
LENGTHS = (0, 1, 2, 3, 5, 50, 300, 1000)
HOST = socket.gethostname()
PLAIN: dict[str, dict[str, Any]] = {  # fields that differ from the small log's, so that processes accept the message
    "MOTOR_FEEDBACK": {"psi_right": 0.1, "current_left": 1.0},
    "WHEEL_SPEED_COMMAND": {"psi_right": 3.5},
    "WAYPOINTS": {"x": [0.5, 1.0], "y": [0.0, 0.5]},
    "POSE": {"x": 0.1, "y": 0.1, "theta": 0.1},
    "RANGE_SCAN": {"ranges": [0.5, 2.0, 0.1]},
    # --version: the process that an agent starts ends at once.
    "PROCESS_REQUEST": {"host": HOST, "command": '["cmr-pilot", "--version"]', "role": "pilot", "name": "pilot 0"},
    "PROCESS_STATUS": {"host": HOST},
}


def message_of(stream: Stream[Message], robot_id: int, utime: int) -> Any:
    """Return a valid message of a stream, with timestamp `utime` [us]."""
    message: Any = copy.deepcopy(_plain(stream))
    message.utime = utime
    if stream.per_robot:
        message.robot_id = robot_id
    for name in ("received_utime", "since_utime", "sequence"):
        if hasattr(message, name):
            setattr(message, name, utime)
    if stream.name == "PARAMETERS":
        _announce(message, YAML.format(*NUMBERS, robot_id=robot_id))
    return message


def fuzzed(draws: Draws, stream: Stream[Message], robot_id: int, utime: int) -> bytes:
    """Return the bytes of a fuzzed message of a stream; some are valid and have timestamp `utime` [us]."""
    message = message_of(stream, robot_id, utime)
    kind = draws.below(10)
    if kind in (1, 2, 3, 4):
        for _ in range(1 + (draws.below(4) if kind > 2 else 0)):
            _change(draws, message, draws.choice(_changeable(stream.message_type)))
    if kind in (5, 6):
        message.utime = min(max(utime + draws.choice(STAMPS), -(2**63)), 2**63 - 1)
    if kind == 7:
        message.utime = draws.choice((*ABSURD_STAMPS, draws.whole()))
    if kind in (3, 4, 5) and stream.name == "PARAMETERS":
        _announce(message, _yaml(draws, robot_id))
    if kind == 4 and stream.name == "PROCESS_REQUEST":
        message.files = json.dumps({draws.choice(("robot_0.yaml", "../x.yaml", "a.yaml", "")): draws.choice(TEXTS)})
    data: bytes = message.encode()
    if kind in (8, 9):
        for _ in range(1 + draws.below(3)):
            data = draws.choice(DAMAGES)(draws, data)
    return data


def _yaml(draws: Draws, robot_id: int) -> str:
    """Return the text of a valid or damaged parameter file."""
    if draws.one_in(3):
        return draws.choice(YAMLS)
    odd = [draws.choice((*ODD_NUMBERS, str(draws.real()))) if draws.one_in(3) else number for number in NUMBERS]
    text = YAML.format(*odd, robot_id=draws.choice((robot_id, robot_id, 1, -1, "x")))
    if draws.one_in(4):
        at = draws.below(len(text))
        text = text[:at] + draws.choice((*TEXTS, chr(draws.below(0x300)))) + text[at + draws.below(20) :]
    return text


def _announce(message: Any, text: str) -> None:
    message.yaml, message.sha256 = text, hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()


@cache
def _plain(stream: Stream[Message]) -> Any:
    message: Any = stream.message_type()
    for name, value in (FIELDS[stream.name] | PLAIN.get(stream.name, {})).items():
        setattr(message, name, value)
    for field in fields_of(stream.message_type):
        value = getattr(message, field.name)
        if field.counted_by is not None or field.wire_type == BYTES:
            message.n = len(value)
    return message


def _changeable(message_type: type[Message]) -> tuple[Field, ...]:
    """Return all fields except the timestamp, which is changed separately."""
    return tuple(field for field in fields_of(message_type) if field.name not in ("utime", "n")) + _counts(message_type)


def _counts(message_type: type[Message]) -> tuple[Field, ...]:
    return tuple(field for field in fields_of(message_type) if field.name == "n")


def _change(draws: Draws, message: Any, field: Field) -> None:
    """Set a field of a message to another value that can be encoded."""
    if field.name == "n":
        _resize(message, draws.choice(LENGTHS))
    elif field.wire_type == BYTES:
        message.jpeg = draws.take(draws.choice(LENGTHS))
        message.n = len(message.jpeg)
    elif field.wire_type == "string":
        setattr(message, field.name, draws.choice(TEXTS))
    elif field.counted_by is not None:
        values = getattr(message, field.name)
        for place in range(len(values)) if draws.one_in(2) else [draws.below(len(values))] if values else []:
            values[place] = _number(draws, field.wire_type, values[place])
    else:
        setattr(message, field.name, _number(draws, field.wire_type, getattr(message, field.name)))


def _resize(message: Any, length: int) -> None:
    """Give all arrays of a message this length."""
    kind: Any = type(message)
    for field in fields_of(kind):
        if field.counted_by is not None or field.wire_type == BYTES:
            values = getattr(message, field.name) or ([1] if field.wire_type != BYTES else b"x")
            setattr(message, field.name, (values * length)[:length])
    message.n = length


def _number(draws: Draws, wire_type: str, value: float) -> float:
    """Return a number that a field of this type can hold."""
    if wire_type in INT_BITS:
        whole = draws.choice((*WHOLES, draws.whole(), int(value) + 1, int(value) - 1))
        bits = INT_BITS[wire_type]
        if wire_type == "boolean":
            return whole % 2
        lowest = 0 if wire_type == "byte" else -(1 << bits - 1)
        return (whole - lowest) % (1 << bits) + lowest
    real = draws.choice((*REALS, draws.real(), value * 1000.0, -value, value + draws.fraction()))
    return math.copysign(math.inf, real) if wire_type == "float" and abs(real) > LARGEST_FLOAT else real


def _cut(draws: Draws, data: bytes) -> bytes:
    return data[: draws.below(len(data) + 1)] if len(data) < 65_536 else data[:100]


def _extended(draws: Draws, data: bytes) -> bytes:
    return data + draws.choice((b"\0", b"CMR1", bytes(1000), b"\xff" * 65_000, draws.take(36), data))


def _flipped(draws: Draws, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(1 + draws.below(8)):
        if changed:
            changed[draws.below(min(len(changed), 65_536))] = draws.below(256)
    return bytes(changed)


def _length(draws: Draws, data: bytes) -> bytes:
    """Replace four bytes by an integer that is an absurd length."""
    at = FINGERPRINT_BYTES + draws.below(max(min(len(data), 200) - FINGERPRINT_BYTES, 1))
    absurd = draws.choice((2**31 - 1, -(2**31), -1, 0, 1, 10**6, 65_536, len(data)))
    return data[:at] + absurd.to_bytes(4, "big", signed=True) + data[at + 4 :]


def _foreign(draws: Draws, data: bytes) -> bytes:
    """Replace the fingerprint by that of another type, an older version, or random bytes."""
    fingerprints = [stream.message_type._get_packed_fingerprint() for stream in STREAMS]
    return draws.choice((*fingerprints, *OLDER, draws.take(8)))[:FINGERPRINT_BYTES] + data[FINGERPRINT_BYTES:]


def _rubbish(draws: Draws, data: bytes) -> bytes:
    del data
    return draws.take(draws.choice((0, 1, 7, 8, 9, 20, 60)))


DAMAGES: tuple[Callable[[Draws, bytes], bytes], ...] = (
    _cut,
    _extended,
    _flipped,
    _flipped,
    _length,
    _foreign,
    _rubbish,
)
