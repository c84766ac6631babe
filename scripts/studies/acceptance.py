"""Run cmr accept on robots that break a promise on purpose, and on honest ones: scripts/study_acceptance."""

import argparse
import json
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path

from robot_driver.acceptance.findings import PROMISES
from robot_driver.acceptance.report import Report
from robot_driver.acceptance.running import LONG, SHORT, Pace
from tests.support.accepted_robot import Busy, accept
from tests.support.sabotage import ALL, DEVICES, promise_of


def run(options: argparse.Namespace) -> None:
    """Make the runs that are not yet in OUT/runs.jsonl, and print the result of all runs."""
    options.out.mkdir(parents=True, exist_ok=True)
    runs = options.out / "runs.jsonl"
    done = {json.loads(line)["run"] for line in runs.read_text().splitlines()} if runs.exists() else set()
    for name in sorted(ALL, key=promise_of):
        if name not in done and (not options.only or promise_of(name) in options.only):
            wanted = (promise_of(name),) if options.part else tuple(PROMISES)
            _run(runs, name, promise_of(name), wanted, hands=not options.part)
    for number in range(options.honest):
        name = f"honest {number + 1}{', busy core' if number < options.busy else ''}"
        if name not in done:
            _run(runs, name, 0, tuple(PROMISES), busy=number < options.busy)
    for number in range(options.long):
        if f"long {number + 1}" not in done:
            _run(runs, f"long {number + 1}", 0, tuple(PROMISES), pace=LONG)
    print(table([json.loads(line) for line in runs.read_text().splitlines()]))


def _run(
    runs: Path,
    name: str,
    promise: int,
    wanted: tuple[int, ...],
    *,
    hands: bool = True,
    busy: bool = False,
    pace: Pace = SHORT,
) -> None:
    """Make one run, and append its result to the file."""
    begun = time.time()
    with tempfile.TemporaryDirectory() as folder, Busy() if busy else nullcontext():
        report: Report = accept(
            Path(folder),
            name if promise else "",
            wanted=wanted,
            break_device=DEVICES.get(name),
            hands=hands,
            pace=pace,
        )
    said = [
        f"{finding.promise} {finding.check}: {finding.said}" for finding in report.findings if finding.passed is False
    ]
    load = float(Path("/proc/loadavg").read_text().split()[0])
    result = {"run": name, "promise": promise, "whole": len(wanted) > 1, "failed": report.failed, "said": said}
    result |= {"seconds": time.time() - begun, "load": load, "repeated": report.figures["steps_repeated"]}
    with runs.open("a") as file:
        file.write(json.dumps(result) + "\n")
    print(f"{name}: failed {report.failed} ({result['seconds']:.0f} s, load {load:.0f})", flush=True)


def table(runs: list[dict[str, object]]) -> str:
    """Return a summary of the runs, as lines for docs/measurements/acceptance.md."""
    broken = [run for run in runs if run["promise"]]
    found = [run for run in broken if run["promise"] in run["failed"]]  # type: ignore[operator]
    honest = [run for run in runs if not run["promise"]]
    passed = [run for run in honest if not run["failed"]]
    lines = [f"found {len(found)} of {len(broken)}; honest passed {len(passed)} of {len(honest)}"]
    lines += [f"missed: {run['run']}" for run in broken if run not in found]
    lines += [f"failed: {run['run']}: {run['said']}" for run in honest if run["failed"]]
    return "\n".join(lines)
