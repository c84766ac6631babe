"""A flock: keep together, go the same way, do not crowd.

Source: Reynolds, Flocks, herds and schools: a distributed behavioral model, SIGGRAPH 1987.
"""

import numpy as np

from cmr.world.behaviours.seeking import CLEARANCE, Goals, Seeker, Team, corners_of, wheel_radius_of
from cmr.world.lazy_module import LazyModule
from cmr.world.view import Robots, WorldView

flock_rules = LazyModule("cmr.world.behaviours.flock_rules")


class Flock(Seeker):
    """Roam at `speed` [m/s] as a flock with all real and virtual robots within `radius` [m].

    `cohesion` [1/s] pulls towards their middle, `alignment` [1] towards their velocity, `separation` [1/s] away from
    those nearer than `distance` [m]. Where the world has a geofence, robots turn back within `border` [m] of it.
    """

    def __init__(
        self,
        speed: float = 0.3,
        radius: float = 1.0,
        distance: float = 0.5,
        cohesion: float = 0.2,
        alignment: float = 0.8,
        separation: float = 1.0,
        border: float = 0.5,
        clearance: float = CLEARANCE,
    ) -> None:
        super().__init__(speed, clearance)
        if not 0.0 < distance <= radius <= 100.0 or not border > 0.0:
            raise ValueError("distance must be above 0 up to radius, radius at most 100, border above 0")
        if min(cohesion, alignment, separation) < 0.0:
            raise ValueError("cohesion, alignment and separation must be 0 or more")
        self.radius, self.distance, self.border = radius, distance, border
        self.weights = np.array([cohesion, alignment, separation])

    def goals(self, _utime: int, team: Team, _me: Robots, world: WorldView) -> Goals:
        """Return points in the direction that the flock's three rules and the border give."""
        around = world.surroundings()
        near = around.neighbours(self.radius)
        target_x, target_y, speed = np.empty((3, len(team.row)))
        speed_x, speed_y = around.velocities(wheel_radius_of(team))
        settings = np.array([self.speed, self.distance, self.border])
        flock_rules.flock(
            *(team.place, near.start, near.index, around.x, around.y, speed_x, speed_y, team.theta),
            *(corners_of(world), self.weights, settings, target_x, target_y, speed),
        )
        return Goals(target_x, target_y, speed, np.ones(len(speed), bool))
