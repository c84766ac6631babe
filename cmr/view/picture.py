"""A renderer-independent description of the scene, as arrays."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.bus.streams import RANGE_SCAN, WAYPOINTS
from cmr.msg import investigation_status_t, range_scan_t
from cmr.report.colours import REAL_COLOUR
from cmr.view import shapes
from cmr.view.data.robots import REAL, TWIN, VIRTUAL, Integers, Robots
from cmr.view.data.state import ViewState
from cmr.view.data.trails import Trail

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of a colour such as #f2b705."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


YELLOW = rgb(REAL_COLOUR)
BLUE = (70, 140, 245)  # black digits are legible on it
RED = (214, 40, 40)
GREEN = (0, 158, 115)  # distinguishable with red-green colour blindness
PURPLE, LILAC = (110, 40, 160), (190, 150, 220)  # likeliest predicted path, and others
GREY = (180, 180, 210)  # robots without recent messages
COLOURS = {REAL: YELLOW, VIRTUAL: BLUE, TWIN: GREEN}
TRAIL_COLOURS = {REAL: YELLOW, VIRTUAL: BLUE, TWIN: GREEN}
MOST_LABELLED = 3000  # robots; with more only real ones are labelled
LABEL_HEIGHT = shapes.CLEARANCE + shapes.HEIGHT + 0.002  # m
TRAIL_HEIGHT, WAYPOINT_HEIGHT, RAY_HEIGHT = 0.006, 0.012, 0.05  # m
PREDICTED_HEIGHT = LABEL_HEIGHT + 0.002  # m; above the robots, which would hide short paths
RAY_COLOURS = (245, 235, 242), (214, 60, 170)  # at the sensor, where hundreds of rays meet, and at their ends


class Bodies(NamedTuple):
    """Robots to draw: positions (n, 3) [m], quaternions (n, 4), colours (n, 3)."""

    position: Floats
    wxyz: Floats
    colour: Bytes


class Lines(NamedTuple):
    """Lines: both ends of each (n, 2, 3) [m] with their colours (n, 2, 3)."""

    ends: Floats
    colour: Bytes


@dataclass(frozen=True)
class Picture:
    """Everything that moves and is common to all visitors.

    Solid robots with their ids, ghosts (twins), positions of each of the ten digits (n, 3) [m], waypoints, and
    predicted paths of investigations.
    """

    solid: Bodies
    solid_ids: Integers
    ghosts: Bodies
    digits: tuple[Floats, ...]
    waypoints: Lines
    predicted: Lines


def picture_of(state: ViewState) -> Picture:
    """Return the current scene."""
    robots = state.present()
    is_twin = robots.origin == TWIN
    return Picture(
        bodies(robots, ~is_twin),
        robots.robot_id[~is_twin],
        bodies(robots, is_twin),
        digits(robots),
        waypoints(state, robots),
        predicted(state, robots),
    )


def bodies(robots: Robots, chosen: NDArray[np.bool_]) -> Bodies:
    """Return bodies to draw for some robots."""
    x, y, theta = robots.pose[:, chosen]
    colours = np.zeros((3, 3), np.uint8)
    for origin, colour in COLOURS.items():
        colours[origin] = colour
    of_each = colours[np.clip(robots.origin[chosen], 0, 2)]
    of_each[robots.silent[chosen]] = GREY
    return Bodies(np.stack([x, y, np.zeros(len(x))], axis=1), shapes.turned(theta), of_each)


def digits(robots: Robots) -> tuple[Floats, ...]:
    """Return the positions of each digit from 0 to 9, so that every robot except twins carries its id."""
    labelled = robots.origin == REAL if len(robots.origin) > MOST_LABELLED else robots.origin != TWIN
    ids, (x, y, _) = robots.robot_id[labelled], robots.pose[:, labelled]
    counts = np.maximum(np.floor(np.log10(np.maximum(ids, 1) + 0.5)).astype(np.int64) + 1, 1)
    found: list[list[Floats]] = [[] for _ in range(10)]
    for place in range(int(counts.max(initial=0))):  # from the last digit on
        number = ids // 10**place % 10
        # Centred over the robot: the last of k digits is (k - 1) / 2 pitches to the right.
        across = x + ((counts - 1) / 2 - place) * shapes.DIGIT_PITCH
        for value in range(10):
            here = (number == value) & (counts > place)
            found[value].append(np.stack([across[here], y[here], np.full(here.sum(), LABEL_HEIGHT)], axis=1))
    return tuple(np.concatenate(parts) if parts else np.empty((0, 3)) for parts in found)


def trails(trail: Trail) -> Lines:
    """Return trails in the colours of their robots."""
    colours = np.zeros((4, 3), np.uint8)
    for origin, colour in TRAIL_COLOURS.items():
        colours[origin] = colour
    chosen = colours[np.clip(trail.origin, 0, 3)]
    return Lines(shapes.at_height(trail.ends, TRAIL_HEIGHT), np.repeat(chosen[:, np.newaxis], 2, axis=1))


def waypoints(state: ViewState, robots: Robots) -> Lines:
    """Return the waypoints of robots, red, with a mark at each end; robots that have left have none."""
    parts = [np.empty((0, 2, 2))]
    there = set(robots.robot_id.tolist())
    for waypoints in (state.newest(WAYPOINTS, robot_id) for robot_id in state.latest[WAYPOINTS.name].keys() & there):
        points = _finite(np.array([waypoints.x, waypoints.y], float).T) if waypoints else np.empty((0, 2))
        if len(points):
            parts += [shapes.chain(points), shapes.circle(float(points[-1, 0]), float(points[-1, 1]), 0.04, 12)]
    return _of_one_colour(shapes.at_height(np.concatenate(parts), WAYPOINT_HEIGHT), RED)


def predicted(state: ViewState, robots: Robots) -> Lines:
    """Return predicted paths of investigated robots, the likeliest on top."""
    there = set(robots.robot_id.tolist())
    ends, colours = [np.empty((0, 2, 3))], [np.empty((0, 2, 3), np.uint8)]
    for history in (state.investigations[robot_id] for robot_id in state.investigations.keys() & there):
        message = history[-1].message
        for member, path in reversed(list(enumerate(_paths(message)))):
            lines = shapes.at_height(shapes.chain(path), PREDICTED_HEIGHT + (0.002 if member == 0 else 0.0))
            ends.append(lines)
            colours.append(np.full(lines.shape, LILAC if member else PURPLE, np.uint8))
    return Lines(np.concatenate(ends), np.concatenate(colours))


def _paths(message: investigation_status_t) -> list[Floats]:
    """Return the predicted paths, each (n, 2) [m], the likeliest robot's first."""
    if message.members < 1 or message.n % message.members:
        return []
    points = np.array([message.x, message.y], float).T
    return [_finite(part) for part in np.split(points, message.members)]


def rays(state: ViewState, robot_id: int) -> Lines:
    """Return the last scan of a robot's range sensor; empty without one."""
    message, place = state.newest(RANGE_SCAN, robot_id), state.present().place(robot_id)
    if message is None or place is None:
        return _of_one_colour(np.empty((0, 2, 3)), RED)
    ends = shapes.at_height(_ray_ends(message, place), RAY_HEIGHT)
    return Lines(ends, np.broadcast_to(np.array(RAY_COLOURS, np.uint8), ends.shape))


def _ray_ends(scan: range_scan_t, place: tuple[float, float, float]) -> Floats:
    x, y, theta = place
    ranges = np.asarray(scan.ranges, float)
    angles = theta + scan.angle_first + scan.angle_step * np.arange(len(ranges))
    hits = np.isfinite(ranges) & (ranges > 0.0)  # rays without a hit are not drawn: they would hide the rest
    far = np.stack([x + ranges[hits] * np.cos(angles[hits]), y + ranges[hits] * np.sin(angles[hits])], axis=1)
    return np.stack([np.broadcast_to((x, y), far.shape), far], axis=1)


def _finite(points: Floats) -> Floats:
    return points[np.isfinite(points).all(axis=1)]


def _of_one_colour(ends: Floats, colour: tuple[int, int, int]) -> Lines:
    return Lines(ends, np.full(ends.shape, colour, np.uint8))
