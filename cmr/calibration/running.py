"""Estimates during a drive: a fit at each call, averaged over possible effects every few seconds."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from cmr.calibration.paper import minimum_so_far
from cmr.calibration.path_errors import path_errors
from cmr.calibration.result import CalibrationResult, tells
from cmr.estimation.averaging import SEARCHING_STEPS, Posterior, averaged
from cmr.estimation.checks import looked_at
from cmr.estimation.commanded_speeds import HEADROOM, as_duties, as_motor, controller_of
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.estimation.estimation import nominal_of
from cmr.estimation.preparation import Ready, prepare
from cmr.estimation.simulation_error import SimulationErrorProblem
from cmr.estimation.thinning import PerSensor, Thinning, thinned
from cmr.model.catalogue import CATALOGUE
from cmr.model.velocity_controller import VelocityController
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording

AVERAGE_PERIOD = 4.0  # s of the drive between the starts of two averages
LONGEST = 2.0  # s that an average may take; if it takes longer, the next one uses fewer readings


class RunningFit:
    """Estimates for an ongoing drive; `averages` counts the averages so far.

    Between two averages the parameters are fitted with the likely effects of the last one. With `paper_only` there are
    no effects: the three parameters that predict best alone are fitted instead of each average, with nothing in
    between; with `paper`, they come from the paper's grid. `clock` measures computing time [s].
    """

    def __init__(
        self,
        nominal: ParameterFile | None,
        *,
        paper: bool = False,
        paper_only: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.averages = 0
        self._nominal, self._clock = nominal, clock
        self._paper, self._paper_only = paper, paper_only
        self._average: Posterior | None = None
        self._newest: CalibrationResult | None = None
        self._controller: VelocityController | None = None
        self._averaged_at = -math.inf  # s of the drive
        self._quick = 0.0  # duration of the last fit [s]
        self._every = 1  # every n-th reading is used

    def look(self, recording: Recording) -> CalibrationResult:
        """Return the estimates from the drive so far; the recording must begin where that of the previous call did.

        Raises EstimationError if it is not sufficient yet.
        """
        began, seconds = self._clock(), _length(recording)
        # The next call comes when this one returns: if that would be late for an average, it is due now.
        due = self._newest is None or seconds + self._quick > self._averaged_at + AVERAGE_PERIOD
        if self._newest is not None and (self._paper or self._paper_only) and not due:
            return self._newest
        nominal = nominal_of([recording], self._nominal)
        self._controller = self._controller_of(recording, nominal)
        recording, nominal = as_duties(recording, self._controller), as_motor(nominal, self._controller)
        if self._paper:
            self._newest, self._averaged_at = minimum_so_far(recording, nominal), seconds
            self.averages += 1
            return replace(self._newest, controller=self._controller)
        ready = self._prepared(recording, nominal)
        assert ready.base is not None
        if due or self._average is None or not set(ready.base.names) <= set(self._average.names):
            self._averaged_at = seconds
            values, estimates = self._alone(ready) if self._paper_only else self._averaged(ready)
            took = self._clock() - began
            self._every = max(1, math.ceil(self._every * took / LONGEST))
            self._quick = self._quick or took  # no fit takes longer than an average
            self.averages += 1
        else:
            values, estimates = self._fitted(ready, self._average, seconds)
            self._quick = self._clock() - began
        self._newest = replace(_result(ready, nominal, recording, estimates, values), controller=self._controller)
        return self._newest

    def _controller_of(self, recording: Recording, nominal: ParameterFile) -> VelocityController | None:
        """Return the robot's velocity controller; a previous one is kept until faster wheels are commanded.

        Its top wheel speed is the unit of an average, which is useless in another unit.
        """
        controller, before = controller_of([recording], nominal), self._controller
        if controller and before and controller.top_wheel_speed <= HEADROOM * before.top_wheel_speed:
            return before
        if controller != before:
            self._average, self._newest = None, None
        return controller

    def _prepared(self, recording: Recording, nominal: ParameterFile) -> Ready:
        """Return the recording prepared for a fit, with as many readings as time allows."""
        thinning = Thinning(PerSensor(self._every, self._every, self._every))
        looked = [
            replace(one, segments=tuple(thinned(segment, thinning) for segment in one.segments))
            for one in looked_at([recording])
        ]
        ready = prepare(looked, nominal)
        if ready.problem is None or ready.base is None:
            raise EstimationError(ready.refused)
        return ready

    def _averaged(self, ready: Ready) -> tuple[Mapping[str, float], dict[str, Estimate]]:
        """Return values and estimates averaged over possible effects."""
        assert ready.problem is not None
        assert ready.base is not None
        self._average = average = averaged(ready.problem, ready.base, 1.0, [], steps=SEARCHING_STEPS)
        return average.values, {name: _estimate(average, name) for name in ready.base.names}

    def _alone(self, ready: Ready) -> tuple[Mapping[str, float], dict[str, Estimate]]:
        """Return values and estimates of the three parameters with the least free-run errors."""
        assert ready.problem is not None
        assert ready.base is not None
        courses = SimulationErrorProblem(ready.problem.predictors, ready.problem.gains, ready.problem.excitation)
        base = courses.base(ready.start, ready.base.names)
        bursts = courses.extra_stds(base)
        stds = {name: float(np.hypot(base.std(name), bursts[name])) for name in base.names}
        return base.values, {name: Estimate(base.values[name], std) for name, std in stds.items()}

    def _fitted(
        self, ready: Ready, average: Posterior, seconds: float
    ) -> tuple[Mapping[str, float], dict[str, Estimate]]:
        """Return values and estimates of a fit with the likely effects of the last average.

        Other effects stay as in the average; without them the parameters would jump at each average.
        """
        assert ready.problem is not None
        assert ready.base is not None
        own = [parameter.name for name in average.likely for parameter in CATALOGUE[name].parameters]
        noise = ready.problem.found(ready.problem.errors(average.values))
        fit = ready.problem.fit(average.values, (*ready.base.names, *own), noise, renew=0)
        # The average includes priors on sizes: if these are more informative than the data, the fit adds nothing.
        if any(not fit.std(name) <= average.std(name) for name in ready.base.names):
            return average.values, {name: _estimate(average, name) for name in ready.base.names}
        # Allow for effects unknown to the fit, less so the longer the drive.
        shrinking = float(np.sqrt(self._averaged_at / seconds))
        stds = {name: max(fit.std(name), shrinking * average.std(name)) for name in ready.base.names}
        return fit.values, {name: Estimate(fit.values[name], std) for name, std in stds.items()}


def _length(recording: Recording) -> float:
    """Return how long a drive is so far [s]."""
    signal = recording.wheels if len(recording.wheels) else recording.poses
    return float(signal.seconds[-1]) if len(signal) else 0.0


def _estimate(average: Posterior, name: str) -> Estimate:
    return Estimate(average.values[name], average.std(name))


def _result(
    ready: Ready,
    nominal: ParameterFile,
    recording: Recording,
    estimates: Mapping[str, Estimate],
    values: Mapping[str, float],
) -> CalibrationResult:
    assert ready.problem is not None
    given = {name: value.value for name, value in nominal.values.items()}
    before, after = path_errors(ready.problem, given, values)
    found = {name: one for name, one in estimates.items() if tells(one)}
    return CalibrationResult(
        robot_id=recording.robot_id,
        estimates=found,
        unidentified=ready.untold,
        nominal=nominal,
        method="so far",
        samples=len(ready.base.rest) if ready.base else 0,
        covariance=np.diag([one.std**2 for one in found.values()]),
        path_rmse_before=before,
        path_rmse_after=after,
        parameters=values,
    )
