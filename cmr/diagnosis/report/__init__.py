"""The report of a diagnosis: one self-contained HTML page, for screens, phones and paper.

`page` puts it together from `found` (effects and evidence), `measured` (paths, parameters, residuals), `improvement`
(errors before and after) and `origin` (data). `tell_tale` chooses the plot that shows an effect best, among the `pairs`
of residual and regressor, by their `binned` means. `track` finds where the models differ, `path_figure` and
`residual_figures` draw; `terms` names quantities. Pages and drawing are in `cmr.report`.
"""

from cmr.diagnosis.report.page import report_of, write_report

__all__ = ["report_of", "write_report"]
