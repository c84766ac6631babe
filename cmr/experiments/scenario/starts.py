"""Start poses of robots: one pose for one robot, a rule for many."""

from cmr.documents.document import Item
from cmr.geometry.figures import circle, grid, line
from cmr.geometry.places import Pose

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
