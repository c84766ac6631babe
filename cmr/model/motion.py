"""Motion of the whole robot: one step of many robots, or one drive under many candidate parameters.

Wheel speed and heading are the exact solution for constant duty; the position integrates speed times direction
with the two-point Gauss-Legendre rule, whose error over a 10 ms step is some nanometres. The loops are compiled, in
`cmr.model.paper`.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmr.model.body import arc, forward, turn
from cmr.model.parameters import DEFINITIONS, Numeric, Quantity, RobotParameters

Floats: TypeAlias = NDArray[np.float64]
Borders: TypeAlias = NDArray[np.int64]
Spans: TypeAlias = tuple[Floats, Floats, Floats]  # duties of left and right, and how long they last [s]
LARGEST_HALF_TURN = 0.3  # rad between the middle of a step and its Gauss points; beyond, steps are split
LONGEST_PART = 0.025  # s; errors grow with the fourth power
MOST_PARTS = 1000  # parts of a step, at most; absurd parameters must not take for ever


class RobotState(NamedTuple):
    """The state of one robot (numbers) or of many (arrays of one shape); fields and units as in robot_state_t."""

    x: Numeric
    y: Numeric
    theta: Numeric
    psi_left: Numeric
    psi_right: Numeric
    domega_left: Numeric
    domega_right: Numeric

    @classmethod
    def at_rest(cls, x: Quantity = 0.0, y: Quantity = 0.0, theta: Quantity = 0.0) -> "RobotState":
        """Return the state of a robot that stands still at this pose."""
        still = np.zeros_like(np.asarray(x, dtype=float))[()]
        return cls(x, y, theta, still, still, still, still)


class Trajectory(NamedTuple):
    """A simulated drive: arrays with time on the first axis and candidates on the others.

    Pose and wheel speeds are as in RobotState; `angle_left` and `angle_right` [rad] are the wheel rotations since the
    start.
    """

    x: Floats
    y: Floats
    theta: Floats
    psi_left: Floats
    psi_right: Floats
    angle_left: Floats
    angle_right: Floats


def step(state: RobotState, left: ArrayLike, right: ArrayLike, parameters: RobotParameters, dt: float) -> RobotState:
    """Return the state after `dt` [s] of constant duties `left` and `right`.

    Memory of effects (lags, heat, gaps, delayed commands) is reset at each call: for several steps with such effects
    use a `cmr.model.fleet.Fleet`.
    """
    from cmr.model.fleet import Fleet  # imports Numba, which is slow and not needed by commands that do not simulate

    values = parameters.values
    everything = np.broadcast_arrays(*state, left, right, *values.values())
    rows = [np.ravel(row).astype(float) for row in everything]
    count = len(RobotState._fields)
    fleet = Fleet(dt)
    given = dict(zip(values, rows[count + 2 :], strict=True))
    robots = fleet.add(RobotState(*rows[:count]), RobotParameters.of(given))
    fleet.command(robots, rows[count], rows[count + 1])
    fleet.advance()
    return RobotState(*(values.reshape(everything[0].shape)[()] for values in fleet.states()))


def wheel_speeds(duty: Floats, dt: Floats, parameters: RobotParameters, psi: ArrayLike) -> Floats:
    """Return the speeds of one side's wheels over a drive that starts at speed `psi`.

    `duty` and `dt` have shape (T,); the result has shape (T + 1, candidates...), with candidates from broadcast
    parameters.
    """
    from cmr.model import paper

    shape = np.broadcast_shapes(np.shape(parameters.k1), np.shape(parameters.k2_over_k3), np.shape(psi))
    values = _lanes((1.0, parameters.k2_over_k3, parameters.k1, 1.0, psi), shape)
    speeds = np.empty((len(duty) + 1, values.shape[1]))
    paper.wheel_speeds(_floats(duty), _floats(dt), values[:4], values[4], speeds)
    return speeds.reshape(-1, *shape)


def drive(
    left: ArrayLike,
    right: ArrayLike,
    dt: ArrayLike,
    parameters: RobotParameters,
    start: RobotState,
    at: ArrayLike | None = None,
    *,
    time: float = 0.0,
    seed: int = 0,
) -> Trajectory:
    """Simulate a drive from recorded duties, freely, without corrections.

    `left`, `right` [duty] and `dt` [s] have shape (T,), one entry per span of constant duty. Parameters, those of
    effects too, and start may be arrays of candidates. The result has shape (T + 1, candidates...); `theta` is not
    wrapped. `at` selects borders, ascending: with few of them, the drive takes half the time. Time-dependent effects
    start from `time` [s] at the first border; `seed` determines random numbers. Each span counts as one command. Raises
    KeyError for an effect's parameter that the catalogue does not have.
    """
    shape = np.broadcast_shapes(*(np.shape(value) for value in (*parameters.values.values(), *start[:5])))
    spans = (_floats(left), _floats(right), _floats(dt))
    borders = np.arange(len(spans[2]) + 1) if at is None else np.ascontiguousarray(at, dtype=np.int64)
    places = _lanes(start[:5], shape)
    paper = _lanes(parameters, shape)
    if not parameters.effects:
        recorded = _drive_paper(spans, paper, places, borders)
    else:
        recorded = _drive_mixed(spans, paper, parameters.effects, shape, places, borders, time, seed)
    return Trajectory(*recorded.reshape(len(recorded), len(borders), *shape))


def _drive_paper(spans: Spans, parameters: Floats, start: Floats, at: Borders) -> Floats:
    """Drive candidates of the paper's model, given as rows; return the recorded states, (7, len(at), candidates)."""
    from cmr.model import paper

    recorded = np.empty((paper.RECORDED, len(at), parameters.shape[1]))
    fastest = np.maximum(np.abs(start[3:]).max(axis=0), _largest(spans[:2]) / parameters[2])
    parts = parts_of(spans[2], parameters[0], parameters[3], fastest)
    paper.drive(*spans, parts, parameters, start, at, *recorded)
    return recorded


def _drive_mixed(
    spans: Spans,
    paper: Floats,
    effects: Mapping[str, ArrayLike],
    shape: tuple[int, ...],
    start: Floats,
    at: Borders,
    time: float,
    seed: int,
) -> Floats:
    """Drive candidates, those with effects by the extended model and the others by the paper's."""
    from cmr.model.catalogue import definition
    from cmr.model.extended import model as extended_model
    from cmr.model.extended.compose import RECORDED

    values = {definition(name).name: row for name, row in zip(effects, _lanes(effects.values(), shape), strict=True)}
    model = extended_model.model_of(values)
    on = model.on(values, paper.shape[1:])
    if not np.any(on):
        return _drive_paper(spans, paper, start, at)
    values.update(zip(DEFINITIONS, paper, strict=True))
    chosen = {name: values[name][on] for name in model.definitions if name in values}
    recorded = np.empty((RECORDED, len(at), paper.shape[1]))
    recorded[:, :, on] = extended_model.drive(*spans, chosen, start[:, on], at, time, seed, model)
    if not np.all(on):
        off = ~on
        recorded[:, :, off] = _drive_paper(spans, _columns(paper, off), _columns(start, off), at)
    return recorded


def _columns(rows: Floats, chosen: NDArray[np.bool_]) -> Floats:
    return np.ascontiguousarray(rows[:, chosen])


def parts_of(dt: Floats, wheel_radius: Quantity, base_width: Quantity, fastest: Quantity) -> NDArray[np.int64]:
    """Return the number of integration parts of spans `dt` [s]: short enough that no robot turns far.

    `fastest` [rad/s] bounds the wheel speeds. One part suffices for frequent commands; long spans, or wrong parameters,
    need more.
    """
    half_turn_in_a_second = np.max(half_turn(1.0, wheel_radius, base_width, fastest), initial=0.0)
    parts: Floats = np.ceil(np.abs(dt) * np.maximum(half_turn_in_a_second / LARGEST_HALF_TURN, 1.0 / LONGEST_PART))
    bounded: Floats = np.clip(np.nan_to_num(parts, nan=1.0), 1.0, MOST_PARTS)
    return bounded.astype(np.int64)


def half_turn(dt: Quantity, wheel_radius: Quantity, base_width: Quantity, fastest: Quantity) -> Floats:
    """Return by how much [rad] a robot turns at most between the middle of a span `dt` [s] and a Gauss point."""
    return np.asarray(wheel_radius / base_width * fastest * dt / np.sqrt(3.0), np.float64)


def _lanes(values: Iterable[ArrayLike], shape: tuple[int, ...]) -> Floats:
    """Broadcast values to `shape` and return them as rows of one array, one candidate per column."""
    return np.array([np.broadcast_to(value, shape).ravel() for value in values], dtype=float)


def _floats(values: ArrayLike) -> Floats:
    return np.ascontiguousarray(values, dtype=float)


def _largest(arrays: Iterable[Floats]) -> float:
    return max((float(np.max(np.abs(array), initial=0.0)) for array in arrays), default=0.0)


def roll(angle_left: ArrayLike, angle_right: ArrayLike, parameters: RobotParameters, start: RobotState) -> Trajectory:
    """Dead reckoning: the path of measured wheel angles, without a motor model.

    `angle_left`, `angle_right` [rad] are cumulative and have shape (T + 1,), like the results, which have candidates on
    further axes. Wheel speeds are unknown and returned as NaN.
    """
    angle_left, angle_right = np.asarray(angle_left, float), np.asarray(angle_right, float)
    candidates = max(np.ndim(value) for value in (*parameters, *start))
    in_time = (slice(None), *(np.newaxis,) * candidates)
    left, right = np.diff(angle_left)[in_time], np.diff(angle_right)[in_time]
    angle = turn(left, right, parameters)
    theta = _accumulate(start.theta, angle)
    dx, dy = arc(theta[:-1], forward(left, right, parameters), angle)
    unknown = np.full(len(angle_left), np.nan)
    x, y = _accumulate(start.x, dx), _accumulate(start.y, dy)
    return Trajectory(x, y, theta, unknown, unknown, angle_left, angle_right)


def _accumulate(first: ArrayLike, increments: Floats) -> Floats:
    """Return the running sum of `increments` along time, from `first` on; one entry longer than `increments`."""
    total = np.empty((len(increments) + 1, *np.broadcast_shapes(increments.shape[1:], np.shape(first))))
    total[0] = first
    np.cumsum(increments, axis=0, out=total[1:])
    total[1:] += first
    return total
