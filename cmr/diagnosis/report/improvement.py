"""Reduction of errors from the nominal robot to the extended model, and shifts of the paper's parameters."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from cmr.diagnosis.report.terms import signal_words
from cmr.diagnosis.result import Diagnosis, Fitted, NamedEffect
from cmr.diagnosis.words import GAINED
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.model.catalogue import DEFINITIONS
from cmr.report.markup import Html, joined, tag
from cmr.report.numbers import UNKNOWN, alike, fixed, number, rounded, unit_text, with_sign
from cmr.report.section import Section, code, paragraph, quiet, section
from cmr.report.style import AFTER, BEFORE
from cmr.report.table import table

MOVED = 1.0  # standard deviations; a smaller shift does not count
PATH = "pose"  # the signal of a gain that has a row of its own
HELD_OUT_PATH = "path, held-out data"
# The rows of each model: label, unit, and number.
ERRORS: tuple[tuple[str, str, Callable[[Fitted], float]], ...] = (
    (HELD_OUT_PATH, " m", lambda model: model.held_out_path_rmse),
    ("path, held-out data, median", " m", lambda model: model.held_out_path_median),
    ("heading, held-out data", "\u00b0", lambda model: math.degrees(model.held_out_heading_rmse)),
    ("heading, held-out data, median", "\u00b0", lambda model: math.degrees(model.held_out_heading_median)),
    ("path, fitted data", " m", lambda model: model.path_rmse),
)


class _Compared(NamedTuple):
    """A model with its label, and the last model's gain over it on held-out data; None for the last."""

    words: str
    model: Fitted
    gain: Gain | None = None


def gain(diagnosis: Diagnosis) -> Section:
    """Return the errors of all models, the gains, and the shifts of the paper's parameters."""
    models = list(_models(diagnosis))
    rows = [*_error_rows(models), *_signal_rows(models)] if len(models) > 1 else []
    intro = quiet(
        "Errors are root mean squares of distance and difference of heading in free runs over windows of up to "
        f"{diagnosis.evidence.window:g} s, each started at the real robot's state. A median is that of the windows' "
        "errors: it shows what is usual, where a few windows dominate the root mean square. Held-out data were left "
        "out of the fit; the interval of a ratio is from a block bootstrap."
    )
    ratios = [f"ratio to the {one.words}" for one in models[:-1]]
    headings = ["error", *(one.words for one in models), *ratios, "comparison"]
    texts = joined(intro, table(headings, rows, numbers=range(1, len(headings) - 1))) if rows else Html("")
    heading = "Improvement" if diagnosis.is_extended else "Errors of free runs"
    baseline = diagnosis.baseline.estimates if diagnosis.baseline else {}
    return section(heading, texts, _shifts(diagnosis.effects, baseline))


def _models(diagnosis: Diagnosis) -> Iterator[_Compared]:
    """Yield the models to compare: nominal, the paper's, extended, as far as they exist and differ."""
    if diagnosis.nominal:
        yield _Compared("nominal robot", diagnosis.nominal, diagnosis.gain_over_nominal)
    if diagnosis.baseline:
        words = diagnosis.baseline_words.removeprefix("the ")
        yield _Compared(words, diagnosis.baseline, diagnosis.gain if diagnosis.is_extended else None)
    if diagnosis.extended and diagnosis.is_extended:
        yield _Compared("extended model", diagnosis.extended)


def _error_rows(models: Sequence[_Compared]) -> Iterator[list[str]]:
    """Yield the rows of errors that are known for the last model and an earlier one."""
    for words, unit, error in ERRORS:
        errors = [error(one.model) for one in models]
        ratios = [_ratio(before, errors[-1]) for before in errors[:-1]]
        if words == HELD_OUT_PATH:
            ratios = [one.gain.ratio if one.gain else ratio for one, ratio in zip(models, ratios, strict=False)]
        if not any(map(math.isfinite, ratios)):
            continue
        intervals = [_interval(one.gain) if words == HELD_OUT_PATH else "" for one in models[:-1]]
        texts = [f"{text}{unit}" for text in alike(errors)]
        compared = [f"{number(ratio, 3)}{interval}" for ratio, interval in zip(ratios, intervals, strict=True)]
        yield [words, *texts, *compared, _bar(ratios[-1])]


def _signal_rows(models: Sequence[_Compared]) -> Iterator[list[str]]:
    """Yield the rows of signals other than the path with a known gain of the last model over an earlier one."""
    gains = [one.gain.signals if one.gain else {} for one in models[:-1]]
    for name in dict.fromkeys(name for of_model in gains for name in of_model):
        ratios = [of_model.get(name, math.nan) for of_model in gains]
        if name != PATH and any(map(math.isfinite, ratios)):
            words = GAINED.get(name, signal_words(name))
            yield [words, *([""] * len(models)), *(number(ratio, 3) for ratio in ratios), _bar(ratios[-1])]


def _ratio(before: float, after: float) -> float:
    return before / after if after else math.nan


def _interval(found: Gain | None) -> str:
    """Return the interval of a ratio in brackets; empty if unknown."""
    known = found is not None and all(map(math.isfinite, found.interval))
    return " ({} to {})".format(*(number(end, 3) for end in found.interval)) if found and known else ""


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


def _shifts(effects: Sequence[NamedEffect], baseline: Mapping[str, Estimate]) -> Html:
    """Return the shift of each of the paper's parameters with each added effect."""
    values = {name: estimate.value for name, estimate in baseline.items()}
    rows = []
    for effect in effects:
        for name, by in effect.shift.items():
            before = values.get(name, math.nan)
            if math.isfinite(by):
                values[name] = before + by
            if _matters(by, baseline.get(name)):
                rows.append([code(name), *_shift(name, before, by, baseline.get(name)), code(effect.name)])
    if not rows:
        return Html("")
    words = (
        "An effect that is missing in a model biases the parameters that it has: they compensate for it in these "
        "drives, and are wrong in others. The table shows how far each parameter moved as effects were added, one "
        "after the other."
    )
    headings = ("parameter", "from", "to", "moved by", "when this effect was added")
    heading = tag("h3", "How far the paper's parameters moved")
    return joined(heading, paragraph(words), table(headings, rows, numbers=(1, 2, 3)))


def _matters(by: float, before: Estimate | None) -> bool:
    """Return whether a parameter shifted significantly."""
    doubt = before.std if before and math.isfinite(before.std) else 0.0
    return math.isfinite(by) and abs(by) > MOVED * doubt


def _shift(name: str, before: float, by: float, baseline: Estimate | None) -> tuple[str, str, str]:
    """Return a parameter before and after an effect was added, and the relative shift."""
    unit = unit_text(DEFINITIONS[name].unit) if name in DEFINITIONS else ""
    std = baseline.std if baseline else math.nan
    if not math.isfinite(before):
        return UNKNOWN, UNKNOWN, f"{with_sign(by, rounded(by, std))} {unit}".rstrip()
    percent = 100.0 * by / before if before else math.nan
    moved = f"{with_sign(percent, fixed(percent, 1))} %" if math.isfinite(percent) else UNKNOWN
    first, last = (f"{rounded(value, std)} {unit}".rstrip() for value in (before, before + by))
    return first, last, moved
