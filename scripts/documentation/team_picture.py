"""Run a team of real and virtual robots with a camera over the floor, for a picture of the page of cmr-view.

The real robots are emulated. The camera's picture of the floor with the real robots is rendered, and the virtual robots
are drawn into it.
"""

import math
import subprocess
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from cmr.bus.messages import decode, make
from cmr.bus.streams import CAMERA_IMAGE, WAYPOINTS, WORLD_STATE, identify
from cmr.camera.drawing import Drawer, Picture, Waypoints
from cmr.camera.place import Place
from cmr.camera.tracks import REAL, VIRTUAL, Tracks
from cmr.msg import camera_image_t, waypoints_t, world_state_t
from cmr.processes.children import our_command
from cmr.recordings.events import Event, EventReader, event_bytes
from tests.support.camera_bench import CARRIED, lens_of
from tests.support.rendered_floor import Box, Eye, Scene, Sheet

DRIVEN = 10_000_000  # us of the leader's drive before the picture
LEADER, SET_OFF = 10, 0.02  # m from its start
TRAIL = 4_000_000  # us, in the camera's picture
SCENARIO = """
about: A wedge of six behind a virtual leader; three of them are real (here emulated)
duration: 25
seed: 3
parameters: {parameters}
reaction: 0.03
geofence: [[-3.2, -2.4], [3.2, -2.4], [3.2, 3.2], [-3.2, 3.2]]
robots:
  - id: 10
    kind: virtual
    behaviour: waypoints,speed=0.25
    waypoints: [[1.6, 0.0], [2.2, 0.6], [2.2, 1.6], [1.6, 2.2], [-0.5, 2.2]]
  - {{id: 0, kind: emulated, start: [-0.5, 0.5], behaviour: &place "{place}"}}
  - {{id: 1, kind: emulated, start: [-0.5, -0.5], behaviour: *place}}
  - {{id: 2, kind: emulated, start: [-1.0, 1.0], behaviour: *place}}
  - {{count: 3, first_id: 11, kind: virtual, start: [[-1.0, -1.0], [-1.5, 1.5], [-1.5, -1.5]], behaviour: *place}}
"""
PLACE = "formation,leader=10,shape=wedge,spacing=0.6,members=0:1:2:11:12:13"
EYE = Eye(position=(0.6, -2.6, 3.0), looks_at=(0.9, 0.7, 0.0))
TAGS = tuple(
    Sheet(number, x, y, 0.0) for number, x, y in ((8, -1.0, -1.0), (9, 2.6, -0.8), (10, 2.8, 2.4), (11, -0.8, 2.4))
)


def drive_team(folder: Path, parameters: Path) -> tuple[Path, Path]:
    """Run the team for half a minute; return the file of its scenario, and its log."""
    scenario = folder / "team.yaml"
    scenario.write_text(SCENARIO.format(parameters=parameters, place=PLACE))
    subprocess.run([our_command("cmr-run"), scenario, "--out", folder / "team"], check=True)
    return scenario, folder / "team" / "run.lcm"


def with_camera(log: Path, path: Path) -> float:
    """Write a copy of a log with one picture of the camera added; return its time after the log's beginning [s]."""
    events = list(EventReader(log))
    moment = next(event.utime for event in events if _has_set_off(event)) + DRIVEN
    seen = [event for event in events if event.utime <= moment]
    picture = _picture(seen)
    _, jpeg = cv2.imencode(".jpg", picture)
    height, width = picture.shape[:2]
    utime = seen[-1].utime
    image = make(camera_image_t, utime=utime, camera="ceiling", width=width, height=height, jpeg=jpeg.tobytes())
    taken = Event(seen[-1].number, utime, CAMERA_IMAGE.name, image.encode())
    path.write_bytes(b"".join(map(event_bytes, [*seen, taken, *events[len(seen) :]])))
    return (utime - events[0].utime) * 1e-6 + 0.02  # just after the picture


def _has_set_off(event: Event) -> bool:
    """Return whether this is a world state in which the leader has left its start, the origin."""
    if event.channel != WORLD_STATE.name:
        return False
    world = decode(event.channel, event.data).message_of(WORLD_STATE)
    return world is not None and any(
        math.hypot(x, y) > SET_OFF for who, x, y in zip(world.robot_id, world.x, world.y, strict=True) if who == LEADER
    )


def _picture(seen: Iterable[Event]) -> Picture:
    """Return the camera's picture at the time of the last event, with the virtual robots and their waypoints."""
    tracks, utime = Tracks(TRAIL), 0
    ways: dict[int, waypoints_t] = {}
    for event in seen:
        stream, _ = identify(event.channel) or (None, None)
        if stream not in (WORLD_STATE, WAYPOINTS):
            continue
        message = decode(event.channel, event.data).message
        if isinstance(message, world_state_t):
            utime = event.utime
            tracks.handle(utime, message)
        elif isinstance(message, waypoints_t):
            ways[message.robot_id] = message
    real = [(shown, CARRIED) for shown in tracks.at(utime, REAL)]
    boxes = [Box(shown.x, shown.y, shown.theta, shown.robot_id) for shown, _ in real]
    grey = Scene(EYE, TAGS).picture(boxes)
    floor = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
    place = Place(EYE.axes, np.array(EYE.position))
    virtual = tracks.at(utime, VIRTUAL)
    return Drawer(lens_of(EYE), CARRIED).draw(
        floor, place, virtual, real, [Waypoints(list(way.x), list(way.y)) for way in ways.values()]
    )
