"""The metrics of a live run at any moment, and whether one exceeds the bound that ends the run."""

import math
import time
from collections.abc import Sequence

import numpy as np

from cmr.experiments.live.watch import Floats, TeamWatch
from cmr.experiments.team.metrics import UNITS
from cmr.experiments.team.plan import Scenario
from cmr.experiments.team.scoring import scores

MOST_MOMENTS = 1500  # moments a report is computed from; some metrics compare all pairs of moments
MOMENTS_WHILE_DRIVING = 300
PERIOD = 0.1  # s between evaluations of a metric, at least, as positions are not more frequent
SHARE = 0.05  # of the time, at most, spent on evaluations


def measure(
    scenario: Scenario,
    watch: TeamWatch,
    chosen: Sequence[str],
    most_moments: int = MOST_MOMENTS,
    over: float = math.inf,
) -> dict[str, float]:
    """Return metrics of a team, in the units of `UNITS`; undefined ones are missing or NaN.

    They are measured since all robots were ready, or in the last `over` [s], at moments with all robots present.
    Metrics that the watch updates continuously are taken from there.
    """
    if not watch.first_utime:
        return {}
    kept = {name: watch.measure(name) for name in chosen if name in watch.MEASURED}
    others = [name for name in chosen if name not in kept]
    if not others:
        return kept
    since = max(watch.first_utime, watch.utime - over * 1e6)
    there = np.flatnonzero(watch.track.utime >= since)
    there = there[:: math.ceil(len(there) / most_moments) or 1]
    places: Floats = watch.track.places[there].astype(np.float64)
    whole = np.isfinite(places).all(axis=(1, 2))
    if np.count_nonzero(whole) < 2:
        return kept
    utimes = watch.track.utime[there[whole]]
    seconds = np.asarray(utimes - watch.first_utime, dtype=np.float64) * 1e-6
    x, y = places[whole].transpose(1, 0, 2)
    return kept | scores(scenario, watch.ids.tolist(), seconds, x, y, others)


class EndingMetric:
    """Detects when the metric of a scenario's `ends_when` exceeds its bound."""

    def __init__(self, scenario: Scenario, watch: TeamWatch) -> None:
        self._scenario = scenario
        self._watch = watch
        self._next = 0.0  # s since all were ready, of the next evaluation

    def reason(self, seconds: float) -> str:
        """Return, `seconds` after all were ready, why the run is over; empty while it is not."""
        ending = self._scenario.ends_when
        if ending.metric is None or seconds < max(self._next, ending.after, ending.over or 0.0):
            return ""
        began = time.perf_counter()
        found = measure(self._scenario, self._watch, [ending.metric], MOMENTS_WHILE_DRIVING, ending.over or math.inf)
        self._next = seconds + max(PERIOD, (time.perf_counter() - began) / SHARE)
        return _beyond(ending.metric, found.get(ending.metric, math.nan), ending.below, ending.above)


def _beyond(metric: str, value: float, below: float | None, above: float | None) -> str:
    """Describe how a metric exceeds its bound; empty if it does not, or is NaN."""
    words = f"the {metric.replace('_', ' ')} is {value:.3g} {UNITS[metric]}"
    if below is not None and value < below:
        return f"{words}, below {below:g}"
    return f"{words}, above {above:g}" if above is not None and value > above else ""
