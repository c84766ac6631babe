"""The table: one line per measurement, with the machine above it."""

import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks.timing import Timing

UNITS = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
HEADER = "| work | measured | ratio | goal |\n|---|---|---|---|"


@dataclass(frozen=True)
class Point:
    """A point of the plot: CPU seconds of a step for a number of robots."""

    series: str
    robots: int
    seconds: float


@dataclass(frozen=True)
class Row:
    """One measurement: its result, the ratio to a reference if there is one, and its goal.

    `reached` is None without a goal; `point` is None if it is not the cost of a step.
    """

    work: str
    measured: str
    ratio: str = "-"
    goal: str = "-"
    reached: bool | None = None
    point: Point | None = None

    def line(self) -> str:
        """Return the line of the Markdown table; a missed goal is marked."""
        goal = f"{self.goal} (**missed**)" if self.reached is False else self.goal
        return f"| {self.work} | {self.measured} | {self.ratio} | {goal} |"


def skipped(work: str, why: str) -> Row:
    """Return the row of a measurement that is not possible here."""
    return Row(work, f"not measured: {why}")


def per_robot(timing: Timing, robots: int) -> str:
    """Return the time per robot and step, median and fastest repetition."""
    return seconds(Timing(timing.median / robots, timing.fastest / robots))


def seconds(timing: Timing) -> str:
    """Return a timing in a suitable unit, median and fastest repetition."""
    unit, size = next((item for item in UNITS if timing.median >= item[1]), UNITS[-1])
    return f"{timing.median / size:.3g} {unit} ({timing.fastest / size:.3g})"


def machine(core: int) -> str:
    """Return a description of the machine and the software."""
    versions = [f"{name} {_version(name)}" for name in ("numpy", "numba", "scipy", "lcm")]
    software = f"Python {platform.python_version()}, {', '.join(versions)}"
    return (
        f"{processor()}, {_frequency(core)}{platform.system()} {platform.machine()}; {software}. One core, float64. "
        "CPU time unless marked as wall: the median of alternating repetitions, the fastest in brackets."
    )


def processor() -> str:
    """Return the name of this computer's processor."""
    return _of_cpuinfo("model name") or platform.processor() or "unknown processor"


def _frequency(core: int) -> str:
    """Return the core's frequency: its maximum if the system reports it, otherwise its current one."""
    highest = Path(f"/sys/devices/system/cpu/cpu{core}/cpufreq/cpuinfo_max_freq")
    if highest.exists():
        return f"up to {int(highest.read_text()) / 1e6:.1f} GHz, "
    present = _of_cpuinfo("cpu MHz")
    return f"{float(present) / 1e3:.2f} GHz, " if present else ""


def _of_cpuinfo(key: str) -> str:
    try:
        lines: Iterable[str] = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(key)), "")


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "absent"
