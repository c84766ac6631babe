"""Score rows of a study against what is to be reached. Pure functions of rows."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tests.hidden_effects.judging import (
    Interval,
    all_large_named,
    all_named,
    covered,
    covered_of_paper,
    flagged,
    hidden_first,
    is_timed,
    latencies_right,
    may_be,
    parameters_right,
    right_first,
    silent,
    tells_what_next,
    told_as_hidden,
    wrongly_named,
)
from tests.hidden_effects.rows import Row
from tests.hidden_effects.unknown import UNKNOWN

PREDICTED = 0.2  # share by which an error may be predicted wrongly
LOG_SECONDS, COMMAND_SECONDS = 3.0, 8.0  # of the processor
MEMORY = 4e9  # bytes
LINEAR = 1.25  # how much more time per second of driving a long log may take than a short one


@dataclass(frozen=True)
class Score:
    """One figure: what it is of, over how many logs, and whether it is reached; None where nothing is demanded."""

    set_name: str
    quantity: str
    value: float
    count: int
    goal: str = ""
    reached: bool | None = None
    unit: str = "%"


def scores(rows: Sequence[Row]) -> list[Score]:
    """Return the scores of all sets that have rows."""
    result = []
    for name, score_of in SCORES.items():
        own = [row for row in rows if row.set_name == name]
        if own:
            result += score_of(own)
            failed = [row for row in own if row.error]
            result.append(_share(name, "failed with an error", failed, own, most=0.0))
    return result + (timing(rows) if rows else [])


def score_single(rows: Sequence[Row]) -> list[Score]:
    """Score one effect on the rich drive."""
    right = [row for row in rows if right_first(row)]
    return [
        _share("single", "right name first", right, rows, least=0.995),
        _share("single", "nothing wrong named", [row for row in rows if not wrongly_named(row)], rows),
        _share("single", "parameter within 5 % or 3 std", _those(right, parameters_right), right, least=0.95),
        _coverage("single", right),
        _coverage_of_paper("single", [(row, row.extended) for row in rows if told_as_hidden(row)]),
    ]


def score_brief(rows: Sequence[Row]) -> list[Score]:
    """Score one effect on the short drive."""
    return [
        _share("brief", "right name first", _those(rows, right_first), rows, least=0.99),
        _share("brief", "nothing wrong named", [row for row in rows if not wrongly_named(row)], rows),
    ]


def score_eight(rows: Sequence[Row]) -> list[Score]:
    """Score one effect on figure-eights."""
    named, silent = _those(rows, lambda row: bool(row.names)), _those(rows, lambda row: not row.names)
    in_set = [row for row in named if may_be(row, 0, row.case.effects[0])]
    return [
        _share("eight", "where something is named: it, or in the set", in_set, named, least=0.99),
        _share("eight", "wrongly named", _those(rows, wrongly_named), rows, most=0.01),
        _share("eight", "where nothing is named: next experiment", _those(silent, tells_what_next), silent, least=1.0),
        _share("eight", "right name first", _those(rows, right_first), rows),
    ]


def score_null(rows: Sequence[Row]) -> list[Score]:
    """Score robots without any effect."""
    return [*_score_silence("null", rows), _coverage_of_paper("null", [(row, row.baseline) for row in rows])]


def score_short(rows: Sequence[Row]) -> list[Score]:
    """Score robots without any effect on short drives."""
    return _score_silence("short", rows)


def _score_silence(name: str, rows: Sequence[Row]) -> list[Score]:
    alarmed = _those(rows, lambda row: not silent(row))
    return [
        _share(name, "something named", _those(rows, lambda row: bool(row.names)), rows, most=0.01),
        _share(name, "a verdict other than no_effect", alarmed, rows, most=0.01),
        _share(name, "flagged as unexplained", _those(rows, flagged), rows),
    ]


def score_coarse(rows: Sequence[Row]) -> list[Score]:
    """Score coarse encoders."""
    fine = _those(rows, lambda row: not row.error and set(row.names) <= {"encoder_quantisation"})
    worst = _those(rows, lambda row: any("friction" in name or "slip" in name for name in row.names))
    return [
        _share("coarse", "called encoder_quantisation or nothing", fine, rows, least=0.95),
        _share("coarse", "called friction or slip", worst, rows, most=0.0),
    ]


def score_pairs(rows: Sequence[Row]) -> list[Score]:
    """Score two effects at once."""
    both = _those(rows, all_named)
    exactly = _those(both, lambda row: len(row.names) == len(row.case.effects))
    return [
        _share("pairs", "both named, nothing else", exactly, rows, least=0.95),
        _share("pairs", "both named", both, rows),
        _share("pairs", "parameters within 5 % or 3 std", _those(both, parameters_right), both),
    ]


def score_unknown(rows: Sequence[Row]) -> list[Score]:
    """Score physics that no effect describes."""
    alone = _those(rows, lambda row: bool(row.names) and not flagged(row))
    by_kind = {kind: [row for row in rows if row.case.effects == (kind,)] for kind in UNKNOWN}
    kinds = [_share("unknown", f"flagged: {kind}", _those(own, flagged), own) for kind, own in by_kind.items() if own]
    return [
        _share("unknown", "flagged as unexplained", _those(rows, flagged), rows, least=0.90),
        _share("unknown", "a wrong name alone", alone, rows, most=0.05),
        *kinds,
    ]


def score_friction(rows: Sequence[Row]) -> list[Score]:
    """Score friction by other laws than the catalogue's."""
    right = _those(rows, right_first)
    return [
        _share("friction", "right name first", right, rows),
        _share("friction", "parameter within 5 % or 3 std", _those(right, parameters_right), right),
        _coverage("friction", right),
    ]


def score_gain(rows: Sequence[Row]) -> list[Score]:
    """Score what is predicted of fresh drives."""
    ratios = np.array([row.path_rmse / row.fresh_path_rmse for row in rows if row.fresh_path_rmse > 0.0])
    ratios = ratios[np.isfinite(ratios)]
    near = np.abs(ratios - 1.0) <= PREDICTED
    share = float(np.mean(near)) if len(ratios) else math.nan
    middle = float(np.median(ratios)) if len(ratios) else math.nan
    return [
        Score("gain", "path error predicted within 20 %", share, len(ratios), ">= 95 %", share >= 0.95),
        Score("gain", "predicted over measured, median", middle, len(ratios), unit=""),
    ]


def score_length(rows: Sequence[Row]) -> list[Score]:
    """Score how the time grows with the length of the log."""
    timed = [row for row in rows if is_timed(row)]
    rate = {
        repeats: float(np.median(own))
        for repeats in sorted({row.case.repeats for row in rows})
        if (own := [row.cpu_seconds / row.case.seconds for row in timed if row.case.repeats == repeats])
    }
    if len(rate) < 2:
        return []
    growth = rate[max(rate)] / rate[min(rate)]
    quantity = f"time per second of driving, {max(rate)} drives over {min(rate)}"
    return [Score("length", quantity, growth, len(rows), f"<= {LINEAR}", growth <= LINEAR, unit="")]


def score_windows(rows: Sequence[Row]) -> list[Score]:
    """Score recordings in windows."""
    latencies = [right for row in rows for right in latencies_right(row)]
    share = float(np.mean(latencies)) if latencies else math.nan
    return [
        _share("windows", "a hidden effect first", _those(rows, hidden_first), rows, least=0.97),
        _share("windows", "wrongly named", _those(rows, wrongly_named), rows, most=0.02),
        Score("windows", "latencies within 10 % or 3 std", share, len(latencies), ">= 95 %", share >= 0.95),
        _share("windows", "all named that are large enough", _those(rows, all_large_named), rows),
    ]


def score_command(rows: Sequence[Row]) -> list[Score]:
    """Score the whole command."""
    return _most("command", "processor, report included", [row.cpu_seconds for row in rows], COMMAND_SECONDS, "s")


def score_hours(rows: Sequence[Row]) -> list[Score]:
    """Score a drive of two hours."""
    ended = _those(rows, lambda row: not row.error)
    return [
        _share("hours", "ran to the end", ended, rows, least=1.0),
        *_most("hours", "memory", [row.memory / 1e9 for row in ended], MEMORY / 1e9, "GB"),
        *_most("hours", "processor", [row.cpu_seconds for row in ended], math.inf, "s"),
    ]


def timing(rows: Sequence[Row]) -> list[Score]:
    """Score the time that one log of two minutes takes."""
    times = [row.cpu_seconds for row in rows if is_timed(row) and row.case.repeats == 1 and row.set_name != "command"]
    if not times:
        return []
    middle, worst = float(np.median(times)), float(np.quantile(times, 0.95))
    return [
        Score("time", "processor for one log, median", middle, len(times), f"<= {LOG_SECONDS:g} s", None, "s"),
        Score(
            "time", "processor for one log, 95 %", worst, len(times), f"<= {LOG_SECONDS:g} s", worst <= LOG_SECONDS, "s"
        ),
    ]


SCORES: Mapping[str, Callable[[Sequence[Row]], list[Score]]] = {
    "single": score_single,
    "brief": score_brief,
    "eight": score_eight,
    "null": score_null,
    "short": score_short,
    "coarse": score_coarse,
    "pairs": score_pairs,
    "unknown": score_unknown,
    "friction": score_friction,
    "gain": score_gain,
    "length": score_length,
    "windows": score_windows,
    "command": score_command,
    "hours": score_hours,
}


def _those(rows: Iterable[Row], hold: Callable[[Row], bool]) -> list[Row]:
    return [row for row in rows if hold(row)]


def _share(
    name: str,
    quantity: str,
    held: Sequence[Row],
    of: Sequence[Row],
    *,
    least: float | None = None,
    most: float | None = None,
) -> Score:
    """Return a share of rows, and whether it is at least or at most what is demanded."""
    share = len(held) / len(of) if of else math.nan
    if least is not None:
        return Score(name, quantity, share, len(of), f">= {100.0 * least:g} %", share >= least)
    if most is not None:
        return Score(name, quantity, share, len(of), f"<= {100.0 * most:g} %", share <= most)
    return Score(name, quantity, share, len(of))


def _coverage(name: str, rows: Sequence[Row]) -> Score:
    held = [inside for row in rows for inside in covered(row)]
    return _share_held(name, "95 % intervals that hold the truth", held)


def _coverage_of_paper(name: str, models: Sequence[tuple[Row, Mapping[str, Interval]]]) -> Score:
    held = [inside for row, estimates in models for inside in covered_of_paper(row, estimates)]
    return _share_held(name, "95 % intervals of the paper's parameters", held)


def _share_held(name: str, quantity: str, held: Sequence[bool]) -> Score:
    share = float(np.mean(held)) if held else math.nan
    return Score(name, quantity, share, len(held), "90 to 98 %", 0.90 <= share <= 0.98)


def _most(name: str, quantity: str, values: Sequence[float], limit: float, unit: str) -> list[Score]:
    """Return the largest value, and whether it is within the limit."""
    known = [value for value in values if math.isfinite(value)]
    if not known:
        return []
    largest = max(known)
    goal, reached = (f"<= {limit:g} {unit}", largest <= limit) if math.isfinite(limit) else ("", None)
    return [Score(name, quantity, largest, len(known), goal, reached, unit)]
