"""Paths, unexplained residuals, parameters, and all residuals."""

from collections.abc import Iterable, Mapping, Sequence

from cmr.diagnosis.report.estimate_text import estimate_text
from cmr.diagnosis.report.generic import generic_figure, generic_term
from cmr.diagnosis.report.pairs import Pair
from cmr.diagnosis.report.path_figure import path_figure
from cmr.diagnosis.report.residual_figures import all_residuals, remaining_figure
from cmr.diagnosis.report.terms import regressor, signal_words
from cmr.diagnosis.result import Diagnosis
from cmr.diagnosis.words import share_sentence
from cmr.estimation.estimates import Estimate
from cmr.model.catalogue import DEFINITIONS as OF_MODEL
from cmr.model.parameters import DEFINITIONS as PAPER
from cmr.model.parameters import ParameterDefinition
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS
from cmr.report.markup import Html
from cmr.report.numbers import (
    UNKNOWN,
    given,
)
from cmr.report.section import Section, code, folded, paragraph, quiet, section
from cmr.report.table import table

MOST_REMAINING = 3  # regressors drawn for unexplained residuals


def paths(diagnosis: Diagnosis) -> Section:
    """Return the figures of the paths."""
    drawn, pieces = diagnosis.evidence.paths, diagnosis.evidence.pieces
    changed = diagnosis.is_extended
    which = "in which the extended model changes the predicted path most" if changed else "that lead farthest"
    each = ", one of each recording first" if len({path.label for path in drawn}) > 1 else ""
    words = (
        f"The drives were cut into {pieces:,} pieces, each begun at the real robot's state. Drawn are the {len(drawn)} "
        f"{which}{each}."
    )
    causes: list[str] = [code(effect.name) for effect in diagnosis.effects]
    causes += [code(one.law.name) for one in diagnosis.laws.found]
    causes += ["the generic term"] if diagnosis.unexplained.generic else []
    window = diagnosis.evidence.window
    baseline = diagnosis.baseline_words
    figures = [path_figure(path, baseline, changed=changed, causes=causes, window=window) for path in drawn]
    others = f"{len(figures) - 1} more piece{'s' if len(figures) > 2 else ''}"
    more = folded(others, *figures[1:]) if len(figures) > 1 else Html("")
    return section("The path", *([paragraph(words)] if pieces > len(drawn) else []), *figures[:1], more)


def remains(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> Section:
    """Return the structure that no effect explains; empty if no residuals were examined."""
    unexplained = diagnosis.unexplained
    if unexplained.not_judged:
        return section("Unexplained residuals", paragraph(f"Not judged. {unexplained.not_judged}"))
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


def parameters(diagnosis: Diagnosis) -> Section:
    """Return the parameters of both models side by side; only those of the paper's model if it was not extended."""
    before = diagnosis.baseline.estimates if diagnosis.baseline else {}
    after = diagnosis.extended.estimates if diagnosis.extended else {}
    others = diagnosis.parameters
    names = _in_order({*before, *after, *others})
    if not names:
        return section("Parameters")
    if diagnosis.is_extended:
        headings = ["parameter", "meaning", diagnosis.baseline_words.removeprefix("the "), "extended model"]
        known = {name: value for name, value in others.items() if name in PAPER and name not in after}
        models = [[_value(name, before, known), _value(name, after, others)] for name in names]
    else:
        headings = ["parameter", "meaning", "value"]
        models = [[_value(name, before, others)] for name in names]
    rows = [[code(name), _meaning(name), *values] for name, values in zip(names, models, strict=True)]
    given_ones = quiet("Values without \u00b1 were given, not fitted.")
    return section("Parameters", table(headings, rows, numbers=(2, 3)), given_ones)


def _definitions() -> dict[str, ParameterDefinition]:
    """Return the definitions of all parameters so far, since laws add some at run time."""
    return {**PAPER, **CONTROLLER_DEFINITIONS, **OF_MODEL}


def _unit(name: str) -> str:
    known = _definitions()
    return known[name].unit if name in known else ""


def _in_order(names: Iterable[str]) -> list[str]:
    """Return names in the order of the catalogue, unknown ones last."""
    known = list(_definitions())
    return sorted(names, key=lambda name: (known.index(name) if name in known else len(known), name))


def _meaning(name: str) -> str:
    known = _definitions()
    return known[name].meaning if name in known else ""


def _value(name: str, estimates: Mapping[str, Estimate], others: Mapping[str, float]) -> str:
    if name in estimates:
        return estimate_text(estimates[name], _unit(name))
    return given(others[name], _unit(name)) if name in others else UNKNOWN


def residuals(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> Section:
    """Return small multiples of all residuals."""
    if not pairs:
        return section("All residuals")
    words = (
        "Each measured signal minus the prediction of the model, against all quantities that might predict it. A "
        "complete model leaves flat lines at zero. Marks are means in bins with standard errors that allow for "
        "correlated errors; grey dots are single samples. Errors of the pose are those that accumulate over a second."
    )
    return section("All residuals", paragraph(words), all_residuals(pairs, changed=diagnosis.is_extended))
