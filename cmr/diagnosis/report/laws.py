"""Laws: their description, and the residual over a law's own variable with the law as a curve."""

import math
from collections.abc import Sequence

import numpy as np

from cmr.diagnosis.laws import law_sentence, rival_text
from cmr.diagnosis.report.estimate_text import estimate_text, interval_text
from cmr.diagnosis.result import Diagnosis
from cmr.estimation.laws.result import NO_LAW, TIE, Course, Curve, LawFound, Laws
from cmr.report.keys import DASHES, after_key, before_key, found_key, keys
from cmr.report.markup import Html, tag
from cmr.report.numbers import likelihood, number, typeset, unit_text
from cmr.report.section import Section, bullets, code, paragraph, quiet, section
from cmr.report.style import AFTER, BEFORE, FOUND
from cmr.report.svg import Curve as Drawn
from cmr.report.svg import Frame, Range, dots, error_bars, line, plot, squares, zero_line
from cmr.report.table import table

SIZE = {"width": 390.0, "height": 275.0}
ANSWERS = {
    "law": "A law: no further formula would explain anything beside it.",
    "approximation": "An approximation of something unknown: it helps, and leaves structure in the residuals.",
    "tie": "A tie: the formulas below, or the effects named, explain these data equally well.",
}
KEEP = (
    "The law is part of the parameter file of this diagnosis, and every simulation of the robot uses it. cmr-laws "
    "lists it beside those of other robots, and keeps it under a name of your own: see docs/how_to/keep_a_law.md."
)
NOT_USED = "No law is used."


def laws(diagnosis: Diagnosis) -> Section:
    """Return the result of the search for laws; empty if there is nothing to report."""
    answer = diagnosis.laws
    if answer.answer == NO_LAW:
        open_question = bool(answer.manoeuvre) or diagnosis.unexplained.present
        reasons = " ".join(answer.reasons)
        return section("Laws", paragraph(f"{NOT_USED} {reasons}") if reasons and open_question else Html(""))
    if not answer.found:
        rivals, reasons = (bullets([typeset(text) for text in texts]) for texts in (_rivals(answer), answer.reasons))
        return section("Laws", paragraph(f"{ANSWERS[TIE]} {NOT_USED}"), rivals, reasons)
    rmse = diagnosis.extended.held_out_path_rmse if diagnosis.extended else math.nan
    sentences = [tag("h3", code(one.law.name), f": {typeset(law_sentence(one, rmse))}") for one in answer.found]
    rows = [row for one in answer.found for row in _rows(one)]
    parts = [
        paragraph(ANSWERS.get(answer.answer, answer.answer)),
        *sentences,
        *(_figure(curve) for curve in answer.curve),
        table(("coefficient", "of", "value", "95 %"), rows, numbers=(2, 3)),
        quiet(_evidence(answer.found)),
        bullets([typeset(reason) for reason in answer.reasons]),
    ]
    if answer.rivals:
        parts += [
            paragraph("These data cannot distinguish it from:"),
            bullets([typeset(text) for text in _rivals(answer)]),
        ]
    return section("Laws", *parts, quiet(KEEP))


def _rivals(answer: Laws) -> list[str]:
    return [rival_text(one) for one in answer.rivals]


def _rows(found: LawFound) -> list[list[str]]:
    units = found.law.units
    formulas = dict(zip(found.law.coefficients, found.law.formulas, strict=True))
    return [
        [code(name), code(formulas.get(name, "")), estimate_text(one, units[name]), interval_text(one)]
        for name, one in found.estimates.items()
    ]


def _evidence(found: Sequence[LawFound]) -> str:
    if not found:
        return ""
    one = found[0]
    words = (
        f"The score is {likelihood(one.score)}: the drop of \u22122 log likelihood, minus what a search among so many "
    )
    words += "formulas finds by chance. On data left out of the fit, the log likelihood grows by "
    return words + f"{likelihood(one.held_out)}. The best further formula has a score of {likelihood(one.left)}."


def _figure(curve: Curve) -> Html:
    """Return the residual over a law's variable, on fitted and on held-out data, with common axes."""
    courses = [("data fitted", curve.training), *([("data held out", curve.held_out)] if curve.held_out else [])]
    limit = _limit([course for _, course in courses])
    plots = [_plot(curve, course, title, limit) for title, course in courses]
    caption = (
        f"What the model lacks at the place of {curve.law}, over {curve.variable}: without the law, and with it. The "
        "law follows what is lacking without it; a complete model leaves a flat line."
    )
    entries = keys(
        before_key("without the law, \u00b1 1 standard error", marked=True),
        after_key("with the law", marked=True),
        found_key("the law"),
    )
    return tag("figure", entries, tag("div", *plots, class_="plots"), tag("figcaption", caption))


def _plot(curve: Curve, course: Course, title: str, limit: Range) -> Html:
    at = course.at
    room = 0.05 * float(np.ptp(at)) if len(at) > 1 else 0.5
    frame = Frame(x=(float(np.min(at)) - room, float(np.max(at)) + room), y=limit, **SIZE)
    unit = unit_text(curve.place_unit)
    return plot(
        frame,
        zero_line(frame),
        line(frame, at, course.law, FOUND, 5.0, curve=Drawn(f"law [{unit}]")),
        line(frame, at, course.before, BEFORE, 1.1, dashes=DASHES, curve=Drawn(f"without [{unit}]", error=course.std)),
        error_bars(frame, at, course.before, course.std, BEFORE),
        squares(frame, at, course.before, BEFORE, 4.6),
        line(frame, at, course.after, AFTER, 1.1, curve=Drawn(f"with [{unit}]", error=course.std)),
        dots(frame, at, course.after, AFTER, 5.5),
        x_label=f"{curve.variable} [{unit_text(curve.unit)}]" if curve.unit != "-" else curve.variable,
        y_label=f"real \u2212 model [{unit}]",
        title=title,
        alt=_alt(curve, course, title, unit),
    )


def _limit(courses: Sequence[Course]) -> Range:
    """Return a range that contains zero and all that is drawn."""
    ends = [(one.before - one.std, one.before + one.std, one.after, one.law) for one in courses]
    drawn = np.concatenate([np.concatenate(arrays) for arrays in ends])
    drawn = drawn[np.isfinite(drawn)]
    low, high = float(np.min(drawn, initial=0.0)), float(np.max(drawn, initial=0.0))
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def _alt(curve: Curve, course: Course, title: str, unit: str) -> str:
    """Return in words what a plot shows."""
    if not np.any(np.isfinite(course.before)):
        return f"{curve.law} over {curve.variable}, {title}: too few data."
    largest = (number(float(np.nanmax(np.abs(one))), 2) for one in (course.before, course.after))
    without, with_it = largest
    return f"{curve.law} over {curve.variable}, {title}: at most {without} {unit} without it, {with_it} {unit} with it."
