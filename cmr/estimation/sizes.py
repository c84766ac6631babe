"""Priors on the sizes of effects, and the posterior for errors that are linear in the sizes.

An effect is present with a prior probability. Its size is then normal about 0 with a share of the typical size as
standard deviation, half-normal if only one sign is possible (spike and slab; Mitchell and Beauchamp, J. Am. Stat.
Assoc. 83, 1988). Every robot has a trace of most effects (George and McCulloch, 88, 1993): undetectably small slip in
turns still biases the base width. A trace of either sign is normal; a one-sided trace is present or not, like an
effect.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from cmr.estimation.candidates import Excitation, size
from cmr.estimation.sampling import walk
from cmr.model.effect import Effect
from cmr.recordings.signal import Floats, Mask

SPREAD = 0.7  # of the typical size: standard deviation of the size of an effect that is present
TRACE = 0.05  # of the typical size: standard deviation of a trace of either sign
SMALL, EVEN = 0.1, 0.0  # the same for a one-sided trace, and the log odds of its presence


class SizePosterior(NamedTuple):
    """Mean (p,) and covariance (p, p) of sizes, the probability of each effect (e,), and the likeliest sizes (p,)."""

    mean: Floats
    covariance: Floats
    presence: Floats
    likeliest: Floats


class Sizes:
    """The sizes (p,) of some effects (e,), in their units, on a robot and a drive.

    Delays are not negative, except for parameters `ahead`, whose clocks are known to be ahead.
    """

    def __init__(self, effects: Sequence[Effect], excitation: Excitation, ahead: Collection[str] = ()) -> None:
        parameters = [parameter for effect in effects for parameter in effect.parameters if parameter.switches]
        self.parameters = parameters
        self.usual = np.array([size(parameter, excitation) for parameter in parameters])
        self._one_sided = np.array(
            [
                (one.lower == one.neutral or (one.kind == "delay" and one.name not in ahead))
                and one.name not in excitation.given
                for one in parameters
            ],
            np.bool_,
        )
        self._effects = np.repeat(
            np.arange(len(effects)), [sum(parameter.switches for parameter in effect.parameters) for effect in effects]
        )

    def posterior(
        self,
        normal: Floats,
        pull: Floats,
        slabs: Floats,
        odds: Floats,
        begin: Mask,
        steps: int,
        seed: int,
        *,
        traces: bool,
    ) -> SizePosterior:
        """Return the posterior of sizes s with log-likelihood -s' `normal` s / 2 - `pull`' s.

        `slabs` (p,) are the standard deviations of sizes that are present, `odds` (e,) the logarithms of the prior odds
        of the effects, `begin` (e,) those with which walks begin, `seed` that of their random numbers. Without `traces`
        the sizes of absent effects are 0.
        """
        small = np.flatnonzero(self._one_sided & traces)
        walked = np.append(np.arange(len(slabs)), small)  # the size to which each sampled one is added
        scales = np.zeros((len(slabs), len(walked)))
        scales[walked, np.arange(len(walked))] = np.append(slabs, SMALL * self.usual[small])
        groups = np.append(self._effects, len(odds) + np.arange(len(small)))
        one_sided = self._one_sided[walked]
        odds, begin = np.append(odds, np.full(len(small), EVEN)), np.append(begin, np.zeros(len(small), np.bool_))

        # Sizes are sampled ones plus normal traces; marginalise the likelihood over the traces:
        small_std = np.where(self._one_sided | (not traces), 0.0, TRACE * self.usual)
        scaled = np.eye(len(slabs)) + small_std[:, None] * normal * small_std
        trace = small_std[:, None] * np.linalg.inv(scaled) * small_std
        kept = np.eye(len(slabs)) - normal @ trace
        reduced, pulled = scales.T @ kept @ normal @ scales, scales.T @ kept @ pull
        means, squares, shares, likeliest = walk(reduced, pulled, groups, one_sided, odds, begin, steps, seed)
        spread = scales @ (squares - np.outer(means, means)) @ scales.T
        mode = scales @ _likeliest(likeliest[groups], reduced, pulled, one_sided)
        mean, mode = (kept.T @ sizes - trace @ pull for sizes in (scales @ means, mode))
        return SizePosterior(mean, kept.T @ spread @ kept + trace, shares[: len(shares) - len(small)], mode)


def _likeliest(on: Mask, normal: Floats, pull: Floats, one_sided: Mask) -> Floats:
    """Return the likeliest sizes (p,) of effects that are on, with normal priors of variance 1; 0 for others."""
    result, index = np.zeros(len(on)), np.flatnonzero(on)
    result[index] = np.linalg.solve(normal[np.ix_(index, index)] + np.eye(len(index)), -pull[index])
    result[one_sided] = np.maximum(result[one_sided], 0.0)
    return result
