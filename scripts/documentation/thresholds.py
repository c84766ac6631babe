"""The page of the search's thresholds, docs/reference/thresholds.md, made from the constants of its modules."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from documentation.imports import PROJECT

PAGE = PROJECT / "docs" / "reference" / "thresholds.md"
ESTIMATION = PROJECT / "cmr" / "estimation"
# The stages in the order in which a diagnosis passes through them, each with its modules.
STAGES = {
    "Criterion": ("criterion",),
    "Screening": ("search/screening", "search/inflation", "search/localisation", "search/linear"),
    "Fit": ("search/ranking", "search/placement", "search/profile"),
    "Judgement": ("search/criteria",),
    "Cross-validation": ("search/folds", "search/cross_validation"),
    "Selection": ("search/selection", "search/ties", "search/rivals", "search/exchange", "search/leap"),
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
    **dict.fromkeys(("REACH", "SIZES", "UNEVEN", "OUTLYING", "WINDOW", "SOMEWHAT", "leap.ASIDE"), "s"),
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
# Origin of a value that was not set by hand and confirmed by the whole study.
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
HEAD = "| name | value | unit | meaning | where from | module |\n|---|---|---|---|---|---|\n"
INTRODUCTION = """\
# Thresholds of the diagnosis

The numbers by which the search decides, in the order of its stages. The page comes from the modules
(`scripts/write_thresholds`), and a test compares the two. Drops are those of the sum of squared white errors, which is
twice the log-likelihood. The unit "-" stands for a pure number: a drop, a share, a factor or a count.

A value that comes from elsewhere says from where. "By hand, on the study" means that it was chosen so that
[the study of hidden effects](../measurements/diagnosis.md) came out best, and that nothing but this study bears it out.
"""


class Threshold(NamedTuple):
    """One line of a module that gives one number or a few: names, values, unit, meaning, and origin."""

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
            cells = ((f"`{one.names}`", f"`{one.values}`", *one[2:], f"`{module}`") for one in thresholds(module))
            parts += [f"| {' | '.join(row)} |\n" for row in cells]
    return "".join(parts)


def thresholds(module: str) -> Iterator[Threshold]:
    """Yield the thresholds of a module below cmr/estimation, in its order."""
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
    """Return the comment on a line, else that of the lines above it."""
    _code, found, comment = lines[index].partition("#")
    if found:
        return comment.strip()
    above: list[str] = []
    while index > 0 and lines[index - 1].startswith("#"):
        index -= 1
        above.insert(0, lines[index].strip("# "))
    return " ".join(above)
