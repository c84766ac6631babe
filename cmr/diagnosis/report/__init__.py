"""The report of a diagnosis: one page of HTML that needs nothing beside it, for a screen, a phone and paper.

`page` puts it together from `sections`, `tables`, `figures`, `multiples`; `tell_tale` chooses the plot that shows an
effect; `binned` looks for structure in residuals; `svg` draws, `markup` escapes, `numbers` and `terms` word things.
"""

from cmr.diagnosis.report.page import report_of, write_report

__all__ = ["report_of", "write_report"]
