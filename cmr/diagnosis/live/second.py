"""One second of a drive: what the sensors say, and what the robot's parameters make of its commands."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cmr.diagnosis.live.hearing import Hearing
from cmr.diagnosis.live.twin import EVERY, STEP, Twin
from cmr.model.body import forward, turn
from cmr.model.motion import RobotState, roll
from cmr.model.motor import decay_rate
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats
from cmr.world.commands import COMMAND_LIFETIME

SECOND = 1_000_000  # us
AROUND = 500_000  # us before and after the second that are looked at, too
LONGEST_GAP, LONGEST_POSE_GAP = 0.25, 0.5  # s; over a longer one wheels and gyro, or poses, are not followed
MIDDLE = 0.15  # s before and after a moment over which the speed at that moment is averaged
RESTING = 0.5  # rad/s; slower wheels are as good as resting
LEAST_ANGLE = 0.3  # rad; a wheel that turned less in the second, and should have, counts as resting
FROZEN_WAY, FROZEN_ANGLE = 0.03, 0.1  # m and rad that wheels must make until equal poses are called frozen

Pair = tuple[float, float]


class PoseSteps(NamedTuple):
    """What a second of poses says: displacement ahead and to the left [m], of the heading half-way, and turn [rad].

    `jump` [m] and `turn_jump` [rad] are by how much the largest step from one pose to the next exceeds what turning
    wheels can do in that time. `same`: all poses are equal; `moved`: by the wheels they should not be.
    """

    forward: float
    sideways: float
    turn: float
    jump: float
    turn_jump: float
    same: bool
    moved: bool


@dataclass(frozen=True)
class Second:
    """One second of a drive that ends at `end` [us]; pairs are left and right, what was not measured is NaN.

    `turned` and `predicted` [rad] are how far wheels turned and should have, `predicted_path` [rad] there and back,
    too; `predicted_change` [rad/s] by how much their speeds should have changed; `predicted_direction` [-1 to 1] and
    `predicted_square` [rad] are what dry friction and drag would act on: the means of the speed's sign and, in units of
    the top speed, of its square.

    `forward`, `sideways` [m] and `turn` [rad] are what the wheels' turning makes on the floor, `path` [m] the way of
    each side's wheels, there and back; `speed_change` [m/s] and `turn_rate_change` [rad/s] are from the beginning to
    the end. `gyro` [rad] is the turn that it tells.

    `commanded` and `applied` are mean sizes of duties: what was asked for, and what the driver says it passed on.
    `status` are all bits of the feedback, `voltage` [V] is the battery's.
    """

    end: int
    parameters: RobotParameters
    turned: Pair
    predicted: Pair
    predicted_path: Pair
    predicted_change: Pair
    predicted_direction: Pair
    predicted_square: Pair
    forward: float
    sideways: float
    turn: float
    path: Pair
    speed_change: float
    turn_rate_change: float
    commanded: Pair
    applied: Pair
    voltage: float
    status: int
    gyro: float
    pose: PoseSteps | None

    @property
    def moving(self) -> bool:
        """Whether any wheel turned, or should have."""
        return any(math.isfinite(angle) and abs(angle) > LEAST_ANGLE for angle in (*self.turned, *self.predicted))

    @property
    def resting(self) -> bool:
        """Whether all wheels stood still, as they should."""
        return max(self.path) == 0.0 and not any(self.commanded)

    @property
    def time_constant(self) -> float:
        """Of the motors, by the parameters [s]."""
        return float(1.0 / decay_rate(self.parameters))


def observe(hearing: Hearing, twin: Twin, parameters: RobotParameters, begin: int) -> Second | None:
    """Return the second that begins at utime `begin`, through which the twin is driven; None if wheels are unknown."""
    wheels = hearing.between("wheels", begin - AROUND, begin + SECOND + AROUND, begin)
    angles = _angles(wheels)
    if angles is None:
        return None
    grid = np.arange(0.0, 1.0 + 0.5 * EVERY * STEP, EVERY * STEP)
    at_grid = np.stack([np.interp(grid, wheels[:, 0], angles[:, side]) for side in (0, 1)], axis=1)
    path = roll(at_grid[:, 0], at_grid[:, 1], parameters, RobotState.at_rest())
    turn = float(path.theta[-1])
    ahead = complex(path.x[-1], path.y[-1]) * np.exp(-0.5j * turn)
    speeds = _speeds(wheels[:, 0], angles, parameters)
    commands = hearing.between("commands", begin - COMMAND_LIFETIME, begin + SECOND, begin)
    applied = wheels[np.isfinite(wheels[:, 3:5]).all(axis=1)][:, [0, 3, 4]]
    asked, passed = in_force(commands, COMMAND_LIFETIME * 1e-6), in_force(applied, math.inf)
    predicted = twin.drive(passed if len(applied) else asked)
    known = twin.seconds > 1  # before, it still remembers how it was started
    travel = EVERY * STEP * (predicted.sum(axis=0) - 0.5 * (predicted[0] + predicted[-1]))
    way = np.abs(np.diff(at_grid, axis=0)) * parameters.wheel_radius
    inside = (wheels[:, 0] >= 0.0) & (wheels[:, 0] <= 1.0)
    return Second(
        end=begin + SECOND,
        parameters=parameters,
        turned=_pair(at_grid[-1] - at_grid[0]),
        predicted=_pair(travel) if known else (math.nan, math.nan),
        predicted_path=_pair(np.abs(predicted).mean(axis=0)),
        predicted_change=_pair(predicted[-1] - predicted[0]),
        predicted_direction=_pair(np.clip(predicted / RESTING, -1.0, 1.0).mean(axis=0)),
        predicted_square=_pair((predicted * np.abs(predicted)).mean(axis=0) * parameters.k1),
        forward=float(ahead.real),
        sideways=float(ahead.imag),
        turn=turn,
        path=_pair(way.sum(axis=0)),
        speed_change=float(speeds[1, 0] - speeds[0, 0]),
        turn_rate_change=float(speeds[1, 1] - speeds[0, 1]),
        commanded=_pair(np.abs(asked if len(commands) else passed).mean(axis=0)),
        applied=_pair(np.abs(passed).mean(axis=0)) if len(applied) else (math.nan, math.nan),
        voltage=float(np.median(wheels[inside, 5])),
        status=int(np.bitwise_or.reduce(wheels[inside, 6].astype(np.int64))),
        gyro=_gyro(hearing, begin),
        pose=_pose(hearing, begin, way, parameters),
    )


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
    # What a feedback tells is the mean speed since the one before.
    return np.cumsum(speeds * np.diff(time, prepend=time[0])[:, None], axis=0)


def _covers(time: Floats, longest: float) -> bool:
    """Tell whether readings at these times [s] cover the second from 0 to 1 without a longer gap."""
    if len(time) < 2 or time[0] > 0.0 or time[-1] < 1.0:
        return False
    around = time[np.searchsorted(time, 0.0, side="right") - 1 : np.searchsorted(time, 1.0) + 1]
    return bool(np.diff(around).max() <= longest)


def _speeds(time: Floats, angles: Floats, parameters: RobotParameters) -> Floats:
    """Return speed [m/s] and yaw rate [rad/s] at the beginning and at the end of the second, shape (2, 2)."""
    borders = np.array([-MIDDLE, MIDDLE, 1.0 - MIDDLE, 1.0 + MIDDLE])
    left, right = (np.interp(borders, time, angles[:, side]) for side in (0, 1))
    from_start = np.stack([forward(left, right, parameters), turn(left, right, parameters)], axis=1)
    return np.asarray((from_start[1::2] - from_start[::2]) / (2.0 * MIDDLE))


def _gyro(hearing: Hearing, begin: int) -> float:
    """Return the turn that the gyro tells [rad]; NaN where it does not."""
    rows = hearing.between("gyro", begin - AROUND, begin + SECOND + AROUND, begin)
    if not np.isfinite(rows).all() or not _covers(rows[:, 0], LONGEST_GAP):
        return math.nan
    time, rate = rows.T
    turned = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)))
    return float(np.diff(np.interp([0.0, 1.0], time, turned))[0])


def _pose(hearing: Hearing, begin: int, way: Floats, parameters: RobotParameters) -> PoseSteps | None:
    """Return what the poses say; `way` [m] is how far each side's wheels went in each part of the second."""
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
