"""Bounds on the numbers in messages. A message with an impossible number is refused, or loses that number.

The bounds are generous: they hold for any robot of this kind, indoors or outdoors.
"""

import copy
import math
from collections.abc import Callable, Mapping
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from cmr import msg
from cmr.bus.message import Message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Bound(NamedTuple):
    """The range of a number. A `dispensable` one may be NaN (not measured), and is set to NaN if impossible."""

    lowest: float
    highest: float
    dispensable: bool = False


def within(size: float) -> Bound:
    """Return the symmetric bound [-size, size]."""
    return Bound(-size, size)


POSITION = within(2e7)  # m; half way round the Earth
HEADING = within(1e5)  # rad; of a tracker that counts turns
WHEEL_SPEED = within(1e4)  # rad/s
MEASURED_WHEEL_SPEED = within(200.0)  # rad/s; the limit of robot_driver.encoders
WHEEL_ACCELERATION = within(1e7)  # rad/s^2; of a simulated wheel that is stopped within a step
YAW_RATE = within(100.0)  # rad/s; gyros measure up to 35
DUTY = within(1.0)
SPEED = within(100.0)  # m/s
SENT_DUTY, CURRENT, VOLTAGE = Bound(-1.0, 1.0, True), Bound(-500.0, 500.0, True), Bound(-1.0, 1e3, True)  # duty, A, V
TEMPERATURE = Bound(-100.0, 500.0, True)  # deg C
COUNT = within(2.0**53)  # ticks; above this, floats cannot represent every integer
RATE, TURNS = Bound(0.0, 1e6), Bound(0.0, 2.0**53)  # Hz of a loop, and how many of its turns were late
STATE = {
    "x": POSITION,
    "y": POSITION,
    "theta": HEADING,
    "psi_left": WHEEL_SPEED,
    "psi_right": WHEEL_SPEED,
    "domega_left": WHEEL_ACCELERATION,
    "domega_right": WHEEL_ACCELERATION,
}
BOUNDS: Mapping[type[Message], Mapping[str, Bound]] = {
    msg.pose_xyt_t: {"x": POSITION, "y": POSITION, "theta": HEADING},
    msg.gyro_t: {"yaw_rate": YAW_RATE},
    msg.motor_feedback_t: {
        "ticks_left": COUNT,
        "ticks_right": COUNT,
        "psi_left": MEASURED_WHEEL_SPEED,
        "psi_right": MEASURED_WHEEL_SPEED,
        "applied_left": SENT_DUTY,
        "applied_right": SENT_DUTY,
        "current_left": CURRENT,
        "current_right": CURRENT,
        "battery_voltage": VOLTAGE,
        "temperature": TEMPERATURE,
    },
    msg.motor_duty_t: {"sent_left": DUTY, "sent_right": DUTY},
    msg.robot_state_t: STATE,
    msg.world_state_t: STATE,
    msg.waypoints_t: {"x": POSITION, "y": POSITION},
    msg.investigation_status_t: {"x": POSITION, "y": POSITION},
    msg.motor_command_t: {"left": DUTY, "right": DUTY},
    msg.wheel_speed_command_t: {"psi_left": WHEEL_SPEED, "psi_right": WHEEL_SPEED},
    msg.velocity_command_t: {"v": SPEED, "omega": YAW_RATE},
    msg.process_status_t: {"loop_rate_hz": RATE, "loop_overruns": TURNS},
}
# Further stamps in messages, and what replaces an impossible one: None for the message's own stamp, 0 for unknown.
STAMPS: Mapping[type[Message], Mapping[str, int | None]] = {
    msg.motor_feedback_t: {"received_utime": None, "applied_utime": 0},
    msg.gyro_t: {"received_utime": None},
}
STAMPED_WITHIN = 60_000_000  # us from the message's own stamp: imported logs may mix two clocks
NOT_FINITE, IMPOSSIBLE = "not finite", "impossible"
LONGEST_LEG = 200.0  # m between two waypoints, or a robot and its first one
OUT_OF_REACH = f"a leg of more than {LONGEST_LEG:g} m"


class Screened(NamedTuple):
    """The usable part of a message, None if there is none, and what was wrong with it, such as `x not finite`."""

    message: Message | None
    reasons: tuple[str, ...] = ()


def screened(message: Message) -> Screened:
    """Remove impossible numbers from a message; return a changed copy, or the message itself if nothing is wrong.

    From a world_state_t, robots with such numbers are removed.
    """
    if isinstance(message, msg.world_state_t):
        return _of_a_world(message)
    if isinstance(message, msg.waypoints_t):
        return _of_a_path(message)
    if isinstance(message, msg.investigation_status_t):
        reasons = _wrong_with_places(message)
        return Screened(None if reasons else message, reasons)
    bounds = BOUNDS.get(type(message))
    if bounds is None or (isinstance(message, msg.gyro_t) and not message.valid):
        return Screened(message)
    for read, bound in _numbers_of(type(message)):
        value = read(message)
        if not bound.lowest <= value <= bound.highest and not (bound.dispensable and math.isnan(value)):
            mended = _mended(message, bounds)
            return mended if mended.message is None else _stamped(mended.message, mended.reasons)
    return _stamped(message)


def is_out_of_reach(path: msg.waypoints_t, x: float, y: float) -> bool:
    """Return whether a path begins too far away from a robot at (x, y) [m]."""
    return path.n > 0 and math.hypot(path.x[0] - x, path.y[0] - y) > LONGEST_LEG


@cache
def _numbers_of(message_type: type[Any]) -> list[tuple[Callable[[Message], float], Bound]]:
    """Return a reader for each number that has a bound, and the bound."""
    return [(attrgetter(name), bound) for name, bound in BOUNDS[message_type].items()]


def _mended(message: Message, bounds: Mapping[str, Bound]) -> Screened:
    """Return a faulty message with its impossible dispensable numbers removed, or None if others are impossible."""
    mended, reasons, usable = copy.copy(message), [], True
    for name, bound in bounds.items():
        value = getattr(message, name)
        if bound.lowest <= value <= bound.highest or (bound.dispensable and math.isnan(value)):
            continue
        reasons.append(f"{name} {IMPOSSIBLE if math.isfinite(value) else NOT_FINITE}")
        setattr(mended, name, math.nan)
        usable &= bound.dispensable
    return Screened(mended if usable else None, tuple(reasons))


def _stamped(message: Message, reasons: tuple[str, ...] = ()) -> Screened:
    """Replace stamps far from the message's own stamp; append what was wrong to `reasons`."""
    stamps = STAMPS.get(type(message), {})
    wrong = [name for name in stamps if getattr(message, name) != 0 and _is_far(getattr(message, name), message.utime)]
    if not wrong:
        return Screened(message, reasons)
    mended = copy.copy(message)
    for name in wrong:
        instead = stamps[name]
        setattr(mended, name, message.utime if instead is None else instead)
    return Screened(mended, (*reasons, *(f"{name} {IMPOSSIBLE}" for name in wrong)))


def _is_far(stamp: int, own: int) -> bool:
    return abs(stamp - own) > STAMPED_WITHIN


def _of_a_world(message: msg.world_state_t) -> Screened:
    import numpy as np  # a robot's own computer need not have NumPy

    from cmr.bus.world_state import WorldState

    state = np.array([getattr(message, name) for name in STATE], dtype=float)
    possible, reasons = _possible(state, STATE)
    if not reasons:
        return Screened(message)
    if not possible.any():
        return Screened(None, reasons)
    ids, origins = np.asarray(message.robot_id, np.int64)[possible], np.asarray(message.origin, np.int64)[possible]
    return Screened(WorldState(message.utime, ids, origins, *state[:, possible]), reasons)


def _of_a_path(message: msg.waypoints_t) -> Screened:
    import numpy as np

    reasons = _wrong_with_places(message)
    if not reasons and message.n > 1 and np.hypot(np.diff(message.x), np.diff(message.y)).max() > LONGEST_LEG:
        reasons = (OUT_OF_REACH,)
    return Screened(None if reasons else message, reasons)


def _wrong_with_places(message: msg.waypoints_t | msg.investigation_status_t) -> tuple[str, ...]:
    """Return what is wrong with the positions [m] of a message; empty if all are possible."""
    import numpy as np

    return _possible(np.array([message.x, message.y], dtype=float), BOUNDS[type(message)])[1]


def _possible(rows: "NDArray[np.float64]", bounds: Mapping[str, Bound]) -> "tuple[NDArray[np.bool_], tuple[str, ...]]":
    """Return which columns are possible, shape (n,), and what is wrong with the others; rows are in the order of the
    bounds.
    """
    import numpy as np

    lowest, highest, _ = np.array(list(bounds.values())).T[:, :, np.newaxis]
    right = (lowest <= rows) & (rows <= highest)
    if right.all():
        return right[0], ()
    wrong = {name: values[~good] for name, values, good in zip(bounds, rows, right, strict=True) if not good.all()}
    reasons = (f"{name} {IMPOSSIBLE if np.isfinite(values).any() else NOT_FINITE}" for name, values in wrong.items())
    return right.all(axis=0), tuple(reasons)
