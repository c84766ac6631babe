"""The profile of a tracker: its address, its axes and units, and which of its bodies is which robot."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from cmr.cli.configuration import LARGEST_ROBOT_ID
from cmr.documents.declared import Between, Word
from cmr.documents.document import DocumentError, Item, read, read_file
from cmr.documents.structure import structured

SCHEMA = 1
KINDS = ("optitrack", "qualisys", "vrpn", "vicon", "motionanalysis", "nokov", "fzmotion", "mock")
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}  # m
AXES = ("z", "y")

EXAMPLE = """\
# Profile of cmr-tracker (m, rad, s): docs/how_to/use_a_tracker.md explains each line.
schema: 1
tracker:
  type: optitrack              # optitrack, qualisys, vrpn, vicon, motionanalysis, nokov, fzmotion or mock
  server: 192.168.1.10         # address of the computer that runs the tracker's program
  local: 192.168.1.20          # own address in the tracker's network, to which multicast comes
  up: y                        # axis of the tracker that points up: y (Motive's usual one) or z
  # unit: mm                   # of the positions; usually m, of qualisys mm
  # lag: 0.004                 # from the exposure to the tracker's own time stamp
limits:                        # what your robots can do at most; more than this is an error of the tracker
  speed: 1.5
  turn_rate: 6.0
  tilt: 0.35                   # a body that leans further has fallen, or was recognised wrongly
frame: {x: 0.0, y: 0.0, theta: 0.0}   # where the tracker's origin and x axis lie in the world
robots:                        # the name of the body that each robot carries
  0: {body: robot_0}
  1: {body: robot_1, x: 0.02, y: 0.0, theta: 1.571}   # where on the robot the body's origin is, and its x axis points
"""


class ProfileError(DocumentError):
    """A profile cannot be used; the text names file, line and key."""

    after = " "
    empty = "is empty; 'cmr-tracker --write-profile FILE' writes one to begin with"


@dataclass(frozen=True)
class Tracker:
    """Address and conventions of a tracker. `port` None is the default of its type."""

    type: Annotated[str, Word(lambda: KINDS)]
    server: str
    local: str = "0.0.0.0"
    port: Annotated[int, Between(1, 65535)] | None = None
    up: Annotated[str, Word(lambda: AXES)] = "z"
    unit: Annotated[str, Word(lambda: tuple(UNITS))] | None = None
    lag: Annotated[float, Between(0.0, 1.0)] = 0.0
    rate: Annotated[int, Between(1, 1000)] = 100

    @property
    def metres(self) -> float:
        """The tracker's unit of length [m]."""
        return UNITS[self.unit or ("mm" if self.type == "qualisys" else "m")]


@dataclass(frozen=True)
class Limits:
    """Limits of the robots: speed [m/s], turn rate [rad/s], and tilt [rad]."""

    speed: Annotated[float, Between(0.05, 20.0)] = 1.5
    turn_rate: Annotated[float, Between(0.1, 60.0)] = 6.0
    tilt: Annotated[float, Between(0.02, 1.5)] = 0.35


@dataclass(frozen=True)
class Frame:
    """Pose of the tracker's origin and x axis in the world [m, rad]."""

    x: Annotated[float, Between(-1e5, 1e5)] = 0.0
    y: Annotated[float, Between(-1e5, 1e5)] = 0.0
    theta: Annotated[float, Between(-2.0 * math.pi, 2.0 * math.pi)] = 0.0


@dataclass(frozen=True)
class Carried:
    """The body on a robot: its name, the position of its origin on the robot [m], and the direction of its x axis
    [rad].

    With `wheel_radius` [m], its wheels can distinguish the robot from another one if it has no gyro.
    """

    body: str
    x: Annotated[float, Between(-10.0, 10.0)] = 0.0
    y: Annotated[float, Between(-10.0, 10.0)] = 0.0
    theta: Annotated[float, Between(-2.0 * math.pi, 2.0 * math.pi)] = 0.0
    wheel_radius: Annotated[float, Between(0.001, 2.0)] | None = None


@dataclass(frozen=True)
class Profile:
    """A tracker, and the bodies of robots by robot id."""

    tracker: Tracker
    robots: Mapping[int, Carried]
    limits: Limits = field(default_factory=Limits)
    frame: Frame = field(default_factory=Frame)

    @classmethod
    def load(cls, path: Path) -> "Profile":
        """Read a profile from a file. Raises ProfileError."""
        return _profile(read_file(path, ProfileError))

    @classmethod
    def parse(cls, text: str) -> "Profile":
        """Read a profile from a text. Raises ProfileError."""
        return _profile(read(text, "profile", ProfileError))


def _profile(root: Item) -> Profile:
    section = root.section(("schema", "tracker", "limits", "frame", "robots"))
    if section.need("schema").whole(1, 10**6) != SCHEMA:
        raise section["schema"].place.error(f"is not {SCHEMA}, which is all that this version reads")
    limits, frame = section.get("limits"), section.get("frame")
    return Profile(
        structured(section.need("tracker"), Tracker),
        _robots(section.need("robots")),
        Limits() if limits is None else structured(limits, Limits),
        Frame() if frame is None else structured(frame, Frame),
    )


def _robots(item: Item) -> dict[int, Carried]:
    """Return the robots; each has an id and a body of its own."""
    robots: dict[int, Carried] = {}
    for name, entry in item.entries():
        if not (name.isascii() and name.isdecimal()) or int(name) > LARGEST_ROBOT_ID:
            raise entry.place.error("is no robot id, which is a whole number from 0 on")
        carried = structured(entry, Carried)
        if int(name) in robots:
            raise entry.place.error("is there twice")
        if carried.body in {other.body for other in robots.values()}:
            raise entry.place.error(f"has the body {carried.body!r} of another robot")
        robots[int(name)] = carried
    if not robots:
        raise item.place.error("names no robot")
    return robots
