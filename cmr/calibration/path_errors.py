"""Path errors of free runs before and after a calibration."""

import math
from collections.abc import Mapping

from cmr.estimation.free_runs import Fold, errors_of
from cmr.estimation.gain import path_rmse
from cmr.estimation.problem import Problem
from cmr.model.parameters import RobotParameters


def path_errors(problem: Problem, given: Mapping[str, float], found: Mapping[str, float]) -> tuple[float, float]:
    """Return the root mean square path errors [m] of free runs with the given and with the found parameters.

    Each is NaN if one of the paper's parameters is unknown, or no path was recorded.
    """
    known = [set(RobotParameters._fields) <= set(values) for values in (given, found)]
    if not known[1]:
        return math.nan, math.nan
    models = (given if known[0] else found, found)
    segments = [one.segment for one in problem.predictors]
    before, after = map(path_rmse, errors_of(segments, [[Fold(models)]] * len(segments)))
    return (before if known[0] else math.nan), after
