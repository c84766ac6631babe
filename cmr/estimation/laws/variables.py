"""The variables of formulas along a drive, from the observer's motion, at the middle of each step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from cmr.estimation.prediction import Errors, Indices, Predictor
from cmr.estimation.search.command_timing import DELAY
from cmr.estimation.segments import Segment
from cmr.model.laws.words import TURNING
from cmr.model.observer.observer import MOTION
from cmr.recordings.signal import Floats

SIDES = ("left", "right")
STEADY = 0.2  # s to either side: smooths the deviation of encoders and poses from the model, with decreasing weight
BACK_EMF_OF_LOAD = 0.8  # of K1 psi, which the load share subtracts from the duty; see cmr.model.stages


@dataclass(frozen=True)
class Variables:
    """The variables of one segment by name, each (T,): those of the `body`, and of each side's wheels in `wheels`.

    All mappings also contain the step `dt` [s], needed for smoothing.
    """

    body: Mapping[str, Floats]
    wheels: tuple[Mapping[str, Floats], Mapping[str, Floats]]


def variables_of(
    predictors: Sequence[Predictor], motions: Sequence[Floats], values: Mapping[str, float]
) -> list[Variables]:
    """Return the variables in all segments, in which a robot with these values moved like this."""
    return [_of_segment(one, motion, values) for one, motion in zip(predictors, motions, strict=True)]


class Speeds(Enum):
    """The wheel speeds used in formulas: the observer's, smoothed measured ones, or those from commands alone."""

    OBSERVED = "as the observer has them"
    STEADY = "by commands, and smoothly as encoders say"
    COMMANDED = "by commands alone"


def commanded(motion: Floats, free: Floats) -> Floats:
    """Return the motion (T + 1, columns of MOTION) with the wheel speeds predicted from commands alone, `free`.

    These contain no noise of the readings, so what a formula of them explains is real (instrumental variables;
    L. Ljung, System Identification, 2nd ed., 1999, section 7.6).
    """
    columns = [MOTION.index(f"psi_{name}") for name in SIDES]
    result = motion.copy()
    result[:, columns] = free[:, columns]
    return result


def steadied(motion: Floats, free: Floats, segment: Segment) -> Floats:
    """Return the motion (T + 1, columns of MOTION) with wheel speeds found without an observer.

    An observer is drawn towards its model, and away from a law that the model lacks: a formula's limit then seems to
    lie elsewhere. So a wheel turns as by the commands alone, `free`, plus its encoder's deviation from that, smoothed
    over STEADY.
    """
    result = motion.copy()
    if not len(segment.rolled):
        return result
    window = _window(segment)
    weight = np.convolve(np.ones(len(segment.rolled)), window, "same")
    steps = np.arange(len(segment.rolled))
    for side, name in enumerate(SIDES):
        column = MOTION.index(f"psi_{name}")
        beyond = segment.rolled[:, side] - 0.5 * (free[1:, column] + free[:-1, column])
        smooth = np.convolve(beyond, window, "same") / weight
        steady = free[:, column] + np.interp(np.arange(len(free)), steps + 0.5, smooth)
        result[:, column] = np.where(motion[:, column] == 0.0, 0.0, steady)
    return result


def placed(error: Errors, predictor: Predictor) -> Mapping[str, Floats]:
    """Return x and y of an observed robot at the middle of each step, each (T,), smoothed by the poses.

    If a law slows the robot down that the observer lacks, the observer's place is centimetres ahead until poses correct
    it: the border of a spot on the floor would seem to lie further ahead. If a formula varies smoothly with the place,
    the observer's is better: it contains no noise of the pose that is predicted.
    """
    columns = {name: error.motion[:, MOTION.index(name)] for name in ("x", "y")}
    if "forward" in predictor.times:
        heading = predictor.segment.observations.pose[:, 2]
        forward, sideways = error.of["forward"][:, 0], error.of["sideways"][:, 0]
        turned = {
            "x": np.cos(heading) * forward - np.sin(heading) * sideways,
            "y": np.sin(heading) * forward + np.cos(heading) * sideways,
        }
        rows = predictor.motion_rows("forward")
        columns = {name: own + _smoothed(rows, turned[name], predictor.segment) for name, own in columns.items()}
    return {name: 0.5 * (own[1:] + own[:-1]) for name, own in columns.items()}


def _smoothed(rows: Indices, values: Floats, segment: Segment) -> Floats:
    """Return values at some rows of the steps, smoothed over STEADY, at each step, (T + 1,)."""
    steps, window = segment.observations.steps + 1, _window(segment)
    count = np.convolve(np.bincount(rows, minlength=steps), window, "same")
    total = np.convolve(np.bincount(rows, values, minlength=steps), window, "same")
    near = np.flatnonzero(count)
    return np.asarray(np.interp(np.arange(steps), near, total[near] / count[near]))


def _window(segment: Segment) -> Floats:
    """Return the weights of the steps within STEADY of one."""
    return np.asarray(np.hanning(2 * round(STEADY / segment.observations.dt) + 3)[1:-1])


def _of_segment(predictor: Predictor, motion: Floats, values: Mapping[str, float]) -> Variables:
    observations = predictor.segment.observations
    column = dict(zip(MOTION, (0.5 * (motion[1:] + motion[:-1])).T, strict=True))
    dt, k1 = np.full(observations.steps, observations.dt), values["k1"]
    duty = _delayed(observations.duty, values.get(DELAY, 0.0) / observations.dt)
    psi = [column[f"psi_{side}"] for side in SIDES]
    domega = [np.diff(motion[:, MOTION.index(f"psi_{side}")]) / observations.dt for side in SIDES]
    load = sum(np.maximum(0.0, u * (u - BACK_EMF_OF_LOAD * k1 * of)) for u, of in zip(duty.T, psi, strict=True))
    v, w = _of_body(psi[0], psi[1], values)
    dv, dw = _of_body(domega[0], domega[1], values)
    since, way = _since_turn(v, w, observations.dt)
    body = {
        **{"v": v, "w": w, "dv": dv, "dw": dw, "dt": dt, "load": np.asarray(load, np.float64)},
        **{name: column[name] for name in ("x", "y", "theta")},
        "t": observations.time + observations.dt * (np.arange(observations.steps) + 0.5),
        "charge": np.cumsum(load * dt),
        "since_turn": since,
        "way_since_turn": way,
    }
    wheels = [
        {
            **body,
            **{"psi": psi[k], "other_psi": psi[1 - k], "domega": domega[k], "other_domega": domega[1 - k]},
            **{"u": duty[:, k], "other_u": duty[:, 1 - k], "s": k1 * psi[k], "effort": duty[:, k] - k1 * psi[k]},
        }
        for k in range(2)
    ]
    return Variables(body, (wheels[0], wheels[1]))


def _of_body(left: Floats, right: Floats, values: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Return forward and turning motion from that of the wheels."""
    radius = values["wheel_radius"]
    return 0.5 * radius * (left + right), radius / values["base_width"] * (right - left)


def _delayed(duty: Floats, steps: float) -> Floats:
    """Return the duties (T, 2) delayed by this number of steps."""
    if steps <= 0.0:
        return duty
    index = np.arange(len(duty), dtype=np.float64)
    return np.stack([np.interp(index - steps, index, side) for side in duty.T], axis=1)


def _since_turn(v: Floats, w: Floats, dt: float) -> tuple[Floats, Floats]:
    """Return time [s] and distance [m] since the rotation reversed, or since the first turn; each (T,)."""
    index = np.arange(len(w))
    latest = np.maximum.accumulate(np.where(np.abs(w) > TURNING, index, -1))
    sense = np.where(latest >= 0, np.sign(w[np.maximum(latest, 0)]), 0.0)
    reversed_now = np.diff(sense, prepend=sense[:1]) != 0.0
    last = np.maximum.accumulate(np.where(reversed_now, index, 0))
    way = np.concatenate([[0.0], np.cumsum(np.abs(v[:-1]) * dt)])
    turned = (sense != 0.0).astype(np.float64)
    return turned * (index - last) * dt, turned * (way - way[last])
