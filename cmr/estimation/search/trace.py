"""What a search decided, step by step, and why: the table that `cmr-diagnose --why` prints."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

ADDED, REPLACED, REMOVED, REJECTED = "added", "replaced", "removed", "not added"


@dataclass(frozen=True)
class Decision:
    """One decision of a search.

    `step` counts the models from 0, the paper's. `effects` are those that the `action` concerns. `statistic` is the
    likelihood-ratio statistic of the decision, the drop of the sum of squared white errors, and `threshold` the value
    with which it was compared; NaN where there is none. `reason` is a sentence.
    """

    step: int
    action: str
    effects: tuple[str, ...]
    statistic: float
    threshold: float
    reason: str


def with_removed(
    decisions: Sequence[Decision], removed: Iterable[tuple[str, float]], reason: str
) -> tuple[Decision, ...]:
    """Return decisions with those that took back effects, each with its statistic, once the search was over."""
    step = max((decision.step for decision in decisions), default=0)
    return (*decisions, *(Decision(step, REMOVED, (name,), drop, math.nan, reason) for name, drop in removed))


@dataclass
class Trace:
    """The decisions of a search so far."""

    decisions: list[Decision] = field(default_factory=list)
    step: int = 0

    def note(
        self, action: str, effects: Sequence[str], statistic: float, threshold: float = float("nan"), reason: str = ""
    ) -> None:
        """Add a decision to the present step."""
        self.decisions.append(Decision(self.step, action, tuple(effects), statistic, threshold, reason))
