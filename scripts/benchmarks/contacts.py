"""Rows of the physics of cmr-sim: the step, the search for neighbours, and the resolution of contacts."""

from collections.abc import Iterator

import numpy as np

from benchmarks.crowd import RADIUS, SPEED, TURN_RATE, WARM_UP, crowd
from benchmarks.drive import EPOCH, TRUTH
from benchmarks.report import Point, Row, per_robot
from benchmarks.timing import clocked, in_turns
from cmr.model.motion import RobotState
from cmr.world.fleet import STEP, Fleet
from cmr.world.interaction.neighbours import pairs_within
from cmr.world.view import VIRTUAL

ROBOTS = (100, 1_000, 10_000)
TIMES_REAL_TIME = 20.0  # goal for the largest number of robots
TOUCHING = 1e-3  # m of distance at which robots count as touching
SERIES = "CMR, contacts"


class Crowd:
    """The crowd of `crowd`, moved by CMR's physics; every robot drives its circle repeatedly."""

    def __init__(self, count: int) -> None:
        x, y, theta = np.array(crowd(count)).T
        self._fleet = Fleet(radius=dict.fromkeys(range(count), RADIUS))
        self._fleet.place([(robot_id, VIRTUAL) for robot_id in range(count)], RobotState.at_rest(x, y, theta), TRUTH)
        turning = 0.5 * TURN_RATE * TRUTH.base_width
        duties = [(SPEED + sign * turning) * TRUTH.k1 / TRUTH.wheel_radius for sign in (-1.0, 1.0)]
        self._fleet.command(0, [duties] * count)
        self._utime = EPOCH
        for _ in range(WARM_UP):
            self.advance()

    def advance(self) -> None:
        """Advance by one step."""
        self._utime += STEP
        assert self._fleet.advance(self._utime)

    def touching(self) -> int:
        """Return how many pairs of robots touch."""
        state = self._fleet.robots().state
        return len(pairs_within(state.x, state.y, 2.0 * RADIUS + TOUCHING).index) // 2


def contacts() -> Iterator[Row]:
    """Measure physics with contacts as times real time."""
    for count in ROBOTS:
        world = Crowd(count)
        timing = in_turns({"ours": clocked(world.advance)})["ours"]
        times = STEP * 1e-6 / timing.median
        has_goal = count == ROBOTS[-1]
        yield Row(
            f"physics with neighbours and contacts, {count:,} robots, {world.touching()} pairs touching",
            per_robot(timing, count),
            f"{times:,.0f} times real time at 100 Hz",
            f"{TIMES_REAL_TIME:g} times real time" if has_goal else "-",
            times >= TIMES_REAL_TIME if has_goal else None,
            Point(SERIES, count, timing.median),
        )
