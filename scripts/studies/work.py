"""Run one case of scripts/study_diagnosis."""

import json
import multiprocessing
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from tests.hidden_effects.cases import Case
from tests.hidden_effects.diagnosing import diagnosed, predicted, read_and_diagnosed, row_of
from tests.hidden_effects.hiding import hide_case, truth_of
from tests.hidden_effects.rows import Row, hidden

COMMAND = Path(sys.prefix) / "bin" / "cmr-diagnose"


def row(set_name: str, case: Case) -> Row:
    """Run a case in the way of its set; return its row."""
    return WORK.get(set_name, diagnosed)(set_name, case)


def by_command(set_name: str, case: Case) -> Row:
    """Diagnose a log with the command cmr-diagnose; the CPU time excludes that of starting the command."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return row_of(set_name, case, lambda: {**hidden(hide_case(case, folder / "run.lcm").truth), **_command(folder)})


def in_own_processes(set_name: str, case: Case) -> Row:
    """Write and diagnose a long log in processes of its own, and measure the memory of the diagnosis."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "run.lcm"

        def findings() -> dict[str, Any]:
            _in_a_process(hide_case, case, path)
            return {**hidden(truth_of(case)), **_in_a_process(_with_memory, path)}

        return row_of(set_name, case, findings)


WORK: Mapping[str, Callable[[str, Case], Row]] = {"gain": predicted, "command": by_command, "hours": in_own_processes}


def _command(folder: Path) -> dict[str, Any]:
    """Run cmr-diagnose on the log in a folder."""
    start = _processor_time([str(COMMAND), "--version"])
    seconds = _processor_time([str(COMMAND), str(folder / "run.lcm"), "--out", str(folder / "found")])
    document = json.loads((folder / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    effects = document["effects"]
    return {
        "verdict": document["verdict"],
        "names": tuple(effect["name"] for effect in effects),
        "indistinguishable": tuple(tuple(effect["indistinguishable_from"]) for effect in effects),
        "cpu_seconds": seconds - start,
    }


def _processor_time(command: list[str]) -> float:
    """Run a command and return its CPU time [s].

    Raises RuntimeError with the end of its output if it fails.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RuntimeError(f"{Path(command[0]).name} ended with {ended.returncode}: {ended.stderr.strip()[-300:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _in_a_process(function: Callable[..., Any], *arguments: Any) -> Any:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def _with_memory(path: Path) -> dict[str, Any]:
    """Diagnose a log; return the findings, with the peak memory of this process [bytes]."""
    findings = read_and_diagnosed(path)
    return {**findings, "memory": 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}
