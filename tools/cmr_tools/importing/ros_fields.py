"""Numbers inside ROS messages by path: `twist.twist.angular.z`, `position[left_wheel_joint]`, `orientation.yaw`.

A step may select an element of an array: by its index (`data[2]`), by the message's own list `name` (a joint), or by
frames (`transforms[odom>base_link]`). `yaw` behind a quaternion is its heading [rad], -pi to pi.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from cmr.geometry.quaternions import heading
from cmr.plain_text import plain

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc, Typesdict

YAW = "yaw"
QUATERNION = {"x", "y", "z", "w"}
FRAMES = ">"
MOST_NAMES = 12  # listed in an error

# array.array's code of each type of ROS numbers
CODES = {
    "bool": "B", "byte": "B", "char": "B", "octet": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip

_STEP = re.compile(r"([A-Za-z_]\w*)(?:\[([^\[\]]+)\])?")


class PathError(Exception):
    """The path is invalid, or does not exist; the text says what there is instead."""


class AbsentError(Exception):
    """This message lacks the path; the text says what there is instead."""


@dataclass(frozen=True)
class Step:
    """One step of a path: to the member `name`, and in an array to the element `chosen`."""

    name: str
    chosen: str | None

    def __str__(self) -> str:
        return self.name if self.chosen is None else f"{self.name}[{self.chosen}]"


def parse_path(text: str) -> list[Step]:
    """Return the steps of a path. Raises PathError if it is invalid."""
    steps = []
    place = 0
    while match := _STEP.match(text, place):
        steps.append(Step(match[1], match[2] and match[2].strip()))
        place = match.end() + 1
        if match.end() == len(text):
            return steps
        if text[match.end()] != ".":
            break
    raise PathError(f"is {text!r}, which is no path such as twist.linear.x, position[left_wheel] or orientation.yaw")


def getter(path: str) -> Callable[[object], Any]:
    """Return a function that reads the path's value from a message; it raises AbsentError if there is none."""
    steps = [_stepper(step) for step in parse_path(path)]

    def get(message: object) -> object:
        for step in steps:
            message = step(message)
        return message

    return get


def _stepper(step: Step) -> Callable[[object], object]:
    if step.chosen is None:
        return partial(_yaw if step.name == YAW else _member, step.name)
    if step.chosen.isdecimal():
        return partial(_element, step, int(step.chosen))
    if FRAMES in step.chosen:
        parent, _, child = (frame.strip().lstrip("/") for frame in step.chosen.partition(FRAMES))
        return partial(_between_frames, step, parent, child)
    return partial(_named, step)


def _member(name: str, parent: object) -> Any:
    """Return a message's member by this name; the message's class is generated from its definition."""
    try:
        return getattr(parent, name)
    except AttributeError:
        raise AbsentError(f"no {name!r}; there is {_listed(_members(parent))}") from None


def _yaw(name: str, parent: object) -> object:
    if hasattr(parent, name):
        return getattr(parent, name)
    return heading(*(_member(part, parent) for part in "xyzw"))


def _element(step: Step, index: int, parent: object) -> object:
    values = _member(step.name, parent)
    try:
        return values[index]
    except (IndexError, TypeError, KeyError):
        size = len(values) if hasattr(values, "__len__") else "no"
        raise AbsentError(f"no {step}; {step.name} has {size} elements") from None


def _named(step: Step, parent: object) -> object:
    names = list(_member("name", parent))
    if step.chosen not in names:
        raise AbsentError(f"no {step}; names there are {_listed(map(str, names))}")
    values = _member(step.name, parent)
    index = names.index(step.chosen)
    if index >= len(values):
        raise AbsentError(f"no {step}; {step.name} has {len(values)} elements for {len(names)} names")
    return values[index]


def _between_frames(step: Step, parent: str, child: str, message: object) -> object:
    pairs = []
    for transform in _member(step.name, message):
        pair = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
        if pair == (parent, child):
            return transform
        pairs.append(FRAMES.join(pair))
    raise AbsentError(f"no {step}; transforms there are {_listed(pairs)}")


def _members(value: object) -> list[str]:
    members = getattr(value, "__dataclass_fields__", None) or getattr(value, "__dict__", {})
    return [name for name in members if not name.startswith("_")]


def _listed(names: Iterable[str]) -> str:
    names = list(dict.fromkeys(map(plain, names)))
    more = ", ..." if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more or "nothing"


@dataclass(frozen=True)
class Member:
    """A member of a message: its type, whether that is a message of its own, and whether it is an array of them."""

    kind: str
    is_message: bool
    is_array: bool = False

    @classmethod
    def of(cls, description: "FieldDesc") -> "Member":
        """Return a member as rosbags describes it: (node, type), of an array (node, ((node, type), size))."""
        what = description[1]
        if isinstance(what, str):
            return cls(what, is_message=True)
        if isinstance(what[0], str):
            return cls(what[0], is_message=False)
        return replace(cls.of(what[0]), is_array=True)


class Types:
    """The types of a topic's messages: used to check a path before any message is read.

    `definitions` are rosbags' fielddefs: {type: (constants, [(member, description)])}.
    """

    def __init__(self, message_type: str, definitions: "Typesdict") -> None:
        self.message_type = message_type
        self._definitions = definitions

    def code(self, path: str) -> str:
        """Return array.array's code of the number at the path. Raises PathError if there is none."""
        kind, parents = self.message_type, parse_path(path)
        for place, step in enumerate(parents):
            members = self._members(kind)
            is_last = place == len(parents) - 1
            if is_last and step.name == YAW and YAW not in members and set(members) >= QUATERNION:
                return "d"
            if step.name not in members:
                raise PathError(f"has no {path!r}: {kind} has {', '.join(members)}")
            kind, is_number = self._enter(step, members, kind, path)
            if is_number:
                if is_last:
                    return CODES[kind]
                raise PathError(f"has no {path!r}: {step} is a {kind} already")
        raise PathError(f"{path!r} is no number but a {kind} of {', '.join(self._choices(kind))}")

    def _members(self, kind: str) -> dict[str, Member]:
        if kind not in self._definitions:
            return {}
        return {name: Member.of(description) for name, description in self._definitions[kind][1]}

    def _choices(self, kind: str) -> Sequence[str]:
        members = list(self._members(kind))
        return [*members, YAW] if set(members) == QUATERNION else members

    def _enter(self, step: Step, members: dict[str, Member], kind: str, path: str) -> tuple[str, bool]:
        """Return the type after a step, and whether it is a number."""
        member = members[step.name]
        if member.is_array:
            if step.chosen is None:
                raise PathError(
                    f"{path!r}: {step.name} is an array; choose one of it: {self._how_to_choose(step, members)}"
                )
            self._check_choice(step, members, path)
        elif step.chosen is not None:
            raise PathError(f"{path!r}: {step.name} is no array in {kind}")
        if member.is_message:
            return member.kind, False
        if member.kind not in CODES:
            raise PathError(f"{path!r} is a {member.kind}, no number")
        return member.kind, True

    def _how_to_choose(self, step: Step, members: dict[str, Member]) -> str:
        if self._is_transform(members[step.name]):
            return f"{step.name}[PARENT_FRAME>CHILD_FRAME]"
        return f"{step.name}[NAME]" if "name" in members else f"{step.name}[0]"

    def _is_transform(self, member: Member) -> bool:
        """Return whether a member is a transform, or an array of them."""
        return member.is_message and set(self._members(member.kind)) >= {"header", "child_frame_id"}

    def _check_choice(self, step: Step, members: dict[str, Member], path: str) -> None:
        assert step.chosen is not None
        if step.chosen.isdecimal():
            return
        by_frames = self._is_transform(members[step.name])
        if not (by_frames if FRAMES in step.chosen else "name" in members):
            raise PathError(f"{path!r}: choose one of {step.name} by {self._how_to_choose(step, members)}")
