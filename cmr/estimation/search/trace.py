"""The decisions of a search, step by step, with reasons: the table that `cmr-diagnose --why` prints."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

# INCLUDED: too small to be named, but kept in the model during the search so that it does not hide other effects.
ADDED, INCLUDED, REPLACED, REMOVED, REJECTED = "added", "included", "replaced", "removed", "not added"
INDISTINCT = "not distinguished"


@dataclass(frozen=True)
class Measure:
    """The number that decided, and the limit with which it was compared, both in `unit`.

    `quantity` is the name of a parameter or of a statistic, `sentence` states the comparison in words.
    """

    quantity: str
    value: float
    limit: float
    unit: str
    sentence: str


@dataclass(frozen=True)
class Decision:
    """One decision of a search.

    `step` counts the models from 0, the paper's. `effects` are those that the `action` concerns. `statistic` is the
    likelihood-ratio statistic of the decision, the drop of the sum of squared white errors, and `threshold` the value
    with which it was compared; NaN where there is none. For INDISTINCT, `statistic` is the difference to the
    likelihood ratio of the effect named. `reason` is a sentence, `measures` the numbers in it that decided.
    """

    step: int
    action: str
    effects: tuple[str, ...]
    statistic: float
    threshold: float
    reason: str
    measures: tuple[Measure, ...] = ()


def with_removed(
    decisions: Sequence[Decision], removed: Iterable[tuple[str, float]], reason: str, measures: tuple[Measure, ...] = ()
) -> tuple[Decision, ...]:
    """Return decisions with those that removed effects after the search, each with its statistic."""
    step = max((decision.step for decision in decisions), default=0)
    return (*decisions, *(Decision(step, REMOVED, (name,), drop, math.nan, reason, measures) for name, drop in removed))


def with_rivals(decisions: Sequence[Decision], rivals: Iterable[tuple[str, str]]) -> tuple[Decision, ...]:
    """Return decisions with a row for each pair (named effect, rival) whose likelihood ratios were not compared."""
    step = max((decision.step for decision in decisions), default=0)
    tied = {decision.effects for decision in decisions if decision.action == INDISTINCT}
    return (
        *decisions,
        *(
            Decision(step, INDISTINCT, (rival, name), math.nan, math.nan, f"It explains the data as well as {name}.")
            for name, rival in rivals
            if (rival, name) not in tied
        ),
    )


class Row(NamedTuple):
    """A decision without its step; measures of None are skipped."""

    action: str
    effects: Sequence[str]
    statistic: float
    threshold: float = math.nan
    reason: str = ""
    measures: Iterable[Measure | None] = ()


@dataclass
class Trace:
    """The decisions of a search so far."""

    decisions: list[Decision] = field(default_factory=list)
    step: int = 0

    def note(self, *rows: Row) -> None:
        """Add decisions to the current step."""
        for action, effects, statistic, threshold, reason, measures in rows:
            known = tuple(measure for measure in measures if measure is not None)
            self.decisions.append(Decision(self.step, action, tuple(effects), statistic, threshold, reason, known))
