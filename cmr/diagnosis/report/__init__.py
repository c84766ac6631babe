"""The report of a diagnosis: one page of HTML that needs nothing beside it, for a screen, a phone and paper.

`page` puts it together from `found` (effects and evidence), `measured` (paths, parameters, residuals), `improvement`
(errors before and after) and `origin` (data).
`tell_tale` chooses the plot that shows an effect, among the `pairs` of residual and regressor, by their `binned` means.
`track` finds where the models part, `path_figure` and `residual_figures` draw; `terms` words things. How pages are made
and drawn is in `cmr.report`.
"""

from cmr.diagnosis.report.page import report_of, write_report

__all__ = ["report_of", "write_report"]
