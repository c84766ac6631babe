"""Foreign LCM messages: a struct's layout as text, and the bytes of its messages as NumPy arrays.

LCM encodes a struct as an 8-byte fingerprint and then its members in order, big-endian and without padding (LCM type
specification, lcm-proj.github.io). A struct of numbers only therefore has a fixed length and is one NumPy record. The
fingerprint is not needed, so logs can be read whose type definitions are lost.
"""

import re
from collections.abc import Collection
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cmr.bus.message import FINGERPRINT_BYTES
from cmr.bus.wire import WIRE_TYPES

Column: TypeAlias = NDArray[Any]  # of the recorded number type, (n,)

_MEMBER = re.compile(r"(\w+)\s+(.+)", re.DOTALL)
_NAME = re.compile(r"([A-Za-z_]\w*)\s*(?:\[\s*([1-9]\d*)\s*\])?")


class LayoutError(Exception):
    """The layout cannot be used; the text names the part and the allowed values."""


def parse_layout(text: str) -> np.dtype[np.void]:
    """Return the record of a struct written as LCM members: `int64_t utime; float gyro[3], accel[3];`.

    `struct name { ... }` around them, comments, and types without `_t` are accepted.
    Raises LayoutError for anything but numbers and arrays of fixed length.
    """
    text = re.sub(r"//[^\n]*|/\*.*?\*/", " ", text, flags=re.DOTALL)
    body = re.fullmatch(r"\s*struct\s+\w+\s*\{(.*)\}\s*;?\s*", text, re.DOTALL)
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for member in (body[1] if body else text).split(";"):
        if member.strip():
            fields += _parse_member(member.strip())
    names = [name for name, _, _ in fields]
    if len(set(names)) != len(names) or not names:
        raise LayoutError("needs at least one member, each with a name of its own")
    return np.dtype(fields)


def _parse_member(member: str) -> list[tuple[str, str, tuple[int, ...]]]:
    match = _MEMBER.fullmatch(member)
    code = match and (WIRE_TYPES.get(match[1]) or WIRE_TYPES.get(f"{match[1]}_t"))
    if not match or not code:
        raise LayoutError(f"{member!r} is not a type and a name; types are {', '.join(WIRE_TYPES)}")
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for declared in match[2].split(","):
        name = _NAME.fullmatch(declared.strip())
        if not name:
            raise LayoutError(f"{declared.strip()!r} is not a name or name[count] with a fixed count")
        fields.append((name[1], code, (int(name[2]),) if name[2] else ()))
    return fields


def column_names(layout: np.dtype[np.void]) -> tuple[str, ...]:
    """Return the names of `decode`'s columns: a member's name, or name[0], name[1] ... of an array."""
    names: list[str] = []
    for member in layout.names or ():
        shape = layout[member].shape
        names += [f"{member}[{index}]" for index in range(shape[0])] if shape else [member]
    return tuple(names)


def decode(
    layout: np.dtype[np.void], messages: bytes | bytearray, wanted: Collection[str] | None = None
) -> dict[str, Column]:
    """Return one array of shape (number of messages,) for each wanted column, in the member's own number type.

    `messages` are whole messages one after the other, fingerprints included, each of `message_bytes(layout)`. Without
    `wanted`, all columns are returned.
    """
    whole = np.dtype([("fingerprint", f"V{FINGERPRINT_BYTES}"), ("members", layout)])
    records = np.frombuffer(messages, whole)["members"]
    columns: dict[str, Column] = {}
    for member in layout.names or ():
        values = records[member]
        is_array = values.ndim == 2
        parts = {f"{member}[{k}]": values[:, k] for k in range(values.shape[1])} if is_array else {member: values}
        own_type = layout[member].base.newbyteorder("=")
        columns |= {name: part.astype(own_type) for name, part in parts.items() if wanted is None or name in wanted}
    return columns


def message_bytes(layout: np.dtype[np.void]) -> int:
    """Return the length of a message of this layout, fingerprint included."""
    return FINGERPRINT_BYTES + layout.itemsize
