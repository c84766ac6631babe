"""The decisions of the search as a collapsed table: why each effect was named or not."""

from cmr.diagnosis.result import Diagnosis
from cmr.diagnosis.why import EXPLAINED, HEADINGS
from cmr.estimation.search.trace import Decision
from cmr.report.numbers import likelihood, typeset
from cmr.report.section import Section, codes, folded, quiet, section
from cmr.report.table import table


def decisions(diagnosis: Diagnosis) -> Section:
    """Return the collapsed table of decisions; empty without decisions."""
    rows = [_row(decision) for decision in diagnosis.decisions]
    if not rows:
        return section("Why")
    count = f"{len(rows)} decision{'s' if len(rows) > 1 else ''} of the search"
    explained = quiet(EXPLAINED.replace('"-" means', "a dash means"))
    return section("Why", folded(count, explained, table(HEADINGS, rows, numbers=(3, 4))))


def _row(decision: Decision) -> list[str]:
    return [
        str(decision.step),
        decision.action,
        codes(decision.effects),
        likelihood(decision.statistic),
        likelihood(decision.threshold),
        typeset(decision.reason),
    ]
