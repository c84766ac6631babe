"""What is on the floor: tags at known places, and robots with tags on top. Read from a YAML file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cmr.camera.lens import CameraFileError, Content, Floats, read_camera_file

FEWEST_TAGS = 4  # on the floor; fewer, or all in a corner, place the camera badly
LARGEST_TAG = 586  # of the family 36h11


@dataclass(frozen=True)
class FloorTag:
    """A tag lying on the floor: its centre [m; world], the direction of its top [rad], edge of its black square [m]."""

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
    """The tag on a robot: edge of its black square [m], height above the floor [m], and its pose on the robot.

    (x, y) [m; robot, from the tracked point] is the tag's centre, `theta` [rad] the direction of its top: 0 is ahead.
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
    """Tags of the floor by number, and how they are mounted on robots.

    `robots` are those with an entry of their own, by the tag's number; `robot_ids` gives the robot's id where it
    differs from the tag's number. `only` lists the tags that count as robots'; None: all that are not on the floor.
    """

    tags: Mapping[int, FloorTag]
    usual: RobotTag = RobotTag()
    robots: Mapping[int, RobotTag] = field(default_factory=dict)
    robot_ids: Mapping[int, int] = field(default_factory=dict)
    only: frozenset[int] | None = None

    def robot_id(self, number: int) -> int | None:
        """Return the id of the robot with this tag, None if it is not a robot's."""
        if number in self.tags or (self.only is not None and number not in self.only):
            return None
        return self.robot_ids.get(number, number)

    def number(self, robot_id: int) -> int:
        """Return the number of a robot's tag."""
        return next((number for number, known in self.robot_ids.items() if known == robot_id), robot_id)

    def robot_tag(self, number: int) -> RobotTag:
        """Return how the tag with this number is mounted on its robot."""
        return self.robots.get(number, self.usual)

    @classmethod
    def load(cls, path: Path) -> "Floor":
        """Read a floor file, in the format shown by `cmr-camera --help`. Raises CameraFileError."""
        root, content = read_camera_file(path)
        try:
            return _floor(content)
        except CameraFileError as error:
            raise error.placed(root) from error.__cause__


def square(size: float) -> Floats:
    """Return the corners (4, 2) of a square whose top points along x, from top left, clockwise seen from above."""
    half = size / 2.0
    return np.array([(half, half), (half, -half), (-half, -half), (-half, half)])


def turned(points: Floats, theta: float) -> Floats:
    """Return points (n, 2) turned by `theta` [rad] counter-clockwise."""
    c, s = math.cos(theta), math.sin(theta)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def _floor(content: Content) -> Floor:
    known = {"schema", "tag_size", "tags", "robots"}
    if set(content) - known:
        unknown = sorted(map(str, set(content) - known))
        raise CameraFileError(f"unknown: {', '.join(unknown)}; known: {sorted(known)}", inside=(unknown[0],))
    size = _positive("tag_size", content.get("tag_size"), "tag_size")
    tags = {
        _number(number, "tags"): _floor_tag(number, _entries(entry, "tags", str(number)), size)
        for number, entry in _entries(content.get("tags"), "tags").items()
    }
    if len(tags) < FEWEST_TAGS:
        words = f"{len(tags)} tags on the floor; at least {FEWEST_TAGS} are needed, far apart"
        raise CameraFileError(words, inside=("tags",))
    robots = {name: entry for name, entry in _entries(content.get("robots", {}), "robots").items() if name != "only"}
    usual = _robot_tag("each", _entries(robots.pop("each", {}), "robots", "each"), RobotTag(size=size))
    only = content.get("robots", {}).get("only")
    if not isinstance(only, list | None):
        raise CameraFileError(f"robots: only is a list of tags, not {only!r}", inside=("robots", "only"))
    described = {
        _number(number, "robots"): _entries(entry or {}, "robots", str(number)) for number, entry in robots.items()
    }
    robot_ids = {number: _robot_id(number, entry) for number, entry in described.items() if "robot_id" in entry}
    on_both = sorted(set(described) & set(tags))
    if on_both:
        words = f"tags {on_both} are both on the floor and on a robot"
        raise CameraFileError(words, inside=("robots", str(on_both[0])))
    return Floor(
        tags,
        usual,
        {number: _robot_tag(number, entry, usual) for number, entry in described.items()},
        robot_ids,
        None if only is None else frozenset({*(_number(number, "robots", "only") for number in only), *described}),
    )


def _entries(content: object, *keys: str) -> Content:
    if not isinstance(content, dict):
        raise CameraFileError(f"{': '.join(keys)}: must be a mapping, not {content!r}", inside=keys)
    return dict(content)


def _number(number: object, *keys: str) -> int:
    if not isinstance(number, int) or not 0 <= number <= LARGEST_TAG:
        words = f"{number!r} is no tag of 36h11: they are 0 to {LARGEST_TAG}"
        raise CameraFileError(words, inside=(*keys, str(number)))
    return number


def _robot_id(number: int, entry: Content) -> int:
    try:
        return int(entry.pop("robot_id"))
    except (TypeError, ValueError) as error:
        words = f"robots: {number}: robot_id is a whole number"
        raise CameraFileError(words, inside=("robots", str(number), "robot_id")) from error


def _positive(name: str, value: object, *keys: str) -> float:
    if not (isinstance(value, int | float) and 0.0 < value < math.inf):
        raise CameraFileError(f"{name} is a length of more than 0 m, not {value!r}", inside=keys)
    return float(value)


def _float(value: Any) -> float:
    """Return a value as a number, NaN if it is not one."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def _floor_tag(number: object, entry: Content, size: float) -> FloorTag:
    keys = "tags", str(number)
    unknown = set(entry) - {"x", "y", "theta", "size"}
    numbers = [_float(entry.get(name)) for name in ("x", "y", "theta")]
    if unknown or not all(map(math.isfinite, numbers)):
        words = f"tag {number}: it has x, y [m], theta [rad] and at will size [m], not {entry}"
        raise CameraFileError(words, inside=keys)
    return FloorTag(numbers[0], numbers[1], numbers[2], _positive("size", entry.get("size", size), *keys, "size"))


def _robot_tag(number: object, entry: Content, usual: RobotTag) -> RobotTag:
    keys = "robots", str(number)
    names = {name: getattr(usual, name) for name in RobotTag.__dataclass_fields__}
    unknown = set(entry) - set(names)
    if unknown:
        words = f"robots: {number}: unknown: {', '.join(sorted(map(str, unknown)))}; known: {', '.join(names)}"
        raise CameraFileError(words, inside=(*keys, min(map(str, unknown))))
    values = {name: _float(entry.get(name, value)) for name, value in names.items()}
    if not all(map(math.isfinite, values.values())) or values["height"] < 0.0:
        words = f"robots: {number}: numbers are finite, and height is 0 or more: {entry}"
        raise CameraFileError(words, inside=keys)
    for name in ("size", "length", "width"):
        _positive(name, values[name], *keys, name)
    return RobotTag(**values)
