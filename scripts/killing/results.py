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
    """Return what came out as a table with what was wrong below it, and whether nothing was."""
    kills = list(kills)
    each: defaultdict[tuple[str, str, str], list[Kill]] = defaultdict(list)
    for kill in kills:
        for what in kill.seconds:
            each[kill.controller, kill.victim, what].append(kill)
    lines = [
        "| controller | killed | until | kills | median | latest | at most | excused | latest of those |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [_row(name, some) for name, some in sorted(each.items())]
    lines.append(f"Besides, what writes parameter files was killed {sum(k.victim == WRITER for k in kills)} times.")
    faults = [fault for kill in kills for fault in kill.faults()]
    return "\n".join(lines + faults), not faults


def _row(name: tuple[str, str, str], kills: list[Kill]) -> str:
    """Return the row of the table on what followed from the kills of one process."""
    what = name[2]
    times = sorted(kill.seconds[what] for kill in kills if not kill.is_excused(what))
    excused = [kill.seconds[what] for kill in kills if kill.is_excused(what)]
    cells = [f"{times[len(times) // 2]:.2f} s", f"{times[-1]:.2f} s"] if times else ["", ""]
    cells += [f"{limit(*name):g} s", str(len(excused)), f"{max(excused):.2f} s" if excused else ""]
    return "| " + " | ".join([*name, str(len(kills)), *cells]) + " |"
