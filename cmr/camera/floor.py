"""What is on the floor: tags at known places, and robots with tags on top. Read from a YAML file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cmr.camera.lens import CameraFileError, Floats, read_yaml

FEWEST_TAGS = 4  # on the floor; fewer, or all in a corner, place the camera badly
LARGEST_TAG = 586  # of the family 36h11


@dataclass(frozen=True)
class FloorTag:
    """A tag lying on the floor: its centre [m; world], where its top points [rad], edge of its black square [m]."""

    x: float
    y: float
    theta: float
    size: float

    @property
    def corners(self) -> Floats:
        """Corners in the world (4, 3) [m], from top left as one sees the tag."""
        return np.column_stack([turned(square(self.size), self.theta) + np.array([self.x, self.y]), np.zeros(4)])


@dataclass(frozen=True)
class RobotTag:
    """The tag on a robot: edge of its black square [m], height above the floor [m], and where it is on the robot.

    (x, y) [m; robot, from the tracked point] is the tag's centre, `theta` [rad] where its top points: 0 ahead.
    `length`, `width` [m] and `height` are the robot's own box, which hides what is drawn behind it.
    """

    size: float = 0.16
    height: float = 0.1
    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0
    length: float = 0.2
    width: float = 0.2


@dataclass(frozen=True)
class Floor:
    """Tags of the floor by number, and how robots carry theirs.

    `robots` are those described by themselves, by the tag's number; `robot_ids` gives the robot's id where it is not
    the tag's number. `only` are the tags that count as robots', None for all that are not on the floor.
    """

    tags: Mapping[int, FloorTag]
    usual: RobotTag = RobotTag()
    robots: Mapping[int, RobotTag] = field(default_factory=dict)
    robot_ids: Mapping[int, int] = field(default_factory=dict)
    only: frozenset[int] | None = None

    def robot_id(self, number: int) -> int | None:
        """Return whose tag this is, None if no robot's."""
        if number in self.tags or (self.only is not None and number not in self.only):
            return None
        return self.robot_ids.get(number, number)

    def number(self, robot_id: int) -> int:
        """Return the number of a robot's tag."""
        return next((number for number, known in self.robot_ids.items() if known == robot_id), robot_id)

    def robot_tag(self, number: int) -> RobotTag:
        """Return how the robot with this tag carries it."""
        return self.robots.get(number, self.usual)

    @classmethod
    def load(cls, path: Path) -> "Floor":
        """Read a floor file, as `cmr-camera --help` shows one. Raises CameraFileError."""
        content = read_yaml(path)
        try:
            return _floor(content)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise CameraFileError(f"{path}: {error if isinstance(error, ValueError) else repr(error)}") from error


def square(size: float) -> Floats:
    """Return the corners (4, 2) of a square whose top points along x, from top left, clockwise seen from above."""
    half = size / 2.0
    return np.array([(half, half), (half, -half), (-half, -half), (-half, half)])


def turned(points: Floats, theta: float) -> Floats:
    """Return points (n, 2) turned by `theta` [rad] counter-clockwise."""
    c, s = math.cos(theta), math.sin(theta)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def _floor(content: dict[str, Any]) -> Floor:
    known = {"schema", "tag_size", "tags", "robots"}
    if set(content) - known:
        raise ValueError(f"unknown: {', '.join(sorted(map(str, set(content) - known)))}; known: {sorted(known)}")
    size = _positive("tag_size", content["tag_size"])
    tags = {_number(number): _floor_tag(number, entry, size) for number, entry in content["tags"].items()}
    if len(tags) < FEWEST_TAGS:
        raise ValueError(f"{len(tags)} tags on the floor; at least {FEWEST_TAGS} are needed, far apart")
    robots = content.get("robots", {})
    each = robots.pop("each", {})
    usual = _robot_tag("each", each, RobotTag(size=size))
    only = robots.pop("only", None)
    described = {_number(number): dict(entry or {}) for number, entry in robots.items()}
    robot_ids = {number: int(entry.pop("robot_id")) for number, entry in described.items() if "robot_id" in entry}
    on_both = sorted(set(described) & set(tags))
    if on_both:
        raise ValueError(f"tags {on_both} are both on the floor and on a robot")
    return Floor(
        tags,
        usual,
        {number: _robot_tag(number, entry, usual) for number, entry in described.items()},
        robot_ids,
        None if only is None else frozenset({*map(_number, only), *described}),
    )


def _number(number: Any) -> int:
    if not isinstance(number, int) or not 0 <= number <= LARGEST_TAG:
        raise ValueError(f"{number!r} is no tag of 36h11: they are 0 to {LARGEST_TAG}")
    return number


def _positive(name: str, value: Any) -> float:
    if not (isinstance(value, int | float) and 0.0 < value < math.inf):
        raise ValueError(f"{name} is a length of more than 0 m, not {value!r}")
    return float(value)


def _floor_tag(number: Any, entry: dict[str, Any], size: float) -> FloorTag:
    unknown = set(entry) - {"x", "y", "theta", "size"}
    numbers = [float(entry.get(name, math.nan)) for name in ("x", "y", "theta")]
    if unknown or not all(map(math.isfinite, numbers)):
        raise ValueError(f"tag {number}: it has x, y [m], theta [rad] and at will size [m], not {entry}")
    return FloorTag(numbers[0], numbers[1], numbers[2], _positive("size", entry.get("size", size)))


def _robot_tag(number: Any, entry: dict[str, Any], usual: RobotTag) -> RobotTag:
    names = {name: getattr(usual, name) for name in RobotTag.__dataclass_fields__}
    unknown = set(entry) - set(names)
    if unknown:
        raise ValueError(f"robots: {number}: unknown: {', '.join(sorted(unknown))}; known: {', '.join(names)}")
    values = {name: float(entry.get(name, value)) for name, value in names.items()}
    if not all(map(math.isfinite, values.values())) or values["height"] < 0.0:
        raise ValueError(f"robots: {number}: numbers are finite, and height is 0 or more: {entry}")
    for name in ("size", "length", "width"):
        _positive(name, values[name])
    return RobotTag(**values)
