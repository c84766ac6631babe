"""Why a search named what it named: its decisions, step by step, as a table for a terminal."""

import math
from collections.abc import Sequence
from textwrap import wrap

from cmr.estimation.search.trace import Decision

EXPLAINED = (
    "Each line is one decision about the model of that number; model 0 is the paper's. The statistic is twice the "
    "log-likelihood that the effects add to this model, or take with them. The threshold is how much an effect must "
    "add at least: more where the residuals hold more than noise. An effect above its threshold can still fail "
    'another test; the reason names it. "-": this decision does not compare the two. Where the search begins again, '
    "the numbers of the models go on."
)
NOTHING_DECIDED = "The search made no decision: nothing was fitted, or no effect came close to its threshold."
WIDTH, NARROWEST = 110, 30  # characters of a line, and of its reason at least
HEADINGS = ("model", "decision", "effects", "statistic", "threshold", "reason")


def why(decisions: Sequence[Decision]) -> str:
    """Return the table of the decisions, with what explains it above."""
    if not decisions:
        return NOTHING_DECIDED
    effects = max(len(HEADINGS[2]), *(len(effect) for decision in decisions for effect in decision.effects))
    lines = [_line(effects, *HEADINGS)]
    for decision in decisions:
        numbers = (_number(decision.statistic), _number(decision.threshold))
        first, *others = decision.effects or ("",)
        start = _line(effects, str(decision.step), decision.action, first, *numbers, "")
        reasons = wrap(decision.reason, max(WIDTH - len(start), NARROWEST)) or [""]
        lines.append((start + reasons[0]).rstrip())
        for place in range(max(len(others), len(reasons) - 1)):
            effect = others[place] if place < len(others) else ""
            reason = reasons[place + 1] if place + 1 < len(reasons) else ""
            lines.append(_line(effects, "", "", effect, "", "", reason).rstrip())
    return "\n".join([*wrap(EXPLAINED, WIDTH), "", *lines])


def _line(width: int, step: str, action: str, effect: str, statistic: str, threshold: str, reason: str) -> str:
    return f"{step:>5s}  {action:9s}  {effect:{width}s}  {statistic:>10s}  {threshold:>9s}  {reason}"


def _number(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}" if math.isfinite(value) else "-"  # no -0.0
