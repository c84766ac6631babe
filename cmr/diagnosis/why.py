"""The decisions of a search, step by step, as a table for a terminal."""

import math
from collections.abc import Sequence
from textwrap import wrap

from cmr.estimation.search.trace import Decision

EXPLAINED = (
    "Each entry is one decision of the search. The model is the one to which the decision applies; model 0 is the "
    "paper's. The statistic is the likelihood ratio: twice the log-likelihood that the effects add to this model, or "
    "that is lost when they are removed. It is compared with the threshold, which is higher where the residuals "
    'contain more than noise; "-" means that there is none. An effect above its threshold can still be rejected: the '
    'reason gives the number that decided and its limit. An effect that is "included" is too small to be named; it '
    'stays in the model during the search, so that it hides no other effect, and is removed at the end. For "not '
    'distinguished", the statistic is how much less the first effect explains than the second.'
)
NOTHING_DECIDED = "The search made no decision: nothing was fitted, or no effect came close to its threshold."
WIDTH, INDENT = 110, 7  # characters of a line, and before a reason
HEADINGS = ("model", "decision", "effects", "statistic", "threshold", "reason")


def why(decisions: Sequence[Decision]) -> str:
    """Return the table of decisions, with an explanation above; each reason is below its row."""
    if not decisions:
        return NOTHING_DECIDED
    actions = max(len(HEADINGS[1]), *(len(decision.action) for decision in decisions))
    effects = max(len(HEADINGS[2]), *(len(effect) for decision in decisions for effect in decision.effects))
    lines = [_line(actions, effects, *HEADINGS[:5]), f"{'':{INDENT}s}{HEADINGS[5]}"]
    for decision in decisions:
        numbers = (_number(decision.statistic), _number(decision.threshold))
        first, *others = decision.effects or ("",)
        lines.append(_line(actions, effects, str(decision.step), decision.action, first, *numbers))
        lines += [_line(actions, effects, "", "", other, "", "") for other in others]
        lines += wrap(decision.reason, WIDTH, initial_indent=" " * INDENT, subsequent_indent=" " * INDENT)
    return "\n".join([*wrap(EXPLAINED, WIDTH), "", *(line.rstrip() for line in lines)])


def _line(actions: int, effects: int, step: str, action: str, effect: str, statistic: str, threshold: str) -> str:
    return f"{step:>5s}  {action:{actions}s}  {effect:{effects}s}  {statistic:>10s}  {threshold:>9s}"


def _number(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}" if math.isfinite(value) else "-"  # avoids -0.0
