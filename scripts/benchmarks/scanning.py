"""The row of the range sensor: the cost of a scan per robot."""

from collections.abc import Iterator

import numpy as np

from benchmarks.report import Row, per_robot
from benchmarks.timing import clocked, in_turns
from cmr.world.interaction.range_sensor import RangeSensor

ROBOTS = 1_000
AREA_PER_ROBOT = 4.0  # m^2
RADIUS = 0.1  # m
LONGEST = 4e-6  # s per robot


def scan() -> Iterator[Row]:
    """Measure a scan of each of many robots at random places, which sees the other robots."""
    random = np.random.default_rng(0)
    side = np.sqrt(ROBOTS * AREA_PER_ROBOT) / 2.0
    pose = np.vstack([random.uniform(-side, side, (2, ROBOTS)), random.uniform(-3.0, 3.0, ROBOTS)])
    discs, own, walls = np.vstack([pose[:2], np.full(ROBOTS, RADIUS)]), np.arange(ROBOTS), np.zeros((4, 0))
    sensor = RangeSensor()
    timing = in_turns({"scan": clocked(lambda: sensor.scan(pose, own, discs, walls))})["scan"]
    yield Row(
        f"scan of {ROBOTS:,} robots, {sensor.rays} rays, {sensor.reach:g} m",
        per_robot(timing, ROBOTS),
        goal=f"{LONGEST * 1e6:g} us",
        reached=timing.median / ROBOTS <= LONGEST,
    )
