"""Choose the criterion: one-step prediction errors or, if no model predicts the robot, errors of free runs.

Both are sums of squared white errors over all signals and samples i,

    S(theta) = sum_i w_i(theta)^2,    w = whitened (measured - predicted),

and -2 log likelihood = S + a constant. They differ in what is predicted:

- one step (prediction error): each reading from those before it, by the observer (problem.py);
- free runs (simulation error, output error): each reading from the commands alone (simulation_error.py).

The first is more informative and is tried first. It is trusted if the wheel speeds of free runs with the resulting
model stay close to those of the robot, |v_free - v| < STRAYING |v| with the measured wheel speeds v (n, 2) [rad/s]. The
body of a robot with a velocity controller must deviate no further than with the paper's model.

Reference: L. Ljung, System Identification: Theory for the User, 2nd ed., 1999 (prediction-error methods; output error).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cmr.estimation.free_runs import Errors, Fold, errors_of
from cmr.estimation.gains import COARSE, choose_gains
from cmr.estimation.gauss_newton import Fit
from cmr.estimation.prediction import WHEELS
from cmr.estimation.preparation import Ready
from cmr.estimation.problem import Problem
from cmr.estimation.search.selection import Search, search
from cmr.estimation.segments import Segment
from cmr.estimation.simulation_error import SimulationErrorProblem
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.recordings.signal import Floats

ASTRAY = 2.5  # with coarse ticks, factor by which the paper's parameters may differ from those of free runs
# Largest deviation of wheel speeds, as a share of the usual speed. Models that lack the physics of tests/hidden_effects
# deviate by at most 9 %; of the robots in docs/measurements/real_recordings.md, the Husky on grass, for which one-step
# errors are useless, deviates by 13 %, the MBot by 90 %.
STRAYING = 0.11
LONG, TRIAL = 400.0, 120.0  # s: of longer drives, one-step errors are tried on a part first; length of that part
SAME = 0.01  # share by which gains may differ because a part's reading intervals are not exactly the same
FURTHER = 1.5  # ratio to the errors of the paper's model, or of an earlier one, above which free runs are clearly worse


def search_effects(ready: Ready, say: Callable[[str], None]) -> Search:
    """Choose the criterion, and search the accepted recordings with it; return the result."""
    assert ready.problem is not None
    assert ready.base is not None
    if not ready.rolling:
        found = _by_one_step(ready, say)
        if found is not None:
            return found
        say("No model predicts this robot from moment to moment: fitting free runs instead ...")
    courses = SimulationErrorProblem(ready.problem.predictors, ready.problem.gains, ready.problem.excitation)
    base = courses.base(ready.start, ready.base.names)
    # One-step errors may suggest a robot that hardly moves, so typical sizes are scaled to the free-run fit.
    courses.excitation = replace(courses.excitation, parameters=base.values)
    return search(courses, base, say)


def _by_one_step(ready: Ready, say: Callable[[str], None]) -> Search | None:
    """Search by one-step errors; return None if the result cannot be trusted.

    This is common for robots with a velocity controller: of a long recording, a part is tried first, and a search stops
    after a step that makes free runs worse.
    """
    assert ready.problem is not None
    assert ready.base is not None
    controlled = ready.problem.excitation.controlled
    seconds = sum(predictor.segment.observations.seconds for predictor in ready.problem.predictors)
    if controlled and seconds > LONG:
        say(f"Trying {TRIAL:.0f} s of the recording ...")
        if _by_one_step(ready.part(TRIAL), say) is None:
            return None
    try:
        of_use = partial(trusted, ready=ready)
        found = _of_controlled(ready, say) if controlled else search(ready.problem, ready.base, say, of_use)
    except _AstrayError:
        return None
    return found if trusted(found, ready) else None


def _of_controlled(ready: Ready, say: Callable[[str], None]) -> Search:
    """Search a robot with a velocity controller, again if the model found requires different observer gains.

    Gains are first chosen with the paper's model. If the limits of a velocity controller act all the time, a model
    without them is so wrong that the observer has to follow the encoders closely, and quantisation then looks like an
    effect. Raises _AstrayError if free runs get worse.
    """
    assert ready.problem is not None
    assert ready.base is not None
    problem, base, of_use = ready.problem, ready.base, partial(trusted, ready=ready)
    found = search(problem, base, say, of_use, _Watch(problem, base))
    gains = choose_gains(found.problem.predictors, found.final.values)
    if np.allclose(np.array(gains, np.float64), np.array(problem.gains, np.float64), rtol=SAME):
        return found
    say("The fitted model needs other observer gains: searching again ...")
    problem, base = ready.with_gains(gains)
    return search(problem, base, say, of_use, _Watch(problem, base))


class _AstrayError(Exception):
    """A step of the search led to a model whose free runs are clearly worse than those of an earlier one."""


class _Watch:
    """Watches the free runs of the models of a one-step search, relative to the best so far."""

    def __init__(self, problem: Problem, base: Fit) -> None:
        self._segments = [predictor.segment for predictor in problem.predictors]
        self._least = self._of(base)

    def __call__(self, fit: Fit) -> None:
        """Check the next model; raises _AstrayError."""
        now = self._of(fit)
        clearly = now > FURTHER * self._least
        if (clearly[0] and now[0] > STRAYING) or np.any(clearly[1:]):
            raise _AstrayError
        self._least = np.fmin(now, self._least)

    def _of(self, fit: Fit) -> Floats:
        """Return the deviation of wheel speeds as a share of their speed, and medians of position [m] and heading
        [rad].
        """
        (errors,) = errors_of(self._segments, [[Fold((fit.values,))]] * len(self._segments))
        return np.array([_straying(self._segments, errors), errors.median("position"), errors.median("heading")])


def trusted(found: Search, ready: Ready) -> bool:
    """Return whether one-step errors led to a useful model: |v_free - v| < STRAYING |v|, root mean squares.

    v are the speeds of the wheels [rad/s], v_free those that run freely with the model. With coarse ticks, deviations
    of the wheels cannot be measured; then the paper's parameters must be near those of free runs. If the body of a
    robot with a velocity controller deviates further than with the paper's model, the search has explained one-step
    errors by effects that do not exist. With duties, the cause of the deviation may still be found as a law.
    """
    segments = [predictor.segment for predictor in found.problem.predictors]
    fold = Fold((dict(found.base.values), dict(found.final.values)))
    before, errors = errors_of(segments, [[fold]] * len(segments))
    deviates = any(errors.median(name) > FURTHER * before.median(name) for name in ("position", "heading"))
    if found.problem.excitation.controlled and deviates:
        return False
    if _straying(segments, errors) < STRAYING:
        return True
    factors = [found.final.values[name] / ready.start[name] for name in found.final.names if name in PAPER]
    coarse = max(segment.tick for segment in segments) > COARSE
    return coarse and all(1.0 / ASTRAY < factor < ASTRAY for factor in factors)


def _straying(segments: Sequence[Segment], errors: Errors) -> float:
    """Return the error of the wheel speeds in free runs as a share of these; 0 without wheel readings."""
    speeds = [
        np.diff(observations.wheel, axis=0) / np.diff(observations.wheel_time)[:, None]
        for observations in (segment.observations for segment in segments)
    ]
    usual = float(np.sqrt(np.mean(np.concatenate(speeds) ** 2))) if any(map(len, speeds)) else 0.0
    return errors.rmse(*WHEELS) / usual if usual > 0.0 else 0.0
