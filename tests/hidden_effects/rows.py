"""What a diagnosis made of one log beside what was hidden in it: one row of a study, kept as CSV."""

import csv
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any

from cmr.diagnosis.next_experiment import drive_showing
from cmr.diagnosis.result import Diagnosis, Fitted
from cmr.estimation.estimates import Estimate
from cmr.model.parameters import DEFINITIONS as PAPER
from tests.hidden_effects.cases import Case, Truth


@dataclass(frozen=True, kw_only=True)
class Row:
    """One log: the case, the truth, and what was found.

    `names` are the effects named, by evidence, `statistics` their evidence, `indistinguishable` the names given beside
    each. `estimates` are (value, standard deviation, lower and upper end of the 95 % interval) by parameter.
    `path_rmse` [m] is the error predicted for drives not fitted, `fresh_path_rmse` that on a fresh drive
    of the same robot. `cpu_seconds` took reading and diagnosing, `memory` [bytes] is the most that was in use;
    `error` is the text of what went wrong, empty if nothing did. `baseline` and `extended` are estimates of the paper's
    parameters in both models; rows that were written before these were kept have none.
    """

    set_name: str
    case: Case
    robot: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    verdict: str = ""
    names: tuple[str, ...] = ()
    statistics: tuple[float, ...] = ()
    indistinguishable: tuple[tuple[str, ...], ...] = ()
    estimates: Mapping[str, tuple[float, float, float, float]] = field(default_factory=dict)
    unexplained: bool = False
    unexplained_signal: str = ""
    unexplained_share: float = 0.0
    next_experiment: str = ""
    path_rmse: float = math.nan
    fresh_path_rmse: float = math.nan
    cpu_seconds: float = math.nan
    memory: float = math.nan
    error: str = ""
    baseline: Mapping[str, tuple[float, float, float, float]] = field(default_factory=dict)
    extended: Mapping[str, tuple[float, float, float, float]] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, Case]:
        """What tells this row from all others."""
        return self.set_name, self.case


def found(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return what a diagnosis says, as fields of a row."""
    named, extended = diagnosis.effects, diagnosis.extended
    # A sentence names three effects at most; the drive shows more.
    _, shown = drive_showing(diagnosis.not_visible)
    words = (
        " ".join([diagnosis.next_experiment, *(name.replace("_", " ") for name in shown)])
        if diagnosis.next_experiment
        else ""
    )
    experiments = [words, *(effect.next_experiment for effect in named)]
    return {
        "verdict": diagnosis.verdict,
        "names": tuple(effect.name for effect in named),
        "statistics": tuple(float(effect.statistic) for effect in named),
        "indistinguishable": tuple(tuple(effect.indistinguishable_from) for effect in named),
        "estimates": {name: one for effect in named for name, one in _intervals(effect.estimates).items()},
        "unexplained": diagnosis.unexplained.present,
        "unexplained_signal": diagnosis.unexplained.signal or "",
        "unexplained_share": float(diagnosis.unexplained.share),
        "next_experiment": next((text for text in experiments if text), ""),
        "path_rmse": math.nan if extended is None else float(extended.held_out_path_rmse),
        "baseline": _of_paper(diagnosis.baseline),
        "extended": _of_paper(extended),
    }


def _of_paper(fitted: Fitted | None) -> dict[str, tuple[float, ...]]:
    """Return the estimates that a model has of the paper's parameters."""
    estimates = fitted.estimates if fitted else {}
    return _intervals({name: estimate for name, estimate in estimates.items() if name in PAPER})


def _intervals(estimates: Mapping[str, Estimate]) -> dict[str, tuple[float, ...]]:
    """Return value, standard deviation, lower and upper end of the 95 % interval by name."""
    return {name: tuple(map(float, (one.value, one.std, *one.interval))) for name, one in estimates.items()}


def hidden(truth: Truth) -> dict[str, Any]:
    """Return what was hidden, as fields of a row."""
    return {"robot": dict(truth.robot), "parameters": dict(truth.parameters)}


ADDED = 2  # columns at the end that older files lack
COLUMNS = ("set", *(part.name for part in fields(Case)), *(part.name for part in fields(Row)[2:]))


def append(path: Path, rows: Iterable[Row]) -> None:
    """Append rows to a CSV file, in place of a line torn by the end of a process; a new file gets a heading first."""
    there = path.read_bytes() if path.exists() else b""
    whole = there.rfind(b"\n") + 1
    with path.open("a", newline="", encoding="utf-8") as stream:
        stream.truncate(whole)
        writer = csv.writer(stream, lineterminator="\n")
        if not whole:
            writer.writerow(COLUMNS)
        for row in rows:
            writer.writerow(_cells(row))


def read(path: Path) -> list[Row]:
    """Return the rows of a CSV file, the last of each case; a line torn by the end of a process is passed over."""
    rows: dict[tuple[str, Case], Row] = {}
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as stream:
        whole = [line for line in stream if line.endswith("\n")]
        for cells in list(csv.reader(whole))[1:]:
            older = ["{}"] * ADDED if len(cells) == len(COLUMNS) - ADDED else []
            try:
                row = _row(dict(zip(COLUMNS, [*cells, *older], strict=True)))
            except ValueError:
                continue
            rows[row.key] = row
    return list(rows.values())


def _cells(row: Row) -> list[str]:
    case = [getattr(row.case, part.name) for part in fields(Case)]
    further = [getattr(row, part.name) for part in fields(Row)[2:]]
    # No line breaks inside texts: a line of the file is a row.
    texts = (value if isinstance(value, str) else json.dumps(value) for value in (row.set_name, *case, *further))
    return [" ".join(text.split()) for text in texts]


def _row(cells: Mapping[str, str]) -> Row:
    case = Case(**{part.name: _value(part, cells[part.name]) for part in fields(Case)})
    further = {part.name: _value(part, cells[part.name]) for part in fields(Row)[2:]}
    return Row(set_name=cells["set"], case=case, **further)


def _value(part: Field[Any], cell: str) -> Any:
    """Return what a cell says of a field: texts stand as they are, all else as JSON."""
    return cell if part.type is str else _frozen(json.loads(cell))


def _frozen(value: Any) -> Any:
    """Return JSON with tuples for its lists."""
    if isinstance(value, list):
        return tuple(_frozen(part) for part in value)
    return {name: _frozen(part) for name, part in value.items()} if isinstance(value, dict) else value
