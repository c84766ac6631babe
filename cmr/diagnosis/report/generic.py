"""The generic term that extends the model if structure remains unexplained."""

import math

from cmr.diagnosis.report.estimate_text import estimate_text, interval_text
from cmr.diagnosis.report.pairs import pairs_without
from cmr.diagnosis.report.residual_figures import tell_tale_figure
from cmr.diagnosis.report.terms import regressor, signal_words
from cmr.diagnosis.result import GENERIC, Diagnosis
from cmr.estimation.estimates import Estimate
from cmr.model.catalogue import DEFINITIONS, effects_on
from cmr.report.markup import Html, joined, tag
from cmr.report.numbers import likelihood, number
from cmr.report.section import code, paragraph
from cmr.report.table import table


def generic_term(diagnosis: Diagnosis) -> Html:
    """Describe the generic term and its gain; empty without one."""
    term = diagnosis.unexplained.generic
    if term is None:
        return Html("")
    worth = f"It adds {likelihood(term.held_out)} to the log-likelihood of data left out of the fit"
    if math.isfinite(term.gain.ratio):
        worth += f", and makes path errors of free runs there {number(term.gain.ratio, 3)} times smaller"
    words = (
        f"The extended model therefore has {GENERIC}: a sum of products of command and motion, found by sparse "
        f"regression. {worth}. It predicts drives like these without giving a cause; drives of another kind may need "
        "other products."
    )
    rows = [_row(name, estimate) for name, estimate in term.estimates.items()]
    heading = tag("h3", GENERIC[0].upper() + GENERIC[1:])
    return joined(heading, paragraph(words), table(("parameter", "meaning", "value", "95 %"), rows, numbers=(2, 3)))


def generic_figure(diagnosis: Diagnosis) -> Html:
    """Return the figure of unexplained residuals with and without the generic term; empty without one."""
    unexplained = diagnosis.unexplained
    if unexplained.generic is None:
        return Html("")
    on = effects_on({name: estimate.value for name, estimate in unexplained.generic.estimates.items()})
    pairs = [pair for effect in on for pair in pairs_without(diagnosis.evidence.residuals, effect.name)]
    shown = [pair for pair in pairs if pair.signal == unexplained.signal and pair.regressor in unexplained.regressors]
    if not shown:
        return Html("")
    pair = max(shown, key=lambda pair: pair.removed)
    words = f"{signal_words(pair.signal)} over {regressor(pair.regressor).words}"
    caption = f"Residual of the {words} without and with the generic term. A complete model leaves a flat line."
    return tell_tale_figure(pair, caption, "the generic term")


def _row(name: str, estimate: Estimate) -> list[str]:
    known = DEFINITIONS[name]
    return [code(name), known.meaning, estimate_text(estimate, known.unit), interval_text(estimate)]
