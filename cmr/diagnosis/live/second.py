"""One second of a drive: sensor readings, and predictions from commands and parameters."""

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from cmr.bus.streams import COMMAND_LIFETIME
from cmr.diagnosis.live.hearing import Hearing
from cmr.diagnosis.live.twin import EVERY, STEP, Twin
from cmr.model.body import turn
from cmr.model.motion import RobotState, roll
from cmr.model.motor import decay_rate
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats

SECOND = 1_000_000  # us
AROUND = 500_000  # us before and after the second that are also used
LONGEST_GAP, LONGEST_POSE_GAP = 0.25, 0.5  # s; wheels and gyro, or poses, are not tracked over longer gaps
SPAN = 5  # steps of the grid over which rotation is measured
LAG = 0.2  # s of time shift used to measure the effect of a lag
RESTING = 0.5  # rad/s; slower wheels count as resting
LEAST_ANGLE = 0.3  # rad; a wheel that turned less in the second although it should have counts as resting
FROZEN_WAY, FROZEN_ANGLE = 0.03, 0.1  # m and rad of wheel motion above which identical poses count as frozen

GRID = np.arange(0.0, 1.0 + 0.5 * EVERY * STEP, EVERY * STEP)  # s

Pair: TypeAlias = tuple[float, float]
UNKNOWN: Pair = (math.nan, math.nan)


class PoseSteps(NamedTuple):
    """The motion of a second by the poses: displacement ahead and to the left [m], relative to the mid-way heading, and
    turn [rad].

    `jump` [m] and `turn_jump` [rad] are the excess of the largest step between poses over what the wheels can cause in
    that time. `same`: all poses are equal; `moved`: by the wheels they should not be.
    """

    forward: float
    sideways: float
    turn: float
    jump: float
    turn_jump: float
    same: bool
    moved: bool


class Motion(NamedTuple):
    """Displacement ahead and to the left, relative to the mid-way heading, and turn [m, m, rad]; or these per
    second.
    """

    forward: float
    sideways: float
    turn: float


class Wanted(NamedTuple):
    """The prediction from the commands, for left and right wheels.

    `turned` [rad] is the net rotation (NaN while the twin is new), `path` [rad] the total rotation in both directions,
    `speed_change` [rad/s] the difference from beginning to end. Dry friction acts on `direction` [-1 to 1], the mean of
    the speed's sign, and drag on `square` [rad], the mean of its square in units of the top speed.
    """

    turned: Pair
    path: Pair
    speed_change: Pair
    direction: Pair
    square: Pair


class Floor(NamedTuple):
    """The motion that the wheels' rotation causes without slip.

    `forward` and `sideways` [m] are relative to the mid-way heading, `turn` [rad] counter-clockwise, `path` [m] the
    total distances of left and right wheels; `turn_path` [rad] is the total rotation in both directions, `turn_square`
    [rad^2/s] the integral of the yaw rate times its size. `lag` is the change of forward, sideways and turn per second
    of delay [m, m, rad per s].
    """

    forward: float
    sideways: float
    turn: float
    path: Pair
    turn_path: float
    turn_square: float
    lag: Motion


@dataclass(frozen=True)
class Second:
    """One second of a drive that ends at `end` [us]; pairs are left and right, NaN if not measured.

    `turned` [rad] is how far wheels turned, `gyro` [rad] the turn that the gyro reports. `commanded` and `applied` are
    mean magnitudes of duties: commanded, and reported as applied by the driver. `status` are all bits of the feedback,
    `voltage` [V] is the battery's. Where speeds are commanded, a duty of 1 stands for `top_speed` [rad/s] of the
    wheels; where duties are, it is NaN.
    """

    end: int
    parameters: RobotParameters
    turned: Pair
    wanted: Wanted
    floor: Floor
    commanded: Pair
    applied: Pair
    voltage: float
    status: int
    gyro: float
    pose: PoseSteps | None
    top_speed: float = math.nan

    @property
    def by_speed(self) -> bool:
        """Whether the robot takes speeds instead of duties."""
        return math.isfinite(self.top_speed)

    @property
    def moving(self) -> bool:
        """Whether any wheel turned, or should have."""
        return any(math.isfinite(angle) and abs(angle) > LEAST_ANGLE for angle in (*self.turned, *self.wanted.turned))

    @property
    def resting(self) -> bool:
        """Whether all wheels stood still, as they should."""
        return max(self.floor.path) == 0.0 and not any(self.commanded)

    @property
    def time_constant(self) -> float:
        """Of the motors, by the parameters [s]."""
        return float(1.0 / decay_rate(self.parameters))


def observe(
    hearing: Hearing, twin: Twin, parameters: RobotParameters, begin: int, top_speed: float = math.nan
) -> Second | None:
    """Return the second that begins at utime `begin`, and advance the twin by it; None without wheel data.

    `top_speed` is that of Second.
    """
    wheels = hearing.between("wheels", begin - AROUND, begin + SECOND + AROUND, begin)
    angles = _angles(wheels)
    if angles is None:
        return None
    at_grid, lagged = (_at(grid, wheels[:, 0], angles) for grid in (GRID, GRID - LAG))
    commands = hearing.between("commands", begin - COMMAND_LIFETIME, begin + SECOND, begin)
    applied = wheels[np.isfinite(wheels[:, 3:5]).all(axis=1)][:, [0, 3, 4]]
    asked, passed = in_force(commands, COMMAND_LIFETIME * 1e-6), in_force(applied, math.inf)
    wanted = _wanted(twin, passed if len(applied) else asked, parameters)
    inside = wheels[(wheels[:, 0] >= 0.0) & (wheels[:, 0] <= 1.0)]
    return Second(
        end=begin + SECOND,
        parameters=parameters,
        turned=_pair(at_grid[-1] - at_grid[0]),
        wanted=wanted,
        floor=_floor(at_grid, lagged, parameters),
        commanded=_pair(np.abs(asked if len(commands) else passed).mean(axis=0)),
        applied=_pair(np.abs(passed).mean(axis=0)) if len(applied) else UNKNOWN,
        voltage=float(np.median(inside[:, 5])),
        status=int(np.bitwise_or.reduce(inside[:, 6].astype(np.int64))),
        gyro=_gyro(hearing, begin),
        pose=_pose(hearing, begin, np.abs(np.diff(at_grid, axis=0)) * parameters.wheel_radius, parameters),
        top_speed=top_speed,
    )


def _wanted(twin: Twin, duties: Floats, parameters: RobotParameters) -> Wanted:
    """Advance the twin by a second and return the motion of its wheels."""
    speeds = twin.drive(duties)
    travel = EVERY * STEP * (speeds.sum(axis=0) - 0.5 * (speeds[0] + speeds[-1]))
    return Wanted(
        turned=_pair(travel) if twin.seconds > 1 else UNKNOWN,  # before, it still depends on its initial state
        path=_pair(np.abs(speeds).mean(axis=0)),
        speed_change=_pair(speeds[-1] - speeds[0]),
        direction=_pair(np.clip(speeds / RESTING, -1.0, 1.0).mean(axis=0)),
        square=_pair((speeds * np.abs(speeds)).mean(axis=0) * parameters.k1),
    )


def _floor(angles: Floats, lagged: Floats, parameters: RobotParameters) -> Floor:
    """Return what wheel angles [rad], shape (n, 2), make on the floor; `lagged` are those LAG earlier."""
    now, before = (_rolled(part, parameters) for part in (angles, lagged))
    way = np.abs(np.diff(angles, axis=0)).sum(axis=0) * parameters.wheel_radius
    # Over shorter spans, quantisation of coarse encoders would look like rotation.
    turns = np.diff([turn(left, right, parameters) for left, right in angles[::SPAN]])
    span = SPAN * EVERY * STEP
    lag = Motion(*((old - new) / LAG for old, new in zip(before, now, strict=True)))
    return Floor(*now, _pair(way), float(np.abs(turns).sum()), float((turns * np.abs(turns)).sum() / span), lag)


def _rolled(angles: Floats, parameters: RobotParameters) -> Motion:
    path = roll(angles[:, 0], angles[:, 1], parameters, RobotState.at_rest())
    turned = float(path.theta[-1])
    ahead = complex(path.x[-1], path.y[-1]) * np.exp(-0.5j * turned)
    return Motion(float(ahead.real), float(ahead.imag), turned)


def in_force(sent: Floats, lifetime: float) -> Floats:
    """Return the duties in force at the beginning of each step of a second, shape (1 / STEP, 2).

    `sent` has rows of time [s], left, right; each holds until the next, and for `lifetime` [s] at most.
    """
    steps = np.arange(round(1.0 / STEP)) * STEP
    sent = sent[np.isfinite(sent).all(axis=1)]
    if not len(sent):
        return np.zeros((len(steps), 2))
    newest = np.searchsorted(sent[:, 0], steps + 1e-9, side="right") - 1
    holds = (newest >= 0) & (steps - sent[newest, 0] <= lifetime)
    return np.where(holds[:, None], sent[newest, 1:3], 0.0)


def _angles(wheels: Floats) -> Floats | None:
    """Return how far the wheels have turned [rad] at each feedback, shape (n, 2); None where a second has gaps."""
    time, speeds = wheels[:, 0], wheels[:, 1:3]
    if not np.isfinite(speeds).all() or not _covers(time, LONGEST_GAP):
        return None
    # A feedback reports the mean speed since the previous one.
    return np.cumsum(speeds * np.diff(time, prepend=time[0])[:, None], axis=0)


def _covers(time: Floats, longest: float) -> bool:
    """Return whether readings at these times [s] cover the second from 0 to 1 without a longer gap."""
    if len(time) < 2 or time[0] > 0.0 or time[-1] < 1.0:
        return False
    around = time[np.searchsorted(time, 0.0, side="right") - 1 : np.searchsorted(time, 1.0) + 1]
    return bool(np.diff(around).max() <= longest)


def _at(moments: Floats, time: Floats, angles: Floats) -> Floats:
    """Return both wheels' angles at these moments, shape (n, 2)."""
    return np.stack([np.interp(moments, time, angles[:, side]) for side in (0, 1)], axis=1)


def _gyro(hearing: Hearing, begin: int) -> float:
    """Return the rotation that the gyro reports [rad]; NaN without gyro."""
    rows = hearing.between("gyro", begin - AROUND, begin + SECOND + AROUND, begin)
    if not np.isfinite(rows).all() or not _covers(rows[:, 0], LONGEST_GAP):
        return math.nan
    time, rate = rows.T
    turned = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)))
    return float(np.diff(np.interp([0.0, 1.0], time, turned))[0])


def _pose(hearing: Hearing, begin: int, way: Floats, parameters: RobotParameters) -> PoseSteps | None:
    """Return what the poses say; `way` [m] is the distance of each side's wheels in each part of the second."""
    rows = hearing.between("poses", begin - AROUND, begin + SECOND + AROUND, begin)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not _covers(rows[:, 0], LONGEST_POSE_GAP):
        return None
    time, x, y = rows[:, :3].T
    theta = np.unwrap(rows[:, 3])
    (x0, x1), (y0, y1), (theta0, theta1) = (np.interp([0.0, 1.0], time, values) for values in (x, y, theta))
    step = complex(x1 - x0, y1 - y0) * np.exp(-0.5j * (theta0 + theta1))
    inside = (time >= 0.0) & (time <= 1.0)
    fastest = float(way.max(initial=0.0)) / (EVERY * STEP)
    jumps = np.hypot(np.diff(x), np.diff(y)) - fastest * np.diff(time)
    turn_jumps = np.abs(np.diff(theta)) - 2.0 * fastest / parameters.base_width * np.diff(time)
    whole = way.sum(axis=0)
    moved = whole.mean() > FROZEN_WAY or abs(whole[1] - whole[0]) / parameters.base_width > FROZEN_ANGLE
    return PoseSteps(
        forward=float(step.real),
        sideways=float(step.imag),
        turn=float(theta1 - theta0),
        jump=float(jumps[inside[1:]].max(initial=0.0)),
        turn_jump=float(turn_jumps[inside[1:]].max(initial=0.0)),
        same=bool(inside.sum() > 2 and np.ptp(rows[inside, 1:], axis=0).max() == 0.0),
        moved=bool(moved),
    )


def _pair(values: Floats) -> Pair:
    return float(values[0]), float(values[1])
