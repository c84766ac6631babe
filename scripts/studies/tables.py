"""The results of scripts/study_diagnosis as text."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.model.catalogue import CATALOGUE
from tests.hidden_effects.judging import (
    covered,
    may_be,
    parameters_of,
    parameters_right,
    right_first,
    wrongly_named,
)
from tests.hidden_effects.rows import Row
from tests.hidden_effects.scoring import Score, scores


def report(rows: Sequence[Row]) -> str:
    """Return the scores of each set and of each effect, and the errors."""
    texts = [f"```text\n{text}\n```" for text in (effects_table(rows), errors_table(rows)) if text]
    return "\n\n".join([scores_table(scores(rows)), *texts]) + "\n"


def scores_table(found: Sequence[Score]) -> str:
    """Return a Markdown table with a row for each score."""
    lines = ["| set | score | value | logs | goal |", "|---|---|---|---|---|"]
    for score in found:
        value = f"{100.0 * score.value:.1f} %" if score.unit == "%" else f"{score.value:.3g} {score.unit}".strip()
        missed = " (**missed**)" if score.reached is False else ""
        lines.append(f"| {score.set_name} | {score.quantity} | {value} | {score.count} | {score.goal}{missed} |")
    return "\n".join(lines)


def effects_table(rows: Sequence[Row]) -> str:
    """Return one line for each effect, with its scores on the rich drive and on figure-eights."""
    lines = [
        "Each effect. Rich drive: right name first; parameter right; intervals that contain the true value; error in",
        "standard deviations (root mean square). Figure-eights: right first, in the set, nothing named, wrongly named.",
        " " * 24
        + "".join(f" {title:>6s}" for title in ("right", "param", "held", "error"))
        + " "
        + "".join(f" {title:>6s}" for title in ("right", "set", "none", "wrong")),
    ]
    for effect in CATALOGUE:
        rich, eights = (
            [row for row in rows if row.set_name == name and row.case.effects == (effect,)]
            for name in ("single", "eight")
        )
        if rich or eights:
            lines.append(f"{effect:24s} {_of_rich(rich)}  {_of_eights(eights)}".rstrip())
    return "\n".join(lines) if len(lines) > 3 else ""


def errors_table(rows: Sequence[Row]) -> str:
    """Return the errors and the number of times that each occurred."""
    texts = [row.error for row in rows if row.error]
    lines = [f"{texts.count(text):5d} times: {text}" for text in dict.fromkeys(texts)]
    return "\n".join(["Errors", *lines[:30]]) if lines else ""


def _of_rich(rows: Sequence[Row]) -> str:
    right = [row for row in rows if right_first(row)]
    held = [inside for row in right for inside in covered(row)]
    normal = [
        (estimate[0] - true) / estimate[1]
        for row in right
        for name, (true, estimate) in parameters_of(row).items()
        if estimate[1] > 0.0 and not name.endswith("_phase")
    ]
    error = f"{math.sqrt(np.mean(np.square(normal))):6.1f}" if normal else f"{'-':>6s}"
    parameters = _percent(sum(map(parameters_right, right)), len(right))
    return f"{_percent(len(right), len(rows))} {parameters} {_percent(sum(held), len(held))} {error}"


def _of_eights(rows: Sequence[Row]) -> str:
    in_set = [row for row in rows if row.names and may_be(row, 0, row.case.effects[0])]
    counts = (
        sum(map(right_first, rows)),
        len(in_set),
        sum(not row.names for row in rows),
        sum(map(wrongly_named, rows)),
    )
    return " ".join(_percent(count, len(rows)) for count in counts)


def _percent(count: int, of: int) -> str:
    return f"{100.0 * count / of:5.0f}%" if of else f"{'-':>6s}"
