"""Write messages of a log to MCAP with JSON, which Foxglove and others decode without LCM.

Numbers are JSON's: infinity is 1e999, which is read as infinity again; a single NaN is left out of its message, and in
an array it is null.
"""

import json
import math
import struct
from collections.abc import Callable, Iterable
from typing import BinaryIO

import numpy as np

from cmr.bus.fields import BYTES, Field, fields_of, text_of_bytes
from cmr.bus.message import Message
from cmr.bus.messages import RejectedMessage
from cmr.bus.wire import MOST_CHANNELS, Channel, channel_of, layout_of, utime_of
from cmr.recordings.events import Event
from cmr_tools.logs.channels import FOREIGN_CHANNEL, LeftOut

NANOSECONDS = 1000  # in a microsecond
LAST_UTIME = (2**64 - 1) // NANOSECONDS  # us; MCAP's times are 64 bits of nanoseconds
STRUCT_CODES = {"i1": "b", "i2": "h", "i4": "i", "i8": "q", "u1": "B", "f4": "f", "f8": "d"}
JSON_TYPES = {"string": "string", "boolean": "boolean", "float": "number", "double": "number"}  # others: integer

Encoder = Callable[[bytes], bytes]
Text = Callable[[object], str | None]


class McapWriter:
    """Writes messages into an MCAP file that is open at `stream`; `count` of them, `left_out` counts the others.

    Raises ModuleNotFoundError without the library.
    """

    def __init__(self, stream: BinaryIO) -> None:
        from mcap.writer import Writer

        self._writer = Writer(stream)
        self._writer.start(profile="", library="cmr-log")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, tuple[int, Encoder]] = {}
        self._sequences: dict[str, int] = {}
        self.count = 0
        self.left_out = LeftOut()

    def take_all(self, events: Iterable[Event]) -> None:
        """Write the events of a log."""
        for event in events:
            channel = channel_of(event.channel)
            if channel is None:
                self.left_out.add(event.channel, FOREIGN_CHANNEL)
            elif not 0 <= event.utime <= LAST_UTIME:
                self.left_out.add(event.channel, "logged at an impossible time")
            elif event.channel not in self._channels and len(self._channels) >= MOST_CHANNELS:
                self.left_out.add(event.channel, "one channel too many")
            else:
                self._take(channel, event)

    def _take(self, channel: Channel, event: Event) -> None:
        number, encode = self._channels.get(event.channel) or self._register(channel)
        try:
            data = encode(event.data)
        except RejectedMessage as rejected:
            self.left_out.add(event.channel, rejected.reason)
            return
        decided = utime_of(event.data)
        publish_time = decided if 0 <= decided <= LAST_UTIME else event.utime
        self._writer.add_message(
            channel_id=number,
            log_time=event.utime * NANOSECONDS,
            publish_time=publish_time * NANOSECONDS,
            data=data,
            sequence=self._sequence(event.channel),
        )
        self.count += 1

    def _sequence(self, name: str) -> int:
        """Return the number of a channel's next message, from 0."""
        sequence = self._sequences.get(name, 0)
        self._sequences[name] = sequence + 1
        return sequence % 2**32

    def finish(self) -> None:
        """Complete the file."""
        self._writer.finish()

    def _register(self, channel: Channel) -> tuple[int, Encoder]:
        """Announce a channel, and its schema if it is the type's first."""
        message_type = channel.stream.message_type
        name = f"cmr.{message_type.__name__}"
        if name not in self._schemas:
            content = json.dumps(schema_of(message_type)).encode()
            self._schemas[name] = self._writer.register_schema(name=name, encoding="jsonschema", data=content)
        number = self._writer.register_channel(
            topic=channel.name, message_encoding="json", schema_id=self._schemas[name]
        )
        self._channels[channel.name] = number, encoder_of(channel)
        return self._channels[channel.name]


def schema_of(message_type: type[Message]) -> dict[str, object]:
    """Return the JSON schema of a generated message class; the descriptions are the comments of lcmtypes."""
    properties = {}
    for field in fields_of(message_type):
        kind: dict[str, object] = {"type": JSON_TYPES.get(field.wire_type, "integer")}
        if field.wire_type == BYTES:
            kind = {"type": "string", "contentEncoding": "base64"}
        if field.counted_by is not None:
            kind = {"type": "array", "items": kind}
        properties[field.name] = {**kind, "description": field.comment}
    description = " ".join((message_type.__doc__ or "").split())
    return {"title": message_type.__name__, "description": description, "type": "object", "properties": properties}


def encoder_of(channel: Channel) -> Encoder:
    """Return a function that converts an encoded message of the channel to JSON; it raises RejectedMessage on
    failure.
    """
    fields = fields_of(channel.stream.message_type)
    texts = [(f'"{field.name}":', _text_of(field)) for field in fields]

    def join(values: Iterable[object]) -> bytes:
        parts = [(name, text(value)) for (name, text), value in zip(texts, values, strict=True)]
        return ("{" + ",".join(name + said for name, said in parts if said is not None) + "}").encode()

    if not channel.is_fixed:

        def encode_varying(data: bytes) -> bytes:
            message = channel.check(data)
            return join(getattr(message, field.name) for field in fields)

        return encode_varying
    layout = layout_of(channel.stream.message_type)
    codes = (STRUCT_CODES[layout[field.name].str[1:]] for field in fields)
    unpack = struct.Struct(">8x" + "".join(codes)).unpack_from

    def encode_fixed(data: bytes) -> bytes:
        channel.check(data)
        return join(unpack(data))

    return encode_fixed


def _text_of(field: Field) -> Text:
    """Return a function that writes a value of the field as JSON; None: it is left out."""
    by_type: dict[str, Text] = {"string": json.dumps, "boolean": _boolean, "float": _short_number, "double": _number}
    if field.wire_type == BYTES:
        return _base64
    one = by_type.get(field.wire_type, str)
    if field.counted_by is None:
        return one

    def all_of(values: object) -> str:
        listed = values.tolist() if isinstance(values, np.ndarray) else values
        assert isinstance(listed, list | tuple), "as every array of a message"
        return "[" + ",".join("null" if text is None else text for text in map(one, listed)) + "]"

    return all_of


def _base64(value: object) -> str:
    assert isinstance(value, bytes), "as every picture in a message"
    return f'"{text_of_bytes(value)}"'


def _boolean(value: object) -> str:
    return "true" if value else "false"


def _number(value: object) -> str | None:
    assert isinstance(value, float), "as every number with a point in a message"
    return repr(value) if math.isfinite(value) else _infinite(value)


def _short_number(value: object) -> str | None:
    """Write a number of single precision, for which nine digits are enough."""
    assert isinstance(value, float), "as every number with a point in a message"
    return f"{value:.9g}" if math.isfinite(value) else _infinite(value)


def _infinite(value: float) -> str | None:
    return None if math.isnan(value) else "1e999" if value > 0.0 else "-1e999"
