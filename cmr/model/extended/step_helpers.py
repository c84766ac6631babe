"""Functions that statements of a step, and of effects, may call besides elementary functions."""

import numpy as np

from cmr.model.compiled import inlined
from cmr.model.elementary import expm1


@inlined
def coefficients(rate: float, t: float, dt: float) -> tuple[float, float, float]:
    """Return the decay of a wheel speed over t [s], and its response to a constant and to a growing source."""
    lost = expm1(-rate * t)
    z = rate * t
    gained = -lost / rate
    series = t * t * (0.5 - z * (1 / 6 - z * (1 / 24 - z * (1 / 120 - z / 720)))) / dt
    return 1.0 + lost, gained, series if z < 0.02 else (t - gained) / (rate * dt)


@inlined
def sign(value: float) -> float:
    """Return 1.0, 0.0 or -1.0."""
    return (1.0 if value > 0.0 else 0.0) - (1.0 if value < 0.0 else 0.0)


@inlined
def after(time: float, dt: float, moment: float) -> float:
    """Return the share of the step of `dt` [s] starting at `time` that is after the moment."""
    return min(max((time + dt - moment) / dt, 0.0), 1.0)


@inlined
def share(before: float, behind: float) -> float:
    """Return the share of a step during which a value changing linearly from `before` to `behind` is positive."""
    throughout = 1.0 if before > 0.0 else 0.0
    part = (max(behind, 0.0) - max(before, 0.0)) / (behind - before)
    return part if behind != before else throughout


@inlined
def where(condition: bool, yes: float, no: float) -> float:
    """Return one of two values."""
    return yes if condition else no


@inlined
def random_number(seed: int, number: int, robot: int, stream: int) -> float:
    """Return a number in [0, 1) determined by the four arguments (SplitMix64; Steele et al., OOPSLA 2014)."""
    z = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(number) * np.uint64(0xD1B54A32D192ED03)
    z = z + np.uint64(robot) * np.uint64(0xABC98388FB8FAC03) + np.uint64(stream) * np.uint64(0x8CB92BA72F3D8DD7)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    # The highest bits become the mantissa of a float between 1 and 2.
    return np.uint64((z >> np.uint64(12)) | np.uint64(0x3FF0000000000000)).view(np.float64) - 1.0
