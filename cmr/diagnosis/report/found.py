"""The verdict, the effects with their evidence and their plots, the effects rejected, and what to do next."""

import math
import re
from collections.abc import Sequence
from textwrap import dedent

from cmr.diagnosis.report.estimate_text import estimate_text, interval_text
from cmr.diagnosis.report.pairs import Pair, pairs_without
from cmr.diagnosis.report.residual_figures import tell_tale_figure
from cmr.diagnosis.report.tell_tale import tell_tale
from cmr.diagnosis.report.terms import regressor, signal_words
from cmr.diagnosis.result import (
    BAD_DATA,
    EFFECTS_FOUND,
    LAW_FOUND,
    NO_EFFECT,
    PARAMETERS_DIFFER,
    UNEXPLAINED,
    Candidate,
    Diagnosis,
    NamedEffect,
)
from cmr.diagnosis.words import harmless_sentence, some_of
from cmr.estimation.estimates import Estimate
from cmr.model.catalogue import CATALOGUE, DEFINITIONS
from cmr.model.effect import Effect
from cmr.report.markup import Html, joined, tag
from cmr.report.numbers import alike, chance, likelihood, number, typeset
from cmr.report.section import Section, bullets, code, codes, paragraph, quiet, section
from cmr.report.table import table

BADGES = {
    EFFECTS_FOUND: "effects found",
    LAW_FOUND: "law found",
    NO_EFFECT: "no effect",
    UNEXPLAINED: "unexplained",
    BAD_DATA: "bad data",
    PARAMETERS_DIFFER: "parameters differ",
}
TONES = {  # of the style sheet
    EFFECTS_FOUND: "plain",
    LAW_FOUND: "plain",
    NO_EFFECT: "good",
    UNEXPLAINED: "doubtful",
    BAD_DATA: "bad",
    PARAMETERS_DIFFER: "plain",
}
NOTHING_NAMED = {
    LAW_FOUND: "No effect in the catalogue was named. The data show a law instead, which has no name yet: see below.",
    NO_EFFECT: "No effect in the catalogue improves the predictions of both fitted and left-out data enough to matter.",
    UNEXPLAINED: "No effect in the catalogue was named, but the residuals have structure: see \u201cUnexplained "
    "residuals\u201d below.",
    PARAMETERS_DIFFER: "No effect departs from the file; the parameters in the first line do.",
}
SUFFICIENT = "The paper's model with three parameters is sufficient."
MOST_RUNNERS_UP = 10
MEND = (
    "Fix the problem named in the first line, then record the drive again. Nothing was fitted to these data, and no "
    "parameters were written."
)
EVIDENCE = (
    "Evidence: LR is the likelihood ratio, twice the log-likelihood that the effect adds to the model with all other "
    "named effects; p is the probability of such a ratio by chance, for any effect in the catalogue; left out is the "
    "log-likelihood that the effect adds on data left out of the fit. Values are given \u00b1 one standard deviation."
)
RECOGNISE = (
    "If you recognise the physics in the plots of the unexplained residuals, add it as an effect of your own: see "
    "docs/how_to/add_an_effect.md."
)
# A command in a sentence, and the following full stop: in backquotes, or with options of one value at most.
COMMAND = re.compile(r"(?:`(cmr-[^`]+)`|(cmr-[a-z]+(?: --[a-z][a-z-]*(?:[ =](?!-)[^\s;`]*[^\s;`.,:)])?)+))\.?")


def header(diagnosis: Diagnosis) -> Html:
    """Return the verdict in a sentence."""
    robot = f" Robot {diagnosis.robot_id}. Diagnosis by CMR."
    tone = TONES.get(diagnosis.verdict)
    badge = tag("span", BADGES.get(diagnosis.verdict, diagnosis.verdict), class_="badge")
    return tag("header", tag("h1", typeset(diagnosis.sentence)), tag("p", badge, robot), class_=tone)


def key_numbers(diagnosis: Diagnosis) -> Html:
    """Return the key numbers."""
    numbers = [tag("div", tag("dt", words), tag("dd", value)) for words, value in _key_numbers(diagnosis)]
    return tag("dl", *numbers, class_="key") if numbers else Html("")


def _key_numbers(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return path error, gain and amount of data, as far as they are known."""
    before, after = diagnosis.baseline, diagnosis.extended
    numbers = []
    if before and math.isfinite(before.held_out_path_rmse):
        errors = [before.held_out_path_rmse, *([after.held_out_path_rmse] if diagnosis.is_extended and after else [])]
        texts = alike(errors) if len(errors) > 1 else [number(errors[0], 3)]
        numbers.append(("path error on held-out data", " \u2192 ".join(texts) + " m"))
    if diagnosis.is_extended and diagnosis.gain and math.isfinite(diagnosis.gain.ratio):
        numbers.append(("improvement", _times(diagnosis.gain.ratio)))
    if diagnosis.gain_over_nominal and math.isfinite(diagnosis.gain_over_nominal.ratio):
        numbers.append(("compared with the nominal robot", _times(diagnosis.gain_over_nominal.ratio)))
    if diagnosis.samples:
        numbers.append(("measurements compared", f"{diagnosis.samples:,}"))
    return numbers


def _times(ratio: float) -> str:
    """Return the ratio of the errors before and after, in words."""
    if f"{ratio:.2f}" == "1.00":
        return "unchanged"
    return f"{number(ratio, 3)} times smaller" if ratio >= 1.0 else f"none: {number(1.0 / ratio, 3)} times larger"


def named(diagnosis: Diagnosis) -> Section:
    """Return the table of the effects, or the sentence that there are none, and the notes."""
    if diagnosis.verdict == BAD_DATA:
        return section("Notes", bullets(list(diagnosis.notes)))
    if not diagnosis.effects:
        nothing = NOTHING_NAMED.get(diagnosis.verdict, "No effect was named.")
        if diagnosis.verdict == NO_EFFECT and not diagnosis.unexplained.not_judged and diagnosis.against is None:
            nothing = f"{nothing} {SUFFICIENT}"
        return section("Effects found", paragraph(nothing), bullets(list(diagnosis.notes)))
    rows = [_found_row(effect) for effect in diagnosis.effects]
    headings = ("effect", "what it means", "parameters", "evidence", "not distinguished from")
    return section("Effects found", table(headings, rows), quiet(EVIDENCE), bullets(list(diagnosis.notes)))


def _found_row(effect: NamedEffect) -> list[str]:
    parameters = joined(*(_parameter(name, estimate) for name, estimate in effect.estimates.items()))
    return [code(effect.name), typeset(effect.cause), parameters, evidence(effect), _rivals(effect)]


def _rivals(effect: NamedEffect) -> Html:
    """Return indistinguishable effects, and the manoeuvre that would decide."""
    entry = CATALOGUE.get(effect.name)
    told_apart_by = entry.confused_with if entry else {}
    lines = [
        joined(
            code(other) if other in effect.indistinguishable_from else other,
            f" (to distinguish them: {told_apart_by[other]})" if other in told_apart_by else "",
        )
        for other in some_of(effect.indistinguishable_from)
    ]
    return joined(*(tag("div", line) for line in lines)) if lines else joined("\u2013")


def _parameter(name: str, estimate: Estimate) -> Html:
    unit = DEFINITIONS[name].unit if name in DEFINITIONS else ""
    return paragraph(
        code(name), tag("br"), estimate_text(estimate, unit), tag("br"), f"95 %: {interval_text(estimate)}"
    )


def evidence(tested: NamedEffect | Candidate) -> Html:
    """Return the numbers that support an effect."""
    lines = [f"LR {likelihood(tested.statistic)}", f"p {chance(tested.p_value)}"]
    if math.isfinite(tested.held_out):
        lines.append(f"left out {likelihood(tested.held_out)}")
    return joined(*(paragraph(line) for line in lines))


def tell_tales(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> Section:
    """Return for each effect its equation and the plot that shows it best, with and without it.

    `pairs` are those of all residuals.
    """
    parts: list[Html] = []
    for effect in diagnosis.effects:
        entry = CATALOGUE.get(effect.name)
        parts.append(tag("h3", code(effect.name), f": {typeset(effect.cause)}"))
        if entry:
            parts.append(paragraph(f"It shows in {entry.shows_in}."))
        without = pairs_without(diagnosis.evidence.residuals, effect.name, pairs)
        pair = tell_tale(without, entry.shows_in if entry else "")
        if pair:
            parts.append(tell_tale_figure(pair, _caption(effect, pair)))
        else:
            parts.append(paragraph("No plot of mean residuals shows this effect on its own."))
        if entry:
            parts += [quiet("Its equation, as the simulation runs it:"), tag("pre", tag("code", equation(entry)))]
    return section("Plots that show the effects", *parts)


def _caption(effect: NamedEffect, pair: Pair) -> str:
    words = f"{signal_words(pair.signal)} over {regressor(pair.regressor).words}"
    return (
        f"{effect.name}: residual of the {words} in the extended model, without and with this effect, which "
        f"removes {100.0 * min(pair.removed, 1.0):.0f} % of the structure in the mean square residual."
    )


def equation(effect: Effect) -> str:
    """Return an effect's equation: the statements of each stage of the model's step."""
    stages = effect.equations.items()
    return "\n\n".join(f"# stage: {stage}\n{dedent(statements).strip()}" for stage, statements in stages)


def runners_up(diagnosis: Diagnosis) -> Section:
    """Return the effects that were tested and rejected."""
    explaining = [candidate for candidate in diagnosis.candidates if not candidate.statistic <= 0.0]
    rows = [
        [
            code(c.name),
            likelihood(c.statistic),
            chance(c.p_value).removeprefix("= "),
            likelihood(c.held_out),
            typeset(c.why_not),
        ]
        for c in explaining[:MOST_RUNNERS_UP]
    ]
    if not rows:
        return section("Effects tested and rejected")
    seen = paragraph(typeset(harmless_sentence(diagnosis.harmless))) if diagnosis.harmless else Html("")
    weaker = len(diagnosis.candidates) - len(rows)
    words = "effect was" if weaker == 1 else "effects were"
    others = quiet(f"{weaker} more {words} tested and explain less: see diagnosis.json.") if weaker else Html("")
    headings = ("effect", "LR", "p", "left out", "why it was not named")
    explained = Html("") if diagnosis.effects else quiet(EVIDENCE)
    return section("Effects tested and rejected", seen, table(headings, rows, numbers=(1, 2, 3)), others, explained)


def next_steps(diagnosis: Diagnosis) -> Section:
    """Return what to drive next, with commands, and how to use the result."""
    asked = [("", diagnosis.next_experiment), *((effect.name, effect.next_experiment) for effect in diagnosis.effects)]
    texts: dict[str, list[str]] = {}
    for name, text in asked:
        if text:
            texts.setdefault(text, []).extend([name] if name else [])
    steps = [_step(text, tuple(names)) for text, names in texts.items()]
    if diagnosis.verdict == BAD_DATA:
        steps.append(joined(MEND))
    elif diagnosis.unexplained.present:
        steps.append(joined(RECOGNISE))
    elif not steps:
        steps.append(joined("No further drive is needed: these data leave no question open."))
    if diagnosis.extended:
        steps.append(
            joined(
                "Use the result: ",
                code(f"robot_{diagnosis.robot_id}.yaml"),
                " in the folder of this page contains the parameters below, and cmr-sim accepts it as it is.",
            )
        )
    return section("What to do next", bullets(list(steps)))


def _step(text: str, names: tuple[str, ...]) -> Html:
    concerns = joined("For ", codes(names), ": ") if names else Html("")
    return joined(concerns, with_commands(text))


def with_commands(text: str) -> Html:
    """Return a text with its commands in separate lines, for copying."""
    parts, end = [], 0
    for match in COMMAND.finditer(text):
        parts += [text[end : match.start()], tag("pre", tag("code", match[1] or match[2]))]
        end = match.end()
    return joined(*parts, text[end:])
