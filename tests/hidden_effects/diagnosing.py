"""Hide, diagnose, and put both side by side; what fails is told in the row."""

import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from cmr.diagnosis.diagnose import diagnose
from cmr.recordings.recording import Recording
from tests.hidden_effects.cases import Case, Truth
from tests.hidden_effects.hiding import hide_case, truth_of
from tests.hidden_effects.rows import Row, found, hidden


def diagnosed(set_name: str, case: Case) -> Row:
    """Return what a diagnosis makes of the log of a case, and of nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.lcm"
        return row_of(set_name, case, lambda: {**hidden(hide_case(case, path).truth), **read_and_diagnosed(path)})


def predicted(set_name: str, case: Case) -> Row:
    """Return what a diagnosis predicts of a fresh drive, and how far off the model is on a fresh drive."""

    def both() -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as folder:
            logs = [hide_case(replace(case, run=run), Path(folder) / f"{run}.lcm") for run in (0, 1)]
            first, fresh = (Recording.read(log.path) for log in logs)
            measured = found(diagnose(first, held_out=[fresh]))["path_rmse"]
            return {**hidden(logs[0].truth), **read_and_diagnosed(logs[0].path), "fresh_path_rmse": measured}

    return row_of(set_name, case, both)


def read_and_diagnosed(path: Path) -> dict[str, Any]:
    """Return what is found in a log, and the time of the processor it took."""
    begin = time.process_time()
    findings = found(diagnose(Recording.read(path)))
    return {**findings, "cpu_seconds": time.process_time() - begin}


def row_of(set_name: str, case: Case, fields: Callable[[], dict[str, Any]]) -> Row:
    """Return the row with these fields, or with the error that came instead."""
    try:
        return Row(set_name=set_name, case=case, **fields())
    except Exception as error:  # a study of hundreds of logs goes on
        truth: Truth = truth_of(case)
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        return Row(set_name=set_name, case=case, error=text, **hidden(truth))
