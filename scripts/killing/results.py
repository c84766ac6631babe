"""What kills did: a line of a file for each, and the table of them all."""

import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.support.stalls import Interval

PILOT, SIMULATOR, DRIVER, GATE, WRITER = "cmr-pilot", "cmr-sim", "cmr-driver", "last gate", "writer"
VICTIMS = (PILOT, SIMULATOR, DRIVER, GATE, WRITER)
ZERO, DRIVES, TWIN = "the duty is zero", "it drives again", "WORLD_STATE has its twin"
AFTERWARDS = (ZERO, DRIVES, TWIN)
ZERO_WITHIN = 0.56  # s
ZERO_BY_MBOT = 1.1  # s; its watchdog is built in
BACK_WITHIN = 2.0  # s


@dataclass(frozen=True)
class Kill:
    """What one kill did.

    How long each thing took, for how long the machine stood still meanwhile [s], and what was wrong with a parameter
    file; empty if nothing was.
    """

    controller: str
    victim: str
    seconds: dict[str, float] = field(default_factory=dict)
    stalled: dict[str, float] = field(default_factory=dict)
    torn: str = ""

    def excess(self, what: str) -> float:
        """Return by how much a thing came too late [s]; negative where it did not."""
        return self.seconds[what] - limit(self.controller, self.victim, what)

    def is_excused(self, what: str) -> bool:
        """Return whether a thing came late by no more than the machine stood still."""
        return 0.0 < self.excess(what) <= self.stalled[what]

    def faults(self) -> list[str]:
        """Return what was not as it should be."""
        late = [
            f"{self.controller}: after the kill of {self.victim}, {what} only after {seconds:.2f} s (the machine stood "
            f"still for {self.stalled[what]:.2f} s)"
            for what, seconds in self.seconds.items()
            if self.excess(what) > 0.0 and not self.is_excused(what)
        ]
        return late + [f"A parameter file was torn: {self.torn}"] * bool(self.torn)


def limit(controller: str, victim: str, what: str) -> float:
    """Return how long a thing may take [s]."""
    if what != ZERO:
        return BACK_WITHIN
    return ZERO_BY_MBOT if (controller, victim) == ("mbot", GATE) else ZERO_WITHIN


def keep(kill: Kill, path: Path) -> None:
    """Add a kill to a file of results."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(kill)) + "\n")


def kept(path: Path) -> list[Kill]:
    """Return the kills of a file of results; none where there is no such file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [Kill(**json.loads(line)) for line in lines]


def stood_still(stalls: Iterable[Interval], within: Interval) -> float:
    """Return for how long the machine stood still within an interval [s]; stalls may overlap."""
    total, until = 0.0, within.begin
    for begin, end in sorted(stalls):
        total += max(0.0, min(end, within.end) - max(begin, until))
        until = max(until, end)
    return total


def report(kills: Iterable[Kill]) -> tuple[str, bool]:
    """Return what came out as a table, with what was wrong below it, and whether nothing was.

    Times are the median and the latest, without those that are excused; how many those are and their latest follow.
    """
    each: defaultdict[tuple[str, str], list[Kill]] = defaultdict(list)
    for kill in kills:
        each[kill.controller, kill.victim].append(kill)
    lines = [f"| controller | killed | kills | {' | '.join(AFTERWARDS)} |", "|---" * (3 + len(AFTERWARDS)) + "|"]
    for (controller, victim), some in sorted(each.items()):
        cells = [controller, victim, str(len(some)), *(_times(some, what) for what in AFTERWARDS)]
        lines.append(f"| {' | '.join(cells)} |")
    faults = [fault for some in each.values() for kill in some for fault in kill.faults()]
    torn = sum(bool(kill.torn) for some in each.values() for kill in some)
    lines += ["", f"{sum(map(len, each.values()))} kills; torn parameter files: {torn}."]
    return "\n".join(lines + faults), not faults


def _times(kills: list[Kill], what: str) -> str:
    """Return when something came to be after these kills, for the table; a dash where it is not looked at."""
    kills = [kill for kill in kills if what in kill.seconds]
    times = sorted(kill.seconds[what] for kill in kills if not kill.is_excused(what))
    excused = [kill.seconds[what] for kill in kills if kill.is_excused(what)]
    text = f"{times[len(times) // 2]:.2f} s, {times[-1]:.2f} s" if times else "-"
    return f"{text}; {len(excused)} excused, {max(excused):.2f} s" if excused else text
