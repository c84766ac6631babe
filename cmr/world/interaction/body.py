"""How large robots are taken to be where nobody says so."""

from typing import Any

# Half the base width, and 30 % more: a body reaches beyond its wheels. Radius over base width, by their data sheets:
# TurtleBot3 Burger 0.105 / 0.160 m, e-puck 0.035 / 0.053 m, Khepera IV 0.070 / 0.105 m.
RADIUS_PER_BASE_WIDTH = 0.65


def body_radius(base_width: Any) -> Any:
    """Return the radius [m] of the disc that a robot of this base width [m] is taken for."""
    return RADIUS_PER_BASE_WIDTH * base_width
