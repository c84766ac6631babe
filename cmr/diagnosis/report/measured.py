"""Paths, the improvement, how parameters moved, unexplained residuals, and all residuals."""

import math
from collections.abc import Iterable, Mapping, Sequence

from cmr.diagnosis.report.generic import generic_figure, generic_term
from cmr.diagnosis.report.markup import Html, joined, tag
from cmr.diagnosis.report.numbers import (
    UNKNOWN,
    alike,
    estimate_text,
    fixed,
    given,
    number,
    rounded,
    unit_text,
    with_sign,
)
from cmr.diagnosis.report.pairs import Pair
from cmr.diagnosis.report.path_figure import path_figure
from cmr.diagnosis.report.residual_figures import all_residuals, remaining_figure
from cmr.diagnosis.report.section import code, paragraph, quiet, section
from cmr.diagnosis.report.style import AFTER, BEFORE
from cmr.diagnosis.report.table import table
from cmr.diagnosis.report.terms import regressor, signal_words
from cmr.diagnosis.result import Diagnosis, Fitted, NamedEffect
from cmr.diagnosis.words import share_sentence
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.model.catalogue import DEFINITIONS as OF_MODEL
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS

MOST_PATHS = 4  # drawn; a page with more tells nobody more
MOST_REMAINING = 3  # regressors drawn of what remains
DEFINITIONS = {**PAPER, **CONTROLLER_DEFINITIONS, **OF_MODEL}
MOVED = 1.0  # standard deviations; a parameter that moved by less stayed where it was
GAIN_WORDS = {"psi": "wheel speeds", "yaw_rate": "yaw rate", "pose": "pose"}


def paths(diagnosis: Diagnosis) -> Html:
    """Return the figures of the paths."""
    all_paths = diagnosis.evidence.paths
    changed = diagnosis.is_extended
    more = f"The first {MOST_PATHS} of {len(all_paths)} recordings are drawn." if len(all_paths) > MOST_PATHS else ""
    figures = [path_figure(path, changed=changed) for path in all_paths[:MOST_PATHS]]
    return section("The path", *([paragraph(more)] if more else []), *figures)


def gain(diagnosis: Diagnosis) -> Html:
    """Return by how much errors shrink, and how far the paper's parameters moved."""
    if not diagnosis.is_extended or diagnosis.baseline is None or diagnosis.extended is None:
        return Html("")
    rows = _path_rows(diagnosis.baseline, diagnosis.extended, diagnosis.gain)
    rows += [
        [GAIN_WORDS.get(name, signal_words(name)), "", "", number(ratio, 3), _bar(ratio)]
        for name, ratio in (diagnosis.gain.signals.items() if diagnosis.gain else ())
        if math.isfinite(ratio)
    ]
    intro = (
        "Path errors are root mean square distances of free runs over windows of "
        f"{diagnosis.evidence.window:g} s, each started at the real robot's state. Held-out data were left out of "
        "the fit; the interval of the ratio is from a block bootstrap."
    )
    headings = ("error", "before", "after", "ratio", "comparison")
    told = joined(quiet(intro), table(headings, rows, numbers=(1, 2, 3))) if rows else Html("")
    return section("Improvement", told, _shifts(diagnosis.effects, diagnosis))


def _path_rows(before: Fitted, after: Fitted, found: Gain | None) -> list[list[str]]:
    """Return the rows of the path errors that are known."""
    held_out = found.ratio if found else _ratio(before.held_out_path_rmse, after.held_out_path_rmse)
    interval = " ({} to {})".format(*(number(end, 3) for end in found.interval)) if found and _known(found) else ""
    fitted = _ratio(before.path_rmse, after.path_rmse)
    errors = (before.held_out_path_rmse, after.held_out_path_rmse, before.path_rmse, after.path_rmse)
    told = [f"{error} m" for error in alike(errors)]
    rows = [
        (held_out, ["path, held-out data", *told[:2], f"{number(held_out, 3)}{interval}", _bar(held_out)]),
        (fitted, ["path, fitted data", *told[2:], number(fitted, 3), _bar(fitted)]),
    ]
    return [row for ratio, row in rows if math.isfinite(ratio)]


def _ratio(before: float, after: float) -> float:
    return before / after if after else math.nan


def _known(found: Gain) -> bool:
    return all(math.isfinite(end) for end in found.interval)


def _bar(ratio: float) -> Html:
    """Return two bars: the error before, and below it the error after."""
    if not math.isfinite(ratio) or ratio <= 0.0:
        return Html("")
    longest = max(1.0, 1.0 / ratio)
    bars = [
        tag("rect", x=0, y=y, width=round(120.0 * length / longest, 1), height=6, fill=colour)
        for y, length, colour in ((0, 1.0, BEFORE), (8, 1.0 / ratio, AFTER))
    ]
    words = f"the error after is {100.0 / ratio:.0f} % of that before"
    return tag("div", tag("svg", *bars, viewBox="0 0 120 14", role="img", aria_label=words), class_="bar")


def _shifts(effects: Sequence[NamedEffect], diagnosis: Diagnosis) -> Html:
    """Return by how much each parameter of the paper's model moved when each effect came in, if that can be told."""
    baseline = diagnosis.baseline.estimates if diagnosis.baseline else {}
    rows = [
        [code(name), *_shift(name, by, baseline.get(name)), code(effect.name)]
        for effect in effects
        for name, by in effect.shift.items()
        if _matters(by, baseline.get(name))
    ]
    if not rows:
        return Html("")
    words = (
        "An effect that is missing in a model biases the parameters that it has: they compensate for it in these "
        "drives, and are wrong in others. The table shows how far each parameter moved as effects were added."
    )
    headings = ("parameter", "moved by", "relative change", "when this effect was added")
    heading = tag("h3", "How far the paper's parameters moved")
    return joined(heading, paragraph(words), table(headings, rows, numbers=(1, 2)))


def _matters(by: float, before: Estimate | None) -> bool:
    """Tell whether a parameter moved at all, compared with how well it is known."""
    doubt = before.std if before and math.isfinite(before.std) else 0.0
    return math.isfinite(by) and abs(by) > MOVED * doubt


def _shift(name: str, by: float, before: Estimate | None) -> tuple[str, str]:
    """Return by how much a parameter moved, and the share of its value that this is."""
    moved = f"{with_sign(by, rounded(by, before.std if before else math.nan))} {unit_text(_unit(name))}".rstrip()
    if before is None or not before.value:
        return moved, UNKNOWN
    percent = 100.0 * by / before.value
    return moved, f"{with_sign(percent, fixed(percent, 1))} %"


def _unit(name: str) -> str:
    return DEFINITIONS[name].unit if name in DEFINITIONS else ""


def remains(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> Html:
    """Return what structure no effect of the catalogue explains; nothing where no residual was looked at."""
    unexplained = diagnosis.unexplained
    if not unexplained.present:
        clean = "None: time, command, motion and position predict no residual of the final model."
        return section("Unexplained residuals", paragraph(clean) if pairs else Html(""))
    signal = unexplained.signal or "path"
    by = " and ".join(regressor(name).words for name in unexplained.regressors) or "the regressors together"
    words = (
        f"No effect in the catalogue explains all errors of the {signal_words(signal)} in the final model: "
        f"{share_sentence(unexplained, signal_words(signal), by)}. A one-step prediction error is a reading minus the "
        "prediction of the final model, which is corrected by all earlier readings."
    )
    shown = [p for name in unexplained.regressors for p in pairs if (p.signal, p.regressor) == (signal, name)]
    caption = f"Residuals of the {signal_words(signal)} in the final model. A complete model leaves flat lines."
    left = remaining_figure(shown[:MOST_REMAINING], caption) if shown else Html("")
    figure = generic_figure(diagnosis) or left
    return section("Unexplained residuals", paragraph(words), generic_term(diagnosis), figure)


def parameters(diagnosis: Diagnosis) -> Html:
    """Return the parameters of both models side by side; of the paper's alone where nothing was added to it."""
    before = diagnosis.baseline.estimates if diagnosis.baseline else {}
    after = diagnosis.extended.estimates if diagnosis.extended else {}
    others = diagnosis.parameters
    names = _in_order({*before, *after, *others})
    if not names:
        return Html("")
    if diagnosis.is_extended:
        headings = ["parameter", "meaning", "paper's model", "extended model"]
        known = {name: value for name, value in others.items() if name in PAPER and name not in after}
        models = [[_value(name, before, known), _value(name, after, others)] for name in names]
    else:
        headings = ["parameter", "meaning", "value"]
        models = [[_value(name, before, others)] for name in names]
    rows = [[code(name), _meaning(name), *values] for name, values in zip(names, models, strict=True)]
    given_ones = quiet("Values without \u00b1 were given, not fitted.")
    return section("Parameters", table(headings, rows, numbers=(2, 3)), given_ones)


def _in_order(names: Iterable[str]) -> list[str]:
    """Return names in the order of the catalogue, unknown ones last."""
    known = list(DEFINITIONS)
    return sorted(names, key=lambda name: (known.index(name) if name in DEFINITIONS else len(known), name))


def _meaning(name: str) -> str:
    return DEFINITIONS[name].meaning if name in DEFINITIONS else ""


def _value(name: str, estimates: Mapping[str, Estimate], others: Mapping[str, float]) -> str:
    if name in estimates:
        return estimate_text(estimates[name], _unit(name))
    return given(others[name], _unit(name)) if name in others else UNKNOWN


def residuals(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> Html:
    """Return small multiples of all residuals."""
    if not pairs:
        return Html("")
    words = (
        "Each measured signal minus the prediction of the model, against all quantities that might predict it. A "
        "complete model leaves flat lines at zero. Marks are means in bins with standard errors that allow for "
        "correlated errors; grey dots are single samples. Errors of the pose are those that accumulate over a second."
    )
    return section("All residuals", paragraph(words), all_residuals(pairs, changed=diagnosis.is_extended))
