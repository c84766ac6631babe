"""Format estimates, rounded to two digits of their standard deviation."""

import math

from cmr.estimation.estimates import Estimate
from cmr.report.numbers import UNKNOWN, given, rounded, unit_text


def estimate_text(estimate: Estimate, unit: str) -> str:
    """Return value and standard deviation, rounded to two digits of the latter, with unit."""
    if not _known(estimate):
        return given(estimate.value, unit)
    value, std = (rounded(part, estimate.std) for part in (estimate.value, estimate.std))
    return f"{value} \u00b1 {std} {unit_text(unit)}".rstrip()


def interval_text(estimate: Estimate) -> str:
    """Return the 95 % interval, rounded as the estimate is."""
    if not _known(estimate):
        return UNKNOWN
    low, high = (rounded(end, estimate.std) for end in estimate.interval)
    return f"{low} to {high}"


def _known(estimate: Estimate) -> bool:
    return math.isfinite(estimate.value) and math.isfinite(estimate.std) and estimate.std > 0.0
