"""The contents of report.json, by name: lengths in m, times in s since all robots were ready."""

from typing import TypedDict

from cmr.geometry.places import Point


class PathDocument(TypedDict):
    """Times and places of a robot while it was seen."""

    t: list[float]
    x: list[float]
    y: list[float]


class RobotDocument(TypedDict):
    """The measurements of one robot."""

    id: int
    kind: str
    behaviour: str
    distance_m: float | None
    waypoints: tuple[Point, ...]
    waypoints_left: int
    goal_reached_at_s: float | None
    path: PathDocument


class ProcessDocument(TypedDict):
    """The measurements of one process."""

    name: str
    command: list[str]
    starts: int
    ends: list[str]
    last_words: str
    loop_rate_hz: float | None
    overruns: int | None
    unreliable: bool
    message: str


class EventDocument(TypedDict):
    """An event of the run."""

    at_s: float
    words: str


class ObstaclesDocument(TypedDict):
    """Discs (x, y, radius) and walls (x1, y1, x2, y2)."""

    discs: tuple[tuple[float, float, float], ...]
    walls: tuple[tuple[float, float, float, float], ...]


class RunDocument(TypedDict):
    """The measurements of a run."""

    schema: int
    scenario: str
    about: str
    began: str
    seconds: float
    ended_by: str
    failed: bool
    seed: int
    metrics: dict[str, float]
    minimum_separation_m: float | None
    nearest_robots: list[int]
    nearest_at_s: float | None
    distance_driven_m: float | None
    waypoints_reached: bool
    worlds: int
    world_rate_hz: float | None
    unreliable: str
    overruns: int
    restarts: int
    obstacles: ObstaclesDocument
    geofence: tuple[Point, ...] | None
    robots: list[RobotDocument]
    processes: list[ProcessDocument]
    events: list[EventDocument]
