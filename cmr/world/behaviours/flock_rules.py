"""The three rules of a flock, and a border that turns robots back."""

import math

from cmr.model.compiled import compiled, inlined
from cmr.model.elementary import sincos
from cmr.world.behaviours.border import turned_back
from cmr.world.behaviours.team import Floats, Indices

AHEAD = 0.3  # m to the target point


@inlined
def _neighbours_of(i, near, start, end, x, y, speed_x, speed_y, distance):  # type: ignore[no-untyped-def]
    """Return the sums for cohesion, alignment and separation over a robot's neighbours, near[start:end].

    Each has two components: the sum of the vectors to them [m], the sum of their velocities [m/s], and the sum of the
    pushes [m] away from those nearer than `distance` [m].
    """
    mean_x, mean_y, flow_x, flow_y, apart_x, apart_y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(start, end):
        j = near[n]
        dx, dy = x[j] - x[i], y[j] - y[i]
        away = math.sqrt(dx * dx + dy * dy)
        mean_x, mean_y = mean_x + dx, mean_y + dy
        flow_x, flow_y = flow_x + speed_x[j], flow_y + speed_y[j]
        if 1e-9 < away < distance:
            push = (distance - away) / away
            apart_x, apart_y = apart_x - push * dx, apart_y - push * dy
    return mean_x, mean_y, flow_x, flow_y, apart_x, apart_y


@compiled(
    "void(i8[::1], i8[::1], i4[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[::1], f8[::1],"
    " f8[::1], f8[::1], f8[::1])"
)
def flock(  # type: ignore[no-untyped-def]
    me: Indices, start: Indices, near, x: Floats, y: Floats, speed_x: Floats, speed_y: Floats,
    theta: Floats, corners: Floats, weights: Floats, settings: Floats,
    target_x: Floats, target_y: Floats, speed: Floats,
):  # fmt: skip
    """Write targets [m] and speeds [m/s] of n robots with headings `theta` [rad].

    `me` (n,) are their indices in `x`, `y` [m], `speed_x`, `speed_y` [m/s], which hold everybody; the neighbours of
    robot i are near[start[i]:start[i + 1]]. `weights` are those of cohesion, alignment and separation, `settings`
    speed, distance and border. `corners` (2, m) are those of the geofence, or none; it wins over the three rules.
    """
    cruise, distance, border = settings
    for k in range(len(me)):
        i = me[k]
        target_x[k] = target_y[k] = speed[k] = 0.0
        if i < 0:
            continue
        mean_x, mean_y, flow_x, flow_y, apart_x, apart_y = _neighbours_of(
            i, near, start[i], start[i + 1], x, y, speed_x, speed_y, distance
        )
        sine, cosine = sincos(theta[k])
        wanted_x, wanted_y = cruise * cosine, cruise * sine
        count = start[i + 1] - start[i]
        if count:
            wanted_x += weights[0] * mean_x / count + weights[1] * (flow_x / count - speed_x[i])
            wanted_y += weights[0] * mean_y / count + weights[1] * (flow_y / count - speed_y[i])
            wanted_x, wanted_y = wanted_x + weights[2] * apart_x, wanted_y + weights[2] * apart_y
        if corners.shape[1]:
            wanted_x, wanted_y = turned_back(x[i], y[i], wanted_x, wanted_y, corners, border, cruise)
        wanted = math.sqrt(wanted_x * wanted_x + wanted_y * wanted_y)
        if wanted > 1e-9:
            target_x[k], target_y[k] = x[i] + AHEAD * wanted_x / wanted, y[i] + AHEAD * wanted_y / wanted
            speed[k] = min(wanted, cruise)
