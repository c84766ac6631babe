"""The effect wheel_speed_latency: read off the gyro beside the wheels, before anything is fitted."""

from dataclasses import replace

from cmr.estimation.estimates import Estimate
from cmr.estimation.search.chance import read_off
from cmr.estimation.search.criteria import THRESHOLD
from cmr.estimation.search.selection import Search
from cmr.estimation.search.trace import ADDED, Decision
from cmr.recordings.lags import Lag

NAME = "wheel_speed_latency"
WHY = "The gyro turns before the wheels do: their lag was estimated from this and corrected before the search."


def with_late_wheels(found: Search, late: Lag | None) -> Search:
    """Add the effect of wheels that report `late` to a search of recordings in which this was corrected."""
    if late is None:
        return found
    statistic = (late.seconds / late.std) ** 2
    one = read_off(NAME, Estimate(late.seconds, late.std), statistic, (), found.final)
    named = sorted([*found.named, one], key=lambda other: -other.candidate.drop)
    return replace(
        found, named=named, decisions=(Decision(0, ADDED, (NAME,), statistic, THRESHOLD, WHY), *found.decisions)
    )
