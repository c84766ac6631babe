"""Virtual robots appear in the picture where real ones would be, as large as those, behind those that are nearer."""

import math
from typing import Any

import cv2
import numpy as np
import pytest

from cmr.camera.drawing import Drawer, Waypoints
from cmr.camera.place import Place
from cmr.camera.tracks import REAL, SILENT, VIRTUAL, Shown, Tracks
from cmr.model.motion import RobotState
from cmr.world.view import TWIN, Robot, world_messages
from tests.support.camera_bench import CARRIED, lens_of
from tests.support.rendered_floor import Box, Eye, Scene

SIDE = Eye(640, 360, 460.0, (324.0, 177.0), position=(0.1, -2.0, 1.6))
PLACE = Place(SIDE.axes, np.array(SIDE.position))
EMPTY = Scene(SIDE, noise=0.0, blur=0.3)
DRAWER = Drawer(lens_of(SIDE), CARRIED)
T = 1_700_000_000_000_000  # us


def coloured(picture: Any) -> Any:
    return cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)


def changed(picture: Any, other: Any) -> Any:
    """Which pixels differ visibly."""
    return np.abs(picture.astype(int) - other.astype(int)).max(axis=2) > 12


def at(box: Box, robot_id: int = 10) -> Shown:
    return Shown(robot_id, box.x, box.y, box.theta, [])


@pytest.mark.parametrize("box", [Box(0.0, 0.0, 0.4, None), Box(-0.8, 0.5, 2.0, None), Box(0.9, -0.4, -1.2, None)])
def test_a_virtual_robot_covers_what_a_real_one_would(box: Box) -> None:
    floor = coloured(EMPTY.picture())
    virtual = changed(DRAWER.draw(floor, PLACE, [at(box)], []), floor)
    outline = SIDE.pixels(box.corners)
    hull = np.round(cv2.convexHull(outline.astype(np.float32))).astype(np.int32)
    true = cv2.fillConvexPoly(np.zeros(virtual.shape, np.uint8), hull, 1)
    ring = np.ones((3, 3), np.uint8)  # what is within 1.5 pixels
    assert virtual[cv2.erode(true, ring) > 0].all()
    assert not virtual[cv2.dilate(true, ring) == 0].any()
    v, u = np.nonzero(virtual)
    low, high = outline.min(axis=0), outline.max(axis=0)
    assert (u.min(), v.min()) == pytest.approx(tuple(low), abs=1.5)
    assert (u.max(), v.max()) == pytest.approx(tuple(high), abs=1.5)


def test_a_real_robot_hides_the_virtual_one_behind_it_and_not_the_one_before() -> None:
    real = Box(0.0, 0.0, 0.3, 0)
    picture = coloured(Scene(SIDE, noise=0.0, blur=0.3).picture([real]))
    behind, before = Box(0.05, 0.2, 0.0, None), Box(0.0, -0.22, 0.0, None)
    hull = cv2.convexHull(SIDE.pixels(real.corners).astype(np.float32))
    mask = cv2.fillConvexPoly(np.zeros(picture.shape[:2], np.uint8), np.round(hull).astype(np.int32), 1)
    inner = cv2.erode(mask, np.ones((5, 5), np.uint8)) > 0
    drawn = DRAWER.draw(picture, PLACE, [at(behind)], [(at(real, 0), CARRIED)])
    assert changed(drawn, picture).sum() > 300
    assert not changed(drawn, picture)[inner].any()
    assert changed(DRAWER.draw(picture, PLACE, [at(behind)], []), picture)[inner].any()  # nobody said it is there
    drawn = DRAWER.draw(picture, PLACE, [at(before)], [(at(real, 0), CARRIED)])
    assert changed(drawn, picture)[inner].sum() > 100


def test_trails_and_waypoints_lie_on_the_floor_under_real_robots() -> None:
    real = Box(0.0, 0.0, 0.3, 0)
    picture = coloured(Scene(SIDE, noise=0.0, blur=0.3).picture([real]))
    path = Waypoints([-0.6, 0.0, 0.6], [0.0, 0.0, 0.0])
    line = Shown(10, 9.0, 9.0, 0.0, [(-0.6, 0.3), (0.6, 0.3)])
    drawn = DRAWER.draw(picture, PLACE, [line], [(at(real, 0), CARRIED)], [path])
    places = np.array([(-0.6, 0, 0), (0, 0, 0.1), (0.6, 0, 0), (0, 0.3, 0)])
    first, middle, last, trail = [(round(u), round(v)) for u, v in SIDE.pixels(places).tolist()]
    for u, v in (first, last):
        blue, green, red = drawn[v, u].astype(int)
        assert red > blue + 100
        assert red > green + 100
    assert (drawn[middle[1], middle[0]] == picture[middle[1], middle[0]]).all()
    blue, _, red = drawn[trail[1], trail[0]].astype(int)
    assert blue > red + 50


@pytest.mark.parametrize("where", [(0.0, -9.0), (40.0, 0.0), (0.0, -2.0), (math.inf, 0.0), (1e9, 1e9)])
def test_what_is_outside_the_picture_changes_nothing(where: tuple[float, float]) -> None:
    floor = coloured(EMPTY.picture())
    assert (DRAWER.draw(floor, PLACE, [Shown(10, *where, 0.0, [where, where])], []) == floor).all()


# At the moment of the picture


def told(tracks: Tracks, utime: int, *robots: tuple[int, int, float, float]) -> None:
    states = [Robot(utime, i, origin, RobotState.at_rest(x, 0.0, theta)) for i, origin, x, theta in robots]
    for message in world_messages(utime, states):
        tracks.handle(utime, message)


def test_a_robot_is_shown_where_it_was_at_exposure() -> None:
    tracks = Tracks(1_000_000)
    told(tracks, T, (10, VIRTUAL, 0.0, 3.1), (3, REAL, 5.0, 0.0), (3, TWIN, 6.0, 0.0))
    told(tracks, T + 20_000, (10, VIRTUAL, 0.2, -3.1))
    (robot,) = tracks.at(T + 10_000, VIRTUAL)
    assert robot.x == pytest.approx(0.1)
    assert abs(math.remainder(robot.theta - math.pi, math.tau)) < 1e-6
    assert robot.trail == [(0.0, 0.0), pytest.approx((0.1, 0.0))]
    (robot,) = tracks.at(T + 30_000, VIRTUAL)  # newer than all that was told: on at its speed
    assert robot.x == pytest.approx(0.3)
    assert [robot.x for robot in tracks.at(T + 10_000, REAL)] == [5.0]


def test_a_robot_of_which_nothing_is_heard_is_shown_no_more() -> None:
    tracks = Tracks(100_000)
    told(tracks, T, (10, VIRTUAL, 0.0, 0.0))
    assert len(tracks.at(T + SILENT, VIRTUAL)) == 1
    assert tracks.at(T + SILENT + 1, VIRTUAL) == []
