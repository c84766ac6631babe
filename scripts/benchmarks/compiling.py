"""Rows of the first use on a computer: the functions compiled for each part, and all parts in parallel."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.processes import command_times
from benchmarks.report import Row, seconds
from benchmarks.timing import Timing, all_cores
from cmr.commands.first_use import PARTS

FIRST_USE = "cmr.commands.first_use"
WORTH_A_ROW = 0.4  # s


def first_use() -> Iterator[Row]:
    """Measure compilation at the first use, always with an empty cache."""
    with tempfile.TemporaryDirectory() as cache, all_cores():
        times = command_times([sys.executable, "-m", FIRST_USE], Path(cache))
    processor, wall = (Timing(duration, duration) for duration in times)
    yield Row(f"the whole compilation at the first use, on {os.cpu_count()} cores", _both(processor, wall))
    for part in PARTS:
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, "-m", "benchmarks.compiling", part]
            environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": os.pathsep.join(sys.path[:2])}
            result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        measured = json.loads(result.stdout)
        yield Row(f"{part}: {measured['functions']} functions, whole process", _seconds(measured["process"]))
        for name, duration in measured["own"]:
            count = measured["signatures"][name]
            signatures = f"compiled for {count} signatures" if count > 1 else "-"
            yield Row(f"- {name}, without its callees", _seconds(duration), signatures)


def _both(processor: Timing, wall: Timing) -> str:
    return f"{seconds(processor)}; wall {seconds(wall)}"


def _seconds(duration: float) -> str:
    return f"{duration:.2f} s"


def compiled(part: str) -> dict[str, Any]:
    """Compile a part in this process; return the CPU seconds of each compiled function, without its callees."""
    from numba.core import event as untyped

    event: Any = untyped  # Numba has no annotations
    own: defaultdict[str, float] = defaultdict(float)
    signatures: Counter[str] = Counter()
    running: list[list[float]] = []

    class _Clock(untyped.Listener):
        def on_start(self, _event: Any) -> None:
            running.append([time.thread_time(), 0.0])

        def on_end(self, compilation: Any) -> None:
            began, of_callees = running.pop()
            duration = time.thread_time() - began
            with suppress(IndexError):
                running[-1][1] += duration
            function = compilation.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__qualname__}"
            own[name] += duration - of_callees
            signatures[name] += 1

    event.register("numba:compile", _Clock())
    from cmr.commands.first_use import main

    main([part])
    longest_first = sorted(own.items(), key=lambda item: -item[1])
    shown = [(name, duration) for name, duration in longest_first if duration >= WORTH_A_ROW]
    return {
        "functions": sum(signatures.values()),
        "process": time.process_time(),
        "own": shown,
        "signatures": {name: signatures[name] for name, _ in shown},
    }


if __name__ == "__main__":
    print(json.dumps(compiled(sys.argv[1])))
