"""The robot's own parameters, averaged over possible hidden effects: none, or one more effect of the catalogue.

With the probability p_j of explanation j, the values v_j of its fit and their deviations s_j beside the effect, whose
prior is only that its size is of the usual order,

    mean = sum_j p_j v_j,    variance = sum_j p_j (s_j^2 + (v_j - mean)^2)

(J. A. Hoeting et al., Statistical Science 14, 1999: Bayesian model averaging). That is fast enough for each decision.
Once the result is certain enough, the average allows for any number of further effects, as in a calibration
(cmr/estimation/averaging.py). If the parameters are then less certain, the robot drives for the effects that they
depend on most: of the variance of parameter i, effect k accounts for C_ik^2 / (C_ii C_kk), with the covariance C.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from cmr.estimation.averaging import Posterior
from cmr.estimation.averaging import averaged as averaged_over_effects
from cmr.estimation.estimates import Estimate
from cmr.estimation.problem import Problem
from cmr.investigation.choosing import Evidence
from cmr.investigation.evidence import PARAMETERS, SIZES
from cmr.investigation.judging import Judgement
from cmr.investigation.separation import BELIEF
from cmr.model.catalogue import CATALOGUE
from cmr.recordings.signal import Floats

GOALS: Mapping[str, float] = {"k1": 0.01, "base_width": 0.01, "k2_over_k3": 0.03}  # two deviations, as a share
LEAST = 5.0  # s of driving: shorter drives give too small a deviation of k1
ON_IT = 0.3  # share of a parameter's variance from which an effect is worth driving for


class Settled(NamedTuple):
    """Estimates of PARAMETERS that allow for any undetected effects, and the effects that a calibration drives for.

    The latter account for much of the variance of parameters that are less certain than a calibration requires.
    """

    estimates: dict[str, Estimate]
    sought: tuple[str, ...] = ()

    @property
    def is_calibrated(self) -> bool:
        """Whether all parameters are as certain as a calibration requires."""
        return is_calibrated(self.estimates)


def averaged(judgement: Judgement, known: Evidence) -> dict[str, Estimate]:
    """Return the estimates of PARAMETERS."""
    likely = judgement.probabilities
    shares = np.array([likely[one.name] for one in judgement.explanations])
    values = np.array([[one.values[name] for name in PARAMETERS] for one in judgement.explanations])
    variances = np.stack([_variances(known, one.name) for one in judgement.explanations])
    mean = shares @ values
    variance = shares @ (variances + (values - mean) ** 2)
    return {
        name: Estimate(float(value), float(np.sqrt(of)))
        for name, value, of in zip(PARAMETERS, mean, variance, strict=True)
    }


def settled(judgement: Judgement, known: Evidence) -> Settled:
    """Return the estimates of PARAMETERS with deviations that allow for any undetected effects.

    If an average over any number of effects differs from that over single ones, the deviation covers both. Without
    poses the average over any number lacks the priors: then the estimates are those of `averaged`.
    """
    quick = averaged(judgement, known)
    beliefs, base = judgement.problem, judgement.base
    if not any(len(one.segment.observations.pose) for one in beliefs.predictors):
        return Settled(quick)
    problem = Problem(beliefs.predictors, beliefs.gains, beliefs.excitation)
    fit = problem.fit(base.values, base.names, judgement.noise, renew=1)
    average = averaged_over_effects(problem, fit, 1.0, judgement.named)
    estimates = {
        name: Estimate(one.value, float(np.hypot(max(one.std, average.std(name)), average.values[name] - one.value)))
        for name, one in quick.items()
    }
    uncertain = [name for name, one in estimates.items() if not _is_certain(name, one)]
    return Settled(estimates, tuple(dict.fromkeys(one for name in uncertain for one in accountable(average, name))))


def accountable(average: Posterior, parameter: str) -> Iterator[str]:
    """Yield the effects, by name, that account for much of a parameter's variance."""
    row, variances = average.covariance[average.names.index(parameter)], np.diag(average.covariance)
    own = row[average.names.index(parameter)]
    for effect in average.presence:
        columns = [average.names.index(one.name) for one in CATALOGUE[effect].parameters if one.name in average.names]
        if any(row[column] ** 2 > ON_IT * own * variances[column] > 0.0 for column in columns):
            yield effect


def is_calibrated(estimates: Mapping[str, Estimate]) -> bool:
    """Return whether all parameters are as certain as a calibration requires."""
    return all(_is_certain(name, estimates[name]) for name in GOALS)


def _is_certain(name: str, one: Estimate) -> bool:
    return 2.0 * one.std <= GOALS[name] * abs(one.value)


def _variances(known: Evidence, name: str) -> Floats:
    """Return the variances of PARAMETERS, (3,), beside the effects found, and one more if `name` is not empty."""
    own = list(known.columns.of.get(name, ()))
    columns = [*range(known.columns.free), *own]
    block = BELIEF * known.information[np.ix_(columns, columns)]
    block[range(known.columns.free, len(columns)), range(known.columns.free, len(columns))] += SIZES**-2.0
    scale = np.sqrt(np.maximum(np.diag(block), 1e-300))
    covariance = np.linalg.pinv(block / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    first = known.sets[0]
    steps = np.array([known.sets[1 + k][one] - first[one] for k, one in enumerate(PARAMETERS)])
    return np.asarray(np.diag(covariance)[: len(PARAMETERS)] * steps**2)
