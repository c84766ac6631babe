"""Write the results of a study: the scores of every run, the table, and a document for programs."""

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from cmr.experiments.fidelity.findings import Finding, conclusions, rows
from cmr.experiments.fidelity.study import Scores
from cmr.files import write_atomically

RUNS, TABLE, DOCUMENT, FIGURE = "runs.csv", "fidelity.csv", "fidelity.json", "fidelity.png"


def write(
    folder: Path, scores: Mapping[str, Sequence[Scores]], findings: Sequence[Finding], about: object
) -> list[Path]:
    """Write all files into a folder, which exists; `about`, a mapping, describes the study.

    Raises OSError when it cannot be written.
    """
    from cmr.experiments.fidelity.plots import figure_of  # draws with Matplotlib, which is slow to import

    runs = [{"set": name, "number": k, **one} for name, ones in scores.items() for k, one in enumerate(ones)]
    content = {
        "schema": 1,
        "about": about,
        "findings": [{name: _finite(value) for name, value in row.items()} for row in rows(findings)],
        "sentences": conclusions(scores, findings),
    }
    write_atomically(_csv(runs), folder / RUNS)
    write_atomically(_csv(rows(findings)), folder / TABLE)
    write_atomically(json.dumps(content, indent=2, allow_nan=False) + "\n", folder / DOCUMENT)
    figure_of(findings).savefig(folder / FIGURE)
    return [folder / name for name in (RUNS, TABLE, DOCUMENT, FIGURE)]


def _csv(records: Iterable[Mapping[str, object]]) -> str:
    entries = list(records)
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(entries[0]) if entries else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(entries)
    return text.getvalue()


def _finite(value: str | float) -> str | float | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value
