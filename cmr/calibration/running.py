"""The parameters while a drive goes on: fitted at each look, averaged over what may be hidden every few seconds."""

from collections.abc import Mapping

import numpy as np

from cmr.calibration.path_errors import path_errors
from cmr.calibration.result import CalibrationResult
from cmr.estimation.averaging import Posterior, averaged
from cmr.estimation.checks import looked_at
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.estimation.estimation import nominal_of
from cmr.estimation.preparation import Ready, prepare
from cmr.model.catalogue import CATALOGUE
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording

AVERAGE_PERIOD = 4.0  # s of the drive


class RunningFit:
    """The estimates of a drive that goes on.

    Between two averages the parameters are fitted with the effects that the last one found likely.
    """

    def __init__(self, nominal: ParameterFile | None) -> None:
        self._nominal = nominal
        self._average: Posterior | None = None
        self._averaged_at = -np.inf

    def look(self, recording: Recording) -> CalibrationResult:
        """Return what a drive tells so far; the recording must begin where that of the look before did.

        Raises EstimationError where it tells nothing, yet.
        """
        nominal = nominal_of([recording], self._nominal)
        ready = prepare(looked_at([recording]), nominal)
        if ready.problem is None or ready.base is None:
            raise EstimationError(ready.refused)
        seconds = max(p.segment.observations.time + p.segment.observations.seconds for p in ready.problem.predictors)
        if self._average is None or seconds > self._averaged_at + AVERAGE_PERIOD:
            self._average = averaged(ready.problem, ready.base, 1.0, [])
            self._averaged_at = seconds
            values: Mapping[str, float] = self._average.values
            estimates = {name: Estimate(values[name], self._average.std(name)) for name in ready.base.names}
        else:
            values, estimates = self._fitted(ready, self._average, seconds)
        return _result(ready, nominal, recording, estimates, values)

    def _fitted(
        self, ready: Ready, average: Posterior, seconds: float
    ) -> tuple[Mapping[str, float], dict[str, Estimate]]:
        """Return values and estimates of a fit with the effects that the last average found likely."""
        assert ready.problem is not None
        assert ready.base is not None
        own = [parameter.name for name in average.likely for parameter in CATALOGUE[name].parameters]
        start = {**ready.base.values, **{name: average.values[name] for name in (*ready.base.names, *own)}}
        noise = ready.problem.found(ready.problem.errors(start))
        fit = ready.problem.fit(start, (*ready.base.names, *own), noise, renew=0)
        # What the fit does not know of may still be there: less of it the longer the drive.
        shrinking = np.sqrt(self._averaged_at / seconds)
        stds = {n: max(fit.std(n), shrinking * average.std(n)) if n in average.names else fit.std(n) for n in fit.names}
        return fit.values, {name: Estimate(fit.values[name], float(stds[name])) for name in ready.base.names}


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
    found = {name: one for name, one in estimates.items() if one.std <= abs(one.value)}
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
    )
