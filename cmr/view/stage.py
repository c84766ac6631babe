"""The scene common to all visitors, drawn with viser."""

from collections.abc import Callable

import numpy as np
import viser

from cmr.geometry.obstacles import Geofence, Obstacles
from cmr.view import shapes
from cmr.view.picture import WAYPOINT_HEIGHT, Bodies, Lines, Picture

MANY = 2000  # objects of a kind; more are drawn in simplified shape
GHOST_OPACITY = 0.35
LABEL_COLOUR = (20, 20, 20)
OBSTACLE_COLOUR = (120, 120, 125)
OBSTACLE_HEIGHT = 0.12  # m, as drawn; they are taller
FENCE_COLOUR = (0, 0, 0)
PREDICTED_WIDTH = 0.012  # m
TRAIL_WIDTH, WAYPOINT_WIDTH, FENCE_WIDTH = 0.02, 0.01, 0.03  # m; trails are visible under waypoints
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
# Viser interprets colours of instances and single lines as linear, all others as sRGB.
LIGHT = np.round(255.0 * (np.arange(256) / 255.0) ** 2.2).astype(np.uint8)


class Instances:
    """Many objects of one shape; recreated when their number changes, otherwise moved.

    Very many use the `plain` shape, if given.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        mesh: shapes.Mesh,
        plain: shapes.Mesh | None = None,
        *,
        flat_shading: bool = False,
        opacity: float | None = None,
    ) -> None:
        self._scene, self._name, self._look = scene, name, (flat_shading, opacity)
        self._mesh, self._plain = mesh, plain or mesh
        self._handle: viser.BatchedMeshHandle | None = None
        self._on_click: Callable[[int, int], None] | None = None

    def show(self, bodies: Bodies) -> None:
        """Put them there."""
        count = len(bodies.position)
        if self._handle is None or len(self._handle.batched_positions) != count:
            self._make(bodies)
            return
        self._handle.batched_positions = bodies.position.astype(np.float32)
        self._handle.batched_wxyzs = bodies.wxyz.astype(np.float32)
        self._handle.batched_colors = LIGHT[bodies.colour]

    def on_click(self, call: Callable[[int, int], None]) -> None:
        """Call back with the visitor's id and the index of the clicked object."""
        self._on_click = call

    def _make(self, bodies: Bodies) -> None:
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        if not len(bodies.position):
            return
        vertices, faces = self._plain if len(bodies.position) > MANY else self._mesh
        self._handle = self._scene.add_batched_meshes_simple(
            self._name,
            vertices,
            faces,
            bodies.wxyz,
            bodies.position,
            batched_colors=LIGHT[bodies.colour],
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
            flat_shading=self._look[0],
            opacity=self._look[1],
        )
        if self._on_click is not None:
            self._handle.on_click(self._clicked)

    def _clicked(self, event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
        if self._on_click is not None and event.instance_index is not None:
            self._on_click(event.client_id, event.instance_index)


class LineSet:
    """Lines that are drawn again when they change."""

    def __init__(self, scene: viser.SceneApi, name: str, width: float) -> None:
        self._scene, self._name, self._width = scene, name, width
        self._shown: Lines | None = None
        self._handle: viser.LineSegmentsHandle | None = None

    def show(self, lines: Lines) -> None:
        """Draw these, replacing the previous ones."""
        if self._shown is not None and np.array_equal(self._shown.ends, lines.ends):
            return
        self._shown = lines
        if len(lines.ends):
            self._handle = self._scene.add_line_segments(
                self._name, lines.ends, LIGHT[lines.colour], thickness=self._width
            )
        elif self._handle is not None:
            self._handle.remove()
            self._handle = None


class Stage:
    """Floor, robots with their ids, ghosts, waypoints, geofence and obstacles."""

    def __init__(self, scene: viser.SceneApi, obstacles: Obstacles, geofence: Geofence | None) -> None:
        scene.configure_environment_map(None)  # its reflections would wash out the colours
        scene.configure_default_lights(cast_shadow=False)
        scene.add_light_ambient("/light", intensity=1.5)  # so that no side of a robot is black
        scene.add_grid(
            "/floor", infinite_grid=True, cell_size=0.5, section_size=1.0, cell_color=(228, 228, 228),
            section_color=(200, 200, 200), fade_distance=60.0,
        )  # fmt: skip
        robot, plain = shapes.robot(), shapes.plain_robot()
        self.robots = Instances(scene, "/robots", robot, plain, flat_shading=True)
        self._ghosts = Instances(scene, "/twins", robot, plain, flat_shading=True, opacity=GHOST_OPACITY)
        self._digits = [Instances(scene, f"/ids/{value}", shapes.digit(value)) for value in range(10)]
        self._waypoints = LineSet(scene, "/waypoints", WAYPOINT_WIDTH)
        self._predicted = LineSet(scene, "/predicted", PREDICTED_WIDTH)
        _add_room(scene, obstacles, geofence)

    def show(self, picture: Picture) -> None:
        """Draw the moment."""
        self.robots.show(picture.solid)
        self._ghosts.show(picture.ghosts)
        for digit, places in zip(self._digits, picture.digits, strict=True):
            digit.show(_upright(places, LABEL_COLOUR))
        self._waypoints.show(picture.waypoints)
        self._predicted.show(picture.predicted)


def _upright(places: shapes.Floats, colour: tuple[int, int, int]) -> Bodies:
    count = len(places)
    return Bodies(places, np.tile(UPRIGHT, (count, 1)), np.full((count, 3), colour, np.uint8))


def _add_room(scene: viser.SceneApi, obstacles: Obstacles, geofence: Geofence | None) -> None:
    """Draw the static objects."""
    for k, (x, y, radius) in enumerate(obstacles.discs.T.tolist()):
        vertices, faces = shapes.cylinder(radius, OBSTACLE_HEIGHT)
        scene.add_mesh_simple(
            f"/obstacles/disc_{k}", vertices, faces, color=OBSTACLE_COLOUR, flat_shading=True, position=(x, y, 0.0)
        )
    for k, wall in enumerate(obstacles.walls.T):
        (x1, y1), (x2, y2) = wall[:2], wall[2:]
        low, high = np.array([[x1, y1, 0.0], [x2, y2, 0.0]]), np.array([[x2, y2, 1.0], [x1, y1, 1.0]])
        vertices = np.concatenate([low, high * (1.0, 1.0, OBSTACLE_HEIGHT)])
        faces = np.array([(0, 1, 2), (0, 2, 3)])
        scene.add_mesh_simple(f"/obstacles/wall_{k}", vertices, faces, color=OBSTACLE_COLOUR, side="double")
    if geofence is not None:
        ends = shapes.at_height(shapes.closed(geofence.outline.T), WAYPOINT_HEIGHT)
        scene.add_line_segments("/geofence", ends, FENCE_COLOUR, thickness=FENCE_WIDTH)
