"""Format diagnoses as text for a terminal."""

import math
from collections.abc import Sequence
from textwrap import TextWrapper

from cmr.diagnosis.job import Outcome
from cmr.diagnosis.result import GENERIC, Diagnosis, Fitted, NamedEffect
from cmr.diagnosis.words import GAINED, harmless_sentence, regressor_name, share_sentence, signal_name, some_of
from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.model.catalogue import definition

WIDTH = 110  # characters
SMALLEST = 1e-300  # smaller p values are rounding errors
INDENT = "     "


def summary(diagnosis: Diagnosis) -> str:
    """Return the verdict in a sentence, a table of the effects, the gain, and what to do next."""
    given = {effect.next_experiment for effect in diagnosis.effects}
    following = [f"Next: {diagnosis.next_experiment}"] if diagnosis.next_experiment not in {None, *given} else []
    remarks = [*_gain(diagnosis), *diagnosis.lateness_sentences, *_faults(diagnosis)]
    errors = _known_errors(diagnosis)
    parts = [
        _wrapped(f"Robot {diagnosis.robot_id}: {diagnosis.sentence}"),
        _table(diagnosis.effects) if diagnosis.effects else "",
        "\n".join(_wrapped(text, indent=len(INDENT)) for text in _laws(diagnosis)),
        _wrapped(harmless_sentence(diagnosis.harmless)),
        _error_table(diagnosis.evidence.window, errors) if len(errors) > 1 else "",
        "\n".join(map(_wrapped, [*remarks, *diagnosis.notes, *following])),
    ]
    return "\n\n".join(part for part in parts if part)


def outcome_line(outcome: Outcome) -> str:
    """Summarise one of many diagnoses in one line."""
    name = outcome.folder.name
    if outcome.failure:
        return f"{name}: failed. {outcome.failure}"
    effects = f": {', '.join(outcome.effects)}" if outcome.effects else ""
    return f"{name}: {outcome.verdict}{effects}"


def outcome_table(outcomes: Sequence[Outcome]) -> str:
    """Return a table of the outcomes of many diagnoses, and of why some failed."""
    width = max(len("diagnosis"), *(len(outcome.folder.name) for outcome in outcomes))
    lines = [f"{'diagnosis':{width}s}  {'verdict':13s}  {'gain':>6s}  effects"]
    for outcome in outcomes:
        ratio = f"{outcome.ratio:.2f}" if math.isfinite(outcome.ratio) else "-"
        row = f"{outcome.folder.name:{width}s}  {outcome.verdict or 'failed':13s}  {ratio:>6s}  "
        lines.append(_wrapped(row + (", ".join(outcome.effects) or "-"), indent=len(row)))
    lines += [_wrapped(outcome_line(outcome)) for outcome in outcomes if outcome.failure]
    return "\n".join(lines)


def _table(effects: Sequence[NamedEffect]) -> str:
    parameters = max(len(name) for effect in effects for name in effect.estimates)
    lines = [f"     {'parameter':{parameters}s}  {'value':>11s} {'+- std':>9s}  {'unit':8s}  likelihood ratio"]
    for rank, effect in enumerate(effects, start=1):
        evidence = f"{effect.statistic:.1f} (p {_probability(effect.p_value)})"
        for position, (name, estimate) in enumerate(effect.estimates.items()):
            start = f"{rank:3d}. " if position == 0 else INDENT
            row = f"{start}{name:{parameters}s}  {_value(estimate)}  {definition(name).unit:8s}  "
            lines.append((row + (evidence if position == 0 else "")).rstrip())
        lines += [_wrapped(INDENT + sentence, indent=len(INDENT)) for sentence in _sentences(effect)]
    return "\n".join(lines)


def _laws(diagnosis: Diagnosis) -> list[str]:
    """Return lines on laws; empty if none were searched for, or there is nothing to report."""
    laws = diagnosis.laws
    if laws.rivals and not laws.found:
        return [f"Laws ({laws.answer}): none is used. {' '.join(laws.reasons)}"]
    if not laws.found:
        return [f"No law: {' '.join(laws.reasons)}"] if laws.manoeuvre else []
    names = " and ".join(one.law.name for one in laws.found)
    return [f"Laws ({laws.answer}): {names}. {' '.join(laws.reasons)}"]


def _sentences(effect: NamedEffect) -> list[str]:
    """Return the sentences below an effect's row."""
    sentences = [f"{effect.name}: {effect.cause}"]
    if effect.indistinguishable_from:
        sentences.append(f"These data cannot distinguish it from {', '.join(some_of(effect.indistinguishable_from))}.")
    if effect.next_experiment:
        sentences.append(f"Next: {effect.next_experiment}")
    return sentences


def _value(estimate: Estimate) -> str:
    std = f"{estimate.std:.2g}" if math.isfinite(estimate.std) else "-"
    return f"{estimate.value:11.5g} {std:>9s}"


def _probability(p_value: float) -> str:
    return f"= {p_value:.1g}" if p_value >= SMALLEST else f"< {SMALLEST:g}"


def _gain(diagnosis: Diagnosis) -> list[str]:
    """Return a sentence on the path errors before and after; none with bad data."""
    if diagnosis.baseline is None or diagnosis.extended is None:
        return []
    if not math.isfinite(diagnosis.baseline.held_out_path_rmse):
        return _without_path(diagnosis)
    before = f"Path error on held-out data: {_error(diagnosis.baseline)} with {diagnosis.baseline_words}"
    if not diagnosis.is_extended:
        return [f"{before}.", *_over_nominal(diagnosis)]
    errors = f"{before}, {_error(diagnosis.extended)} with {_added(diagnosis)}"
    if diagnosis.gain is None or not math.isfinite(diagnosis.gain.ratio):
        return [f"{errors}."]
    return [f"{errors}, {_ratio(diagnosis.gain)}.", *_over_nominal(diagnosis)]


def _without_path(diagnosis: Diagnosis) -> list[str]:
    """Return sentences on the errors of other signals, if no path error is known."""
    compared = (
        (diagnosis.baseline_words, diagnosis.gain if diagnosis.is_extended else None),
        ("the nominal parameters", diagnosis.gain_over_nominal),
    )
    errors = [
        f"Compared with {than}, errors on held-out data are smaller by a factor of "
        f"{' and '.join(f'{ratio:.2f} ({GAINED[name]})' for name, ratio in gain.signals.items() if name in GAINED)}."
        for than, gain in compared
        if gain and GAINED.keys() & gain.signals.keys()
    ]
    return ["The path error is not known: no path was measured on held-out data.", *errors]


def _over_nominal(diagnosis: Diagnosis) -> list[str]:
    """Return a sentence on the path error of the nominal robot; empty if unknown."""
    nominal, gain = diagnosis.nominal, diagnosis.gain_over_nominal
    if nominal is None or gain is None or not math.isfinite(gain.ratio):
        return []
    return [f"With the nominal parameters it is {_error(nominal)}; compared with that it is {_ratio(gain)}."]


def _ratio(gain: Gain) -> str:
    """Describe the ratio of errors, with its interval."""
    low, high = gain.interval
    ratio = f"{gain.ratio:.2f}"
    unlike = "smaller by a factor" if gain.ratio > 1.0 else "not smaller: a ratio"
    gained = "unchanged: a ratio" if ratio == "1.00" else unlike
    return f"{gained} of {ratio} (95 %: {low:.2f} to {high:.2f})"


def _known_errors(diagnosis: Diagnosis) -> list[tuple[str, Fitted]]:
    """Return the models with known path errors on held-out data, with their labels."""
    models = (
        ("nominal parameters", diagnosis.nominal),
        ("paper's model, fitted" if diagnosis.against is None else diagnosis.baseline_words, diagnosis.baseline),
        (f"with {_added(diagnosis)}", diagnosis.extended if diagnosis.is_extended else None),
    )
    return [(name, model) for name, model in models if model and math.isfinite(model.held_out_path_rmse)]


def _error_table(window: float, models: Sequence[tuple[str, Fitted]]) -> str:
    """Return path and heading errors on held-out data, model by model."""
    width = max(len(name) for name, _ in models)
    columns = ("path: rms [m]", "median [m]", "heading: rms [deg]", "median [deg]")
    lines = [
        f"Errors of free runs of up to {window:g} s on held-out data (median: of the windows' errors):",
        f"{INDENT}{'':{width}s}  {'  '.join(columns)}",
    ]
    for name, model in models:
        headings = (math.degrees(one) for one in (model.held_out_heading_rmse, model.held_out_heading_median))
        numbers = [f"{one:.4f}" for one in (model.held_out_path_rmse, model.held_out_path_median)]
        numbers += [f"{one:.2f}" for one in headings]
        cells = (
            f"{number.replace('nan', '-'):>{len(column)}s}" for number, column in zip(numbers, columns, strict=True)
        )
        lines.append(f"{INDENT}{name:{width}s}  {'  '.join(cells)}")
    return "\n".join(lines)


def _added(diagnosis: Diagnosis) -> str:
    """Return what extends the paper's model."""
    laws = {0: [], 1: ["the law"]}.get(len(diagnosis.laws.found), ["the laws"])
    generic = [GENERIC] if diagnosis.unexplained.generic else []
    departs = diagnosis.against is not None and bool(diagnosis.against.departures)
    parameters = ["the parameters found"] if departs and not diagnosis.effects else []
    return " and ".join([*(["the effects"] if diagnosis.effects else []), *laws, *parameters, *generic])


def _error(fitted: Fitted) -> str:
    return f"{fitted.held_out_path_rmse:.4f} m" if math.isfinite(fitted.held_out_path_rmse) else "unknown"


def _faults(diagnosis: Diagnosis) -> list[str]:
    """Return the problems of the data, and unexplained structure."""
    sentences = [finding.sentence for finding in diagnosis.checks if finding.found]
    unexplained = diagnosis.unexplained
    if unexplained.present and unexplained.signal:
        by = " and ".join(map(regressor_name, unexplained.regressors))
        share = share_sentence(unexplained, signal_name(unexplained.signal), by)
        sentences.append(f"Unexplained: {share}. No effect of the catalogue explains this.")
    elif unexplained.not_judged and diagnosis.baseline:
        sentences.append(f"Whether errors remain unexplained was not judged. {unexplained.not_judged}")
    return sentences


def _wrapped(text: str, indent: int = 0) -> str:
    """Return the text in lines of at most WIDTH, all but the first indented; file names are not broken."""
    wrapper = TextWrapper(WIDTH, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)
    return wrapper.fill(text)
