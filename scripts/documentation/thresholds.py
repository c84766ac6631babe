"""Generate docs/reference/thresholds.md, the thresholds of the search, from the constants of its modules."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from documentation.imports import PROJECT

PAGE = PROJECT / "docs" / "reference" / "thresholds.md"
ESTIMATION = PROJECT / "cmr" / "estimation"
# The stages of a diagnosis in their order, each with its modules.
STAGES = {
    "Criterion": ("criterion",),
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
    "Laws": (
        "laws/candidates",
        "laws/local",
        "laws/scan",
        "laws/foreseen",
        "laws/known",
        "laws/misfit",
        "laws/polish",
        "laws/constants",
        "laws/variables",
        "laws/offers",
        "laws/searching",
        "laws/rivals",
        "laws/proposing",
    ),
    "Verdict": ("usefulness",),
}
UNITS = {
    **dict.fromkeys(("REACH", "UNEVEN", "OUTLYING", "WINDOW", "SOMEWHAT", "leap.ASIDE"), "s"),
    **dict.fromkeys(("CELL", "localisation.RADII", "REACHES", "SMALLEST"), "m"),
    "LEAST_CHANGE": "duty",
    **dict.fromkeys(("SLOW", "SINCE", "DECAYS"), "s"),
    "WAYS": "m",
    "STEADY": "s",
    "SLOWEST, FASTEST": "Hz",
    "command_timing.LEAST": "1/s^2",
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
    **dict.fromkeys(("RIDGE", "inflation.NOTHING", "localisation.NOTHING", "OWN", "command_timing.CLOSE"), NUMERICAL),
    **dict.fromkeys(("PROMISING", "FINALISTS", "BEST_PAIRS", "FITTED_INSTEAD", "MOST_STEPS", "MOST_SMALL"), EFFORT),
    **dict.fromkeys(("MOST_CELLS", "STARTS", "ROUNDS", "rivals.MOST", "SMALLEST_BLOCK", "AGES"), EFFORT),
}
HEAD = "| name | value | unit | meaning | origin | module |\n|---|---|---|---|---|---|\n"
INTRODUCTION = """\
# Thresholds of the diagnosis

This page lists the thresholds by which the search decides, in the order of its stages. It is generated from the modules
(`scripts/write_thresholds`), and a test compares the two. A drop is a likelihood-ratio statistic: the decrease of the
sum of squared whitened errors, which is twice the increase of the log-likelihood. The unit "-" stands for a pure
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
        units, sources = (_of(table, short, names) for table in (UNITS, SOURCES))
        values = ast.unparse(node.value).replace("|", "\\|")
        values = values.strip("()") if isinstance(node.value, ast.Tuple) else values
        meaning = _comment(lines, node.lineno - 1).replace("|", "\\|").replace("*", "\\*")
        if units and meaning.startswith(units):
            meaning = meaning.removeprefix(units).lstrip(";, ")
        yield Threshold(names, values, units or "-", meaning.rstrip(","), sources or BY_HAND)


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
