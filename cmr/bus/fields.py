"""Fields of messages: names, wire types, units and comments from lcmtypes/*.lcm, and access to their values.

The build copies the comments into the generated classes; they are the only source of the units.
"""

import ast
import inspect
import math
import re
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from textwrap import dedent
from typing import NamedTuple

from cmr.bus.message import Message
from cmr.bus.streams import identify
from cmr.msg import robot_state_t, world_state_t

INDEX = "index"  # column that numbers the elements of a message's arrays
BRACKETS = re.compile(r"\[([^\[]*)\]?\s*$")  # at the end of a comment; a range in it may hold a bracket: (-pi, pi]
NAMED = re.compile(r'\("(\w+)"\)')  # of: fraction of full drive ("duty")
# Units recognised at the start of a comment's brackets; the rest of the brackets is a range, a frame, or words.
UNITS = ("rad/s^2", "rad/s", "s/rad", "rad", "deg C", "duty", "ticks", "us", "s", "Hz", "m/s", "m", "A", "V")
SAME_UNIT = "same units"  # of X_std as of X
ROBOTS = "origin"  # marks types that describe many robots, one per array element
BYTES = "bytes"  # our wire type for an array of bytes, such as a picture: one value, not a row of numbers


@dataclass(frozen=True)
class Field:
    """A field of a message type.

    `counted_by` names the field that holds the length of an array, None for a single value; `unit` is empty without
    one; `comment` is the whole comment.
    """

    name: str
    wire_type: str
    counted_by: str | None
    unit: str
    comment: str

    @property
    def column(self) -> str:
        """The name with the unit, as in `yaw_rate [rad/s]`."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@cache
def fields_of(message_type: type[Message]) -> tuple[Field, ...]:
    """Return the fields of a generated message class, in their order on the wire.

    Raises TypeError for arrays of fixed length or of several dimensions, which none of our types has.
    """
    comments = _comments(message_type)
    fields: dict[str, Field] = {}
    described = zip(message_type.__slots__, message_type.__typenames__, message_type.__dimensions__, strict=True)
    for name, wire_type, dimensions in described:
        counted_by, *more = dimensions or (None,)
        if more or isinstance(counted_by, int):
            raise TypeError(f"{message_type.__name__}.{name}: no array that another field counts")
        if wire_type == "byte" and counted_by is not None:
            wire_type, counted_by = BYTES, None
        unit = _unit(comments[name], name, fields) if wire_type not in ("string", BYTES) else ""
        fields[name] = Field(name, wire_type, counted_by, unit, comments[name])
    return tuple(fields.values())


def text_of_bytes(data: bytes) -> str:
    """Return bytes as base64 text, for tables and JSON."""
    return b64encode(bytes(data)).decode("ascii")


def _comments(message_type: type[Message]) -> dict[str, str]:
    """Return the comment of each field; fields declared together share the one above them."""
    [function] = ast.parse(dedent(inspect.getsource(message_type.__init__))).body
    assert isinstance(function, ast.FunctionDef)
    comments, comment = {}, ""
    for assignment, docstring in zip(function.body[::2], function.body[1::2], strict=True):
        assert isinstance(assignment, ast.Assign)
        assert isinstance(assignment.targets[0], ast.Attribute)
        assert isinstance(docstring, ast.Expr)
        text = " ".join(ast.literal_eval(docstring.value).split())
        own = text.rpartition("LCM Type:")[0].strip()
        comment = own or comment
        comments[assignment.targets[0].attr] = comment
    return comments


def _unit(comment: str, name: str, earlier: dict[str, Field]) -> str:
    """Return the unit that a comment gives in brackets at its end; empty without one."""
    match = BRACKETS.search(comment)
    if match is None:
        return ""
    said = match[1]
    if said.startswith(SAME_UNIT):
        return earlier[name.removesuffix("_std")].unit
    named = NAMED.search(said)
    if named is not None:
        return named[1]
    return next((unit for unit in UNITS if re.match(rf"{re.escape(unit)}(?![\w/^])", said)), "")


class FieldName(NamedTuple):
    """A field of the messages of a channel; of an array, the element with this number.

    With `whose`, a robot or a twin, `element` is its id, which may be anywhere in the array.
    """

    channel: str
    field: str
    element: int | None = None
    whose: str = ""

    def __str__(self) -> str:
        which = f"{self.whose} {self.element}" if self.whose else f"{self.element}"
        return f"{self.channel}.{self.field}" + ("" if self.element is None else f"[{which}]")


def fields_on(channel: str) -> dict[str, Field] | None:
    """Return the fields of the messages on a channel by name; None for an unknown channel."""
    identity = identify(channel)
    return None if identity is None else {field.name: field for field in fields_of(identity[0].message_type)}


def unit_of(name: FieldName) -> str:
    """Return the unit of a field; empty where it has none."""
    return (fields_on(name.channel) or {})[name.field].unit


def number_in(message: Message, name: FieldName) -> float:
    """Return the number in a field of a message; NaN if the message has no such element or is about another robot."""
    value = getattr(message, name.field)
    if name.element is None:
        return float(value)
    if name.whose:
        return next((float(value[place]) for place in _places(message, name)), math.nan)
    return float(value[name.element]) if name.element < len(value) else math.nan


def _places(message: Message, name: FieldName) -> Iterator[int]:
    """Yield the array indices in a message that belong to the named robot or twin."""
    if not isinstance(message, world_state_t):
        return
    for place, robot_id in enumerate(message.robot_id):
        if robot_id == name.element and (message.origin[place] == robot_state_t.TWIN) == (name.whose == "twin"):
            yield place
