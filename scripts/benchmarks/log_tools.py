"""Rows of the log tools: CPU time and memory of each, for a log of ten minutes in a laboratory."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks import long_log
from benchmarks.report import Row

MINUTES = 10
LONGER = 4  # length of a second log, in lengths of the first; it shows whether memory grows
TOOLS = {  # arguments of each tool; {log} and {out} are filled in
    "cmr-log info": "{log}",
    "cmr-log cut": "{log} --start 30 --out {out}.lcm",
    "cmr-log merge": "{log} {log} --out {out}.lcm",
    "cmr-log csv": "{log} --out {out}",
    "cmr-log parquet": "{log} --out {out}",
    "cmr-log mcap": "{log} --out {out}.mcap",
    "cmr-plot": "{log} GYRO_0.yaw_rate MOTOR_FEEDBACK_0.psi_left --out {out}.png",
    "cmr-replay": "{log} --speed max --lcm-url udpm://239.255.76.67:7691?ttl=0",
}
GROWTH_MEASURED = ("cmr-log info", "cmr-log cut", "cmr-replay")  # measured with the longer log, too


def log_tools() -> Iterator[Row]:
    """Measure the CPU time and memory of each tool."""
    with tempfile.TemporaryDirectory() as name:
        log, longer = Path(name) / "log.lcm", Path(name) / "longer.lcm"
        long_log.write(log, 60 * MINUTES)
        long_log.write(longer, 60 * MINUTES * LONGER)
        size = log.stat().st_size / 1e6
        for tool in TOOLS:
            seconds, memory = _cost(tool, log)
            growth = f"{_cost(tool, longer)[1] / memory:.2f} times the memory" if tool in GROWTH_MEASURED else "-"
            yield Row(f"{tool}, {MINUTES} minutes, {size:.0f} MB", f"{seconds:.1f} s, {memory:.0f} MB", growth)


def _cost(tool: str, log: Path) -> tuple[float, float]:
    """Return the CPU time [s] and the largest memory [MB] of a tool. Raises RuntimeError if it failed."""
    name, *subcommand = tool.split()
    with tempfile.TemporaryDirectory(dir=log.parent) as folder:
        options = TOOLS[tool].format(log=log, out=Path(folder) / "out").split()
        command = [str(Path(sys.executable).parent / name), *subcommand, "--quiet", *options]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{tool} ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3
