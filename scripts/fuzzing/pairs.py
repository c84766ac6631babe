"""All pairs of a process and a message type that it subscribes to: which there are, and what came of fuzzing them."""

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
from fuzzing.subscriptions import not_made

TARGET = Path(__file__).with_name("bus_target.py")
COLUMNS = "| process | message | executions | edges | features | lives | longest step | growth | found |"
HEAD = f"{COLUMNS}\n{'|---' * 9}|"
COVERAGE = re.compile(r"cov: (\d+) ft: (\d+) ")
EVERY, NOTED = "every", "subscriptions.json"  # as in bus_target.py
BY_CHANCE = "by chance"


@dataclass(frozen=True)
class Plan:
    """How pairs are fuzzed: where results go, for how many seconds each, and how many at a time."""

    out: Path
    seconds: float
    by_chance: bool = False
    jobs: int = 1

    @property
    def has_atheris(self) -> bool:
        """Whether Atheris finds the inputs."""
        return not self.by_chance and find_spec("atheris") is not None


def pairs_of(process: str, out: Path) -> list[str]:
    """Return the streams that a process subscribes to."""
    heard: list[str] = _noted(process, out)["heard"]
    return heard


def unfuzzed(out: Path) -> list[str]:
    """Return where in the code somebody subscribes to what no process was seen to subscribe to, as file:line."""
    made = {(name, line) for process in PROGRAMS for name, line in _noted(process, out)["places"]}
    return not_made(ROOT, made)


def _noted(process: str, out: Path) -> dict[str, Any]:
    """Return what a process was seen to subscribe to, and where; it is started if that was not seen yet."""
    noted = out / _folder(process) / NOTED
    if not noted.exists():
        noted.parent.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(_command(process, "?", 0, noted.parent), capture_output=True, text=True, check=True)
        noted.write_text(done.stdout)
    return dict(json.loads(noted.read_text()))


def fuzz_all(plan: Plan, only: str | None) -> bool:
    """Fuzz all pairs, or those of one process, and print a table; return whether something was found."""
    wanted, _, stream = (only or "").partition(":")
    processes = [name for name in PROGRAMS if not wanted or name == wanted]
    if not processes:
        raise SystemExit(f"There is no process {wanted}: {', '.join(PROGRAMS)}")
    print(HEAD, flush=True)
    with ThreadPoolExecutor(plan.jobs) as pool:
        is_found: bool = any(list(pool.map(lambda name: _fuzz(plan, name, stream), processes)))
    left_out = [] if wanted else unfuzzed(plan.out)
    for place in left_out:
        print(f"Not fuzzed: what is subscribed to in {place}", flush=True)
    return is_found or bool(left_out)


def try_again(records: Iterable[Path]) -> int:
    """Give the lives of records their inputs again; return the worst exit code."""
    worst = 0
    for record in records:
        folder = record.absolute().parent
        process = next(name for name in PROGRAMS if _folder(name) == folder.parent.name)
        again = folder.parent / "again"
        command = _command(process, folder.name, 0, again, str(record.absolute()))
        worst = max(worst, subprocess.run(command, check=False).returncode)
        said = again / folder.name / "found.txt"
        print(said.read_text() if said.exists() else f"{record}: nothing was found", flush=True)
    return worst


def _fuzz(plan: Plan, process: str, only: str) -> bool:
    """Fuzz the pairs of a process that are not finished."""
    folder = plan.out / _folder(process)
    if not (plan.has_atheris or only or (folder / NOTED).exists()):
        _run(plan, process, EVERY, folder)
    streams = [stream for stream in pairs_of(process, plan.out) if not only or stream == only]
    if not streams:
        print(f"Not fuzzed: {process}, which subscribed to nothing: {_noted(process, plan.out)['found']}", flush=True)
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
        said = COVERAGE.findall((folder / "log").read_text(errors="replace"))
        if more and said:
            outcome["edges"], outcome["features"] = map(int, said[-1])
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
    seen = [f"{result[name]:,}" if name in result else BY_CHANCE for name in ("edges", "features")]
    numbers = [f"{result['executions']:,}", *seen, result["lives"], f"{result['longest']:.3f} s"]
    cells = [process, stream, *numbers, f"{result['growth'] / 1e6:.0f} MB", kinds or 0]
    return f"| {' | '.join(map(str, cells))} |"


def _folder(process: str) -> str:
    return process.replace(" ", "_")
