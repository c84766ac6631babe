"""A crowd with contacts: robots that drive circles, so close together that some of them always touch.

Uses only the standard library, so that the peers, in their own environment, have the same crowd.
"""

import math
import random

APART = 1.0  # m between the centres of neighbouring circles, before they are shifted
SHIFT = 0.35  # m by which each start is shifted at random, at most, along x and along y
RADIUS = 0.1  # m, of a robot
SPEED = 0.3  # m/s
TURN_RATE = 0.6  # rad/s
WARM_UP = 300  # steps until the crowd is mixed


def crowd(robots: int) -> list[tuple[float, float, float]]:
    """Return where the robots start, and their headings [m, m, rad]."""
    chosen = random.Random(robots)
    columns = math.isqrt(robots - 1) + 1
    return [
        (
            APART * (i % columns) + chosen.uniform(-SHIFT, SHIFT),
            APART * (i // columns) + chosen.uniform(-SHIFT, SHIFT),
            chosen.uniform(-math.pi, math.pi),
        )
        for i in range(robots)
    ]
