"""A crowd with contacts: robots that drive circles, so close together that some of them always touch.

Uses only the standard library, so that the peers can simulate the same crowd in their own environment.
"""

import math
import random

APART = 1.0  # m between the centres of neighbouring circles, before the shift
SHIFT = 0.35  # m; largest random shift of each start, along x and along y
RADIUS = 0.1  # m, of a robot
SPEED = 0.3  # m/s
TURN_RATE = 0.6  # rad/s
WARM_UP = 300  # steps until the crowd is mixed


def crowd(robots: int) -> list[tuple[float, float, float]]:
    """Return the starts of the robots: x, y and heading [m, m, rad]."""
    rng = random.Random(robots)
    columns = math.isqrt(robots - 1) + 1
    return [
        (
            APART * (i % columns) + rng.uniform(-SHIFT, SHIFT),
            APART * (i // columns) + rng.uniform(-SHIFT, SHIFT),
            rng.uniform(-math.pi, math.pi),
        )
        for i in range(robots)
    ]
