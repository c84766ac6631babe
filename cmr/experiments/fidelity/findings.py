"""Findings of a study: the distance of each preparation from real teams, by metric, and the effect of calibration."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmr.experiments.fidelity.distances import CHANCE, NO_GAP, NOT_SHOWN, WIDENS, Closing, Distance, closing, distance
from cmr.experiments.fidelity.study import PREPARATIONS, PREPARED, REAL_A, REAL_B, UNCALIBRATED, Scores
from cmr.experiments.team.metrics import UNITS

ENOUGH = 10  # experiments of each kind; with fewer, the report contains a warning
USUAL = 20

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """One metric: its values by set and preparation, each of shape (seeds,), and the conclusions.

    `floor` is the distance of the two sets of real teams, `distances` and `closings` are by preparation; the latter are
    relative to the distance without calibration.
    """

    metric: str
    values: Mapping[str, Floats]
    floor: Distance
    distances: Mapping[str, Distance]
    closings: Mapping[str, Closing]

    @property
    def unit(self) -> str:
        """The metric's unit."""
        return UNITS[self.metric]


def findings_of(scores: Mapping[str, Sequence[Scores]]) -> list[Finding]:
    """Return the finding of each meaningful metric, from scores by set and preparation."""
    metrics = [metric for metric in UNITS if not any(np.isnan(one[metric]) for one in scores[REAL_A])]
    return [_finding(metric, {name: _values(ones, metric) for name, ones in scores.items()}) for metric in metrics]


def _values(scores: Sequence[Scores], metric: str) -> Floats:
    return np.array([one[metric] for one in scores], dtype=float)


def _finding(metric: str, values: Mapping[str, Floats]) -> Finding:
    prepared = [name for name in PREPARATIONS if name in values]
    floor = distance(values[REAL_A], values[REAL_B])
    return Finding(
        metric=metric,
        values=values,
        floor=floor,
        distances={name: distance(values[REAL_A], values[name]) for name in prepared},
        closings={
            name: closing(values[REAL_A], values[UNCALIBRATED], values[name], floor.value)
            for name in prepared
            if name != UNCALIBRATED and UNCALIBRATED in prepared
        },
    )


def conclusions(scores: Mapping[str, Sequence[Scores]], findings: Sequence[Finding]) -> list[str]:
    """Return all conclusions of a study, as sentences."""
    return [*sentences(findings), *failures(scores), *cautions(findings)]


def sentences(findings: Sequence[Finding]) -> list[str]:
    """Return the main conclusions: for each preparation and metric, whether the gap is closed."""
    return [_sentence(finding, name, closed) for finding in findings for name, closed in finding.closings.items()]


def failures(scores: Mapping[str, Sequence[Scores]]) -> list[str]:
    """Return a sentence for each preparation that failed in some laboratories."""
    found = []
    for name in (name for name in PREPARATIONS if name in scores):
        shares = [one.get(PREPARED, 1.0) for one in scores[name]]
        never, partly = sum(share == 0.0 for share in shares), sum(0.0 < share < 1.0 for share in shares)
        if never:
            found.append(
                f"{name}: in {never} of {len(shares)} laboratories nothing was found; there virtual robots moved with "
                "the believed parameters."
            )
        if partly:
            found.append(
                f"{name}: in {partly} of {len(shares)} laboratories a robot could not be calibrated and was left out."
            )
    return found


def _sentence(finding: Finding, name: str, closed: Closing) -> str:
    before, after, unit = finding.distances[UNCALIBRATED], finding.distances[name], finding.unit
    said = f"{finding.metric}, {name}: "
    if closed.verdict == NO_GAP:
        return (
            f"{said}{NO_GAP}: without calibration {before.value:.3g} {unit} from real teams{_by_chance(before)}; "
            f"they differ by {finding.floor.value:.3g} {unit} among themselves."
        )
    if np.isnan(closed.share):
        return f"{said}{closed.verdict}: there was none, and now it is {after.value:.3g} {unit}."
    change = f"from {before.value:.3g} to {after.value:.3g} {unit}{_by_chance(after)}"
    sign = -100.0 if closed.verdict == WIDENS else 100.0
    low, high = sorted((sign * closed.low, sign * closed.high))
    interval = f"{sign * closed.share:.0f} % ({low:.0f} to {high:.0f} %)"
    if closed.verdict == NOT_SHOWN:
        return f"{said}{NOT_SHOWN}: {interval} of it, {change}."
    return f"{said}{closed.verdict} by {interval}: {change}."


def _by_chance(one: Distance) -> str:
    """Return a clause with the p-value if the distance may be due to chance."""
    return f", no more than expected by chance (p = {one.p_value:.2f})" if one.p_value > CHANCE else ""


def cautions(findings: Sequence[Finding]) -> list[str]:
    """Return a warning if there are too few experiments."""
    count = min((len(finding.values[REAL_A]) for finding in findings), default=ENOUGH)
    if count >= ENOUGH:
        return []
    return [f"These are {count} experiments of each kind, in which only large differences show; {USUAL} show more."]


def rows(findings: Sequence[Finding]) -> Iterator[dict[str, str | float]]:
    """Yield the table: a row for each metric and set, numbers in the metric's unit."""
    for finding in findings:
        real = {"real teams among themselves": finding.floor}
        for name, one in (*real.items(), *finding.distances.items()):
            closed = finding.closings.get(name)
            yield {
                "metric": finding.metric,
                "unit": finding.unit,
                "compared": name,
                "mean": float(np.mean(finding.values[REAL_B if one is finding.floor else name])),
                "distance": one.value,
                "low": one.low,
                "high": one.high,
                "p_value": one.p_value,
                "closed": closed.share if closed else float("nan"),
                "closed_low": closed.low if closed else float("nan"),
                "closed_high": closed.high if closed else float("nan"),
                "verdict": closed.verdict if closed else "",
            }


def table(findings: Sequence[Finding]) -> str:
    """Return the table for a terminal."""
    lines = [
        f"{'metric':19s} {'compared with real teams':27s} {'mean':>8s} {'distance':>9s} {'95 % interval':>18s} "
        f"{'chance':>7s}  verdict"
    ]
    for row in rows(findings):
        interval = f"{row['low']:.3g} to {row['high']:.3g}"
        lines.append(
            f"{row['metric']:19s} {row['compared']:27s} {row['mean']:8.3g} {row['distance']:7.3g} {row['unit']} "
            f"{interval:>18s} {row['p_value']:7.3f}  {row['verdict']}".rstrip()
        )
    return "\n".join(lines)
