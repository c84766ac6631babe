"""Where robots start: one pose for one robot, a rule for many."""

import math

from cmr.documents.document import Item
from cmr.scenario.plan import Pose

RULES = ("line", "grid", "circle")
DEFAULT_SPACING = 0.5  # m
LEAST_SPACING = 0.01  # m


def starts_of(item: Item | None, count: int, *, many: bool) -> list[Pose]:
    """Return the start of each robot.

    One robot has `[x, y, theta]`, `[x, y]` or `{x:, y:, theta:}`; many have `{rule:, spacing:, x:, y:, theta:}`, or
    a list of as many poses.
    """
    if not many:
        return [_pose(item)]
    if item is None:
        return line(count, DEFAULT_SPACING, Pose(0.0, 0.0))
    if item.is_list:
        poses = [_pose(entry) for entry in item.items()]
        if len(poses) != count:
            raise item.place.error(f"has {len(poses)} poses for {count} robots")
        return poses
    section = item.section(("rule", "spacing", "x", "y", "theta"))
    spacing = section.get("spacing")
    rule = section.need("rule", f"how they stand: {', '.join(RULES)}").word(RULES)
    x, y, theta = (entry.number() if (entry := section.get(key)) else 0.0 for key in Pose._fields)
    make = {"line": line, "grid": grid, "circle": circle}[rule]
    return make(count, spacing.number(LEAST_SPACING) if spacing else DEFAULT_SPACING, Pose(x, y, theta))


def _pose(item: Item | None) -> Pose:
    if item is None:
        return Pose(0.0, 0.0)
    if item.is_list:
        numbers = item.numbers("x y theta" if len(item.items()) == 3 else "x y")
        return Pose(*numbers)
    section = item.section(Pose._fields)
    return Pose(*(entry.number() if (entry := section.get(key)) else 0.0 for key in Pose._fields))


def line(count: int, spacing: float, first: Pose) -> list[Pose]:
    """Return poses one behind the other, `spacing` [m] apart, all with the heading of the first."""
    dx, dy = math.cos(first.theta) * spacing, math.sin(first.theta) * spacing
    return [Pose(first.x - k * dx, first.y - k * dy, first.theta) for k in range(count)]


def grid(count: int, spacing: float, centre: Pose) -> list[Pose]:
    """Return poses in rows and columns `spacing` [m] apart about a centre, which stays free.

    Their number is even, so that the nearest stand 0.7 spacings from the centre. All have its heading.
    """
    columns = math.ceil(math.sqrt(count))
    columns += columns % 2
    middle = (columns - 1) / 2.0
    return [
        Pose(centre.x + (k % columns - middle) * spacing, centre.y + (k // columns - middle) * spacing, centre.theta)
        for k in range(count)
    ]


def circle(count: int, spacing: float, centre: Pose) -> list[Pose]:
    """Return poses on a circle, neighbours `spacing` [m] apart, each headed `theta` to the left of outwards.

    The circle has a radius of one spacing at least; the first robot stands in the direction of x.
    """
    radius = spacing if count < 3 else max(spacing / (2.0 * math.sin(math.pi / count)), spacing)
    bearings = [2.0 * math.pi * k / count for k in range(count)]
    return [Pose(centre.x + radius * math.cos(b), centre.y + radius * math.sin(b), b + centre.theta) for b in bearings]
