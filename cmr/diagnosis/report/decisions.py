"""The decisions of the search in a folded table: why each effect was named or not."""

from cmr.diagnosis.report.markup import Html, tag
from cmr.diagnosis.report.numbers import likelihood, typeset
from cmr.diagnosis.report.section import codes, quiet, section
from cmr.diagnosis.report.table import table
from cmr.diagnosis.result import Diagnosis
from cmr.diagnosis.why import EXPLAINED, HEADINGS
from cmr.estimation.search.trace import Decision


def decisions(diagnosis: Diagnosis) -> Html:
    """Return the table of the decisions, folded; nothing where nothing was decided."""
    rows = [_row(decision) for decision in diagnosis.decisions]
    if not rows:
        return Html("")
    count = f"{len(rows)} decision{'s' if len(rows) > 1 else ''} of the search"
    explained = quiet(EXPLAINED.replace('"-" means', "a dash means"))
    return section("Why", tag("details", tag("summary", count), explained, table(HEADINGS, rows, numbers=(3, 4))))


def _row(decision: Decision) -> list[str]:
    return [
        str(decision.step),
        decision.action,
        codes(decision.effects),
        likelihood(decision.statistic),
        likelihood(decision.threshold),
        typeset(decision.reason),
    ]
