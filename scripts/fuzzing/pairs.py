"""Find all pairs of a process and a message type that it subscribes to, fuzz them, and tabulate the results."""

import json
import re
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fuzzing.programs import PROGRAMS, ROOT
from fuzzing.subscriptions import missing_subscriptions

TARGET = Path(__file__).with_name("bus_target.py")
COLUMNS = "| process | message | executions | edges | features | runs | longest step | growth | found |"
HEAD = f"{COLUMNS}\n{'|---' * 9}|"
COVERAGE = re.compile(r"cov: (\d+) ft: (\d+) ")
EVERY, SUBSCRIPTIONS_FILE = "every", "subscriptions.json"  # as in bus_target.py
BY_CHANCE = "by chance"


@dataclass(frozen=True)
class Plan:
    """How pairs are fuzzed: folder of results, CPU time for each [s], and number of processes at the same time."""

    out: Path
    seconds: float
    by_chance: bool = False
    jobs: int = 1

    @property
    def has_atheris(self) -> bool:
        """Whether Atheris chooses the inputs."""
        return not self.by_chance and find_spec("atheris") is not None


def pairs_of(process: str, out: Path) -> list[str]:
    """Return the streams that a process subscribes to."""
    streams: list[str] = _subscriptions(process, out)["streams"]
    return streams


def unfuzzed(out: Path) -> list[str]:
    """Return the places in the code, as file:line, that subscribe but were reached by no started process."""
    observed = {(name, line) for process in PROGRAMS for name, line in _subscriptions(process, out)["places"]}
    return missing_subscriptions(ROOT, observed)


def _subscriptions(process: str, out: Path) -> dict[str, Any]:
    """Return the subscriptions of a process and their places in the code; start the process if no file has them."""
    file = out / _folder(process) / SUBSCRIPTIONS_FILE
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(_command(process, "?", 0, file.parent), capture_output=True, text=True, check=True)
        file.write_text(done.stdout)
    return dict(json.loads(file.read_text()))


def fuzz_all(plan: Plan, only: str | None) -> bool:
    """Fuzz all pairs, or those of `only`, and print a table; return whether a problem was found."""
    wanted, _, stream = (only or "").partition(":")
    processes = [name for name in PROGRAMS if not wanted or name == wanted]
    if not processes:
        raise SystemExit(f"There is no process {wanted}. Known processes: {', '.join(PROGRAMS)}")
    print(HEAD, flush=True)
    with ThreadPoolExecutor(plan.jobs) as pool:
        is_found: bool = any(list(pool.map(lambda name: _fuzz(plan, name, stream), processes)))
    missing = [] if wanted else unfuzzed(plan.out)
    for place in missing:
        print(f"Not fuzzed: the subscription in {place}", flush=True)
    return is_found or bool(missing)


def try_again(records: Iterable[Path]) -> int:
    """Repeat recorded runs and print their findings; return the largest exit code."""
    worst = 0
    for record in records:
        folder = record.absolute().parent
        process = next(name for name in PROGRAMS if _folder(name) == folder.parent.name)
        again = folder.parent / "again"
        command = _command(process, folder.name, 0, again, str(record.absolute()))
        worst = max(worst, subprocess.run(command, check=False).returncode)
        findings = again / folder.name / "found.txt"
        print(findings.read_text() if findings.exists() else f"{record}: nothing was found", flush=True)
    return worst


def _fuzz(plan: Plan, process: str, only: str) -> bool:
    """Fuzz the unfinished pairs of a process and print all rows; return whether a problem was found."""
    folder = plan.out / _folder(process)
    if not (plan.has_atheris or only or (folder / SUBSCRIPTIONS_FILE).exists()):
        _run(plan, process, EVERY, folder)
    streams = [stream for stream in pairs_of(process, plan.out) if not only or stream == only]
    if not streams:
        found = _subscriptions(process, plan.out)["found"]
        print(f"Not fuzzed: {process}, which subscribed to nothing: {found}", flush=True)
        return True
    missing = [stream for stream in streams if not _is_done(folder / stream, plan.seconds)]
    if plan.has_atheris:
        for stream in missing:
            _run(plan, process, stream, folder, "--atheris")
    elif missing:
        _run(plan, process, ",".join(missing), folder)
    for stream in streams:
        print(_row(process, stream, folder / stream), flush=True)
    return any(_found(folder / stream) for stream in streams)


def _run(plan: Plan, process: str, streams: str, folder: Path, *more: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "log").open("wb") as log:
        subprocess.run(_command(process, streams, plan.seconds, folder, *more), stderr=log, stdout=log, check=False)
    for stream in pairs_of(process, plan.out) if streams == EVERY else streams.split(","):
        result = folder / stream / "result.json"
        if not result.exists():
            continue
        outcome = json.loads(result.read_text()) | {"seconds": plan.seconds}
        coverage = COVERAGE.findall((folder / "log").read_text(errors="replace"))
        if more and coverage:
            outcome["edges"], outcome["features"] = map(int, coverage[-1])
        result.write_text(json.dumps(outcome))


def _command(process: str, streams: str, seconds: float, folder: Path, *more: str) -> list[str]:
    return [sys.executable, str(TARGET), process, streams, f"{seconds:g}", str(folder), *more]


def _is_done(folder: Path, seconds: float) -> bool:
    return float(_result(folder).get("seconds", 0.0)) >= seconds


def _result(folder: Path) -> dict[str, Any]:
    path = folder / "result.json"
    return dict(json.loads(path.read_text())) if path.exists() else {}


def _found(folder: Path) -> bool:
    result = _result(folder)
    return not result or bool(result["found"])


def _row(process: str, stream: str, folder: Path) -> str:
    result = _result(folder)
    if not result:
        return f"| {process} | {stream} | - | - | - | - | - | - | ended early: {folder.parent / 'log'} |"
    kinds = ", ".join(f"{count} x {kind} {where}".strip() for kind, where, count in result["found"])
    coverage = [f"{result[name]:,}" if name in result else BY_CHANCE for name in ("edges", "features")]
    numbers = [f"{result['executions']:,}", *coverage, result["runs"], f"{result['longest']:.3f} s"]
    cells = [process, stream, *numbers, f"{result['growth'] / 1e6:.0f} MB", kinds or 0]
    return f"| {' | '.join(map(str, cells))} |"


def _folder(process: str) -> str:
    return process.replace(" ", "_")
