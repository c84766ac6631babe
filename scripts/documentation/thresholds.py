"""Generate docs/reference/thresholds.md, the thresholds of the estimation, from the constants of its modules."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from documentation.imports import PROJECT

PAGE = PROJECT / "docs" / "reference" / "thresholds.md"
ESTIMATION = PROJECT / "cmr" / "estimation"
# The stages of a diagnosis in their order, each with its modules.
STAGES = {
    "Data": ("checks", "thinning", "segments", "signs", "commanded_speeds"),
    "Preparation": ("initial_guess", "preparation", "gains", "noise"),
    "Model runs": ("problem", "gauss_newton", "simulation_error", "free_runs", "smoothing"),
    "Criterion": ("criterion",),
    "Candidates": ("candidates",),
    "Screening": ("search/screening", "search/inflation", "search/localisation", "search/linear"),
    "Fit": ("search/ranking", "search/placement", "search/profile"),
    "Judgement": ("search/criteria",),
    "Cross-validation": ("search/folds", "search/cross_validation"),
    "Selection": (
        "search/selection",
        "search/reasons",
        "search/ties",
        "search/rivals",
        "search/exchange",
        "search/leap",
    ),
    "Effects of chance": ("search/chance", "search/command_timing"),
    "Unexplained": (
        "unexplained/bursts",
        "unexplained/terms",
        "unexplained/traces",
        "unexplained/scores",
        "unexplained/share",
        "unexplained/generic",
        "unexplained/remaining",
        "unexplained/extending",
    ),
    "Laws": (
        "laws/candidates",
        "laws/linearised",
        "laws/local",
        "laws/scan",
        "laws/foreseen",
        "laws/known",
        "laws/misfit",
        "laws/refining",
        "laws/constants",
        "laws/variables",
        "laws/offers",
        "laws/searching",
        "laws/rivals",
        "laws/proposing",
        "laws/naming",
        "laws/curves",
    ),
    "Averages": ("averaging", "sizes", "sampling", "estimates"),
    "Verdict": ("gain", "usefulness", "estimation"),
}
# A comment begins with the unit of its value; where several values have several units, they are here.
UNIT = re.compile(r"(rad/s|1/s\^2|1/s|duty|rad|Hz|m|s)[;:,]? ")
UNITS = {
    "LEAST_CHANGE, SURELY": "s, -",
    "FAST, FEWEST_FAST": "rad/s, -",
    "SAME_POSE, NEARLY_SAME_POSE, MOST_ALIKE": "m and rad, the same, -",
    "SEVERAL, COMING": "-, rad/s",
    "LONGEST_UNREPORTED, LONGEST_UNREPORTED_PERIODS": "s, -",
    "NOISY, LONGEST_MEAN": "-, s",
    "STILL, TICKS": "s, -",
    "FINEST": "rad, m or rad/s",
    "SPACING, FEWEST, MOST": "m, -, -",
    "SWINGS, FADING": "Hz, -",
    "terms.NOTHING": "rad/s, m or s",
    "USUAL_MOTOR": "s",
    "USUAL_ACCELERATION, USUAL_RATE, USUAL_WIDTH, USUAL_TURN": "rad/s^2, 1/s, m, rad/s",
    "GENTLE": "duty/s",
    "ASIDE, SHARE_ASIDE": "m, -",
    "MOMENTS, MOMENT_STEP, MOMENTS_APART": "-, s, s",
}
# Origins of values.
BY_HAND = "by hand, on the study"
BIC = "Bayesian information criterion: Schwarz, Annals of Statistics 6, 1978"
CONTROL = "genomic control: Devlin and Roeder, Biometrics 55, 1999"
WALK = "differential evolution Markov chain: ter Braak, Statistics and Computing 16, 2006"
NUMERICAL = "floating-point arithmetic"
EFFORT = "bounds the computing time"
SOURCES = {
    "THRESHOLD": "chi-squared with 1 degree of freedom: chance exceeds it once in 2e7",
    "PER_FURTHER": BIC,
    "MEDIAN_OF_CHI2": CONTROL,
    "ASIDE, ASIDE_OF_BODY": CONTROL,
    "profile.LIKELY": "chi-squared with 1 degree of freedom: 95 %",
    "LEAST_SEEN": "chi-squared with 1 degree of freedom: 95 %",
    "STRAYING": "hidden effects and real recordings, docs/measurements/real_recordings.md",
    "SHARED": "8 made-up drives",
    "ALIKE_AT_THE_END": "a late gyro at 20 Hz: 0.15 %",
    "WALKERS, STEPS, SETTLING": "walkers: one block of the compiled model",
    "JITTER": WALK,
    "JUMPS": WALK,
    **dict.fromkeys(("INTERVAL", "COVERAGE"), "convention"),
    "UNIFORM": "standard deviation of a uniform distribution",
    **dict.fromkeys(("LEAST_SIZE", "scores.NOTHING", "share.NOTHING", "terms.NOTHING", "FINEST"), NUMERICAL),
    **dict.fromkeys(("MOST_NUMBERS", "FEWEST_COLUMNS, MOST_COLUMNS", "ENOUGH", "MOST_READINGS"), EFFORT),
    **dict.fromkeys(("QUICK_STEPS", "DRAWS", "gauss_newton.MOST_STEPS", "MOST_ON", "noise.SETTLING"), EFFORT),
    **dict.fromkeys(("RIDGE", "inflation.NOTHING", "localisation.NOTHING", "OWN", "command_timing.CLOSE"), NUMERICAL),
    **dict.fromkeys(("PROMISING", "FINALISTS", "BEST_PAIRS", "FITTED_INSTEAD", "MOST_STEPS", "MOST_SMALL"), EFFORT),
    **dict.fromkeys(("MOST_CELLS", "STARTS", "ROUNDS", "rivals.MOST", "SMALLEST_BLOCK", "AGES"), EFFORT),
}
HEAD = "| name | value | unit | meaning | origin | module |\n|---|---|---|---|---|---|\n"
INTRODUCTION = """\
# Thresholds of the diagnosis

This page lists the numbers by which the estimation decides, in the order of its stages. It is generated from the
modules (`scripts/write_thresholds`), and a test compares the two. A drop is a likelihood-ratio statistic: the decrease
of the sum of squared whitened errors, which is twice the increase of the log-likelihood. The unit "-" stands for a pure
number: a drop, a share, a factor or a count.

The column "origin" names the source of a value. "By hand, on the study" means that the value gave the best results in
[the study of hidden effects](../measurements/diagnosis.md), and that only this study supports it.
"""


class Threshold(NamedTuple):
    """A line of a module that assigns one or more numbers: names, values, unit, meaning, and origin."""

    names: str
    values: str
    unit: str
    meaning: str
    source: str


def document() -> str:
    """Return the text of the page."""
    parts = [INTRODUCTION]
    for stage, modules in STAGES.items():
        parts.append(f"\n## {stage}\n\n{HEAD}")
        for module in modules:
            cells = ((f"`{each.names}`", f"`{each.values}`", *each[2:], f"`{module}`") for each in thresholds(module))
            parts += [f"| {' | '.join(row)} |\n" for row in cells]
    return "".join(parts)


def thresholds(module: str) -> Iterator[Threshold]:
    """Yield the thresholds of a module in cmr/estimation, in the order of its source."""
    text = (ESTIMATION / f"{module}.py").read_text(encoding="utf-8")
    lines, short = text.splitlines(), Path(module).name
    for node in ast.parse(text).body:
        if not isinstance(node, ast.Assign) or not _is_a_number(node.value):
            continue
        names = ast.unparse(node.targets[0]).strip("()")
        values = ast.unparse(node.value).replace("|", "\\|")
        values = values.strip("()") if isinstance(node.value, ast.Tuple) else values
        meaning = _comment(lines, node.lineno - 1).replace("|", "\\|").replace("*", "\\*")
        begins = UNIT.match(meaning)
        meaning = meaning[begins.end() :] if begins else meaning
        unit = _of(UNITS, short, names) or (begins.group(1) if begins else "-")
        yield Threshold(names, values, unit, meaning.rstrip(","), _of(SOURCES, short, names) or BY_HAND)


def _is_a_number(value: ast.expr) -> bool:
    """Return whether an expression consists of numbers only, counting constants."""
    parts = [part for part in ast.walk(value) if isinstance(part, ast.Constant)]
    calls = [part for part in ast.walk(value) if isinstance(part, ast.Name) and part.id not in ("np", "math")]
    keys = [key for part in ast.walk(value) if isinstance(part, ast.Dict) for key in part.keys]
    numbers = [part for part in parts if part not in keys]
    return bool(numbers) and not calls and all(isinstance(part.value, int | float) for part in numbers)


def _of(table: dict[str, str], module: str, names: str) -> str:
    return table.get(f"{module}.{names}", table.get(names, ""))


def _comment(lines: list[str], index: int) -> str:
    """Return the comment on a line, or on the lines above it."""
    _code, found, comment = lines[index].partition("#")
    if found:
        return comment.strip()
    above: list[str] = []
    while index > 0 and lines[index - 1].startswith("#"):
        index -= 1
        above.insert(0, lines[index].strip("# "))
    return " ".join(above)
