"""The results of kills: one line of a file for each, and a table of all."""

import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.support.stalls import Interval

PILOT, SIMULATOR, DRIVER, GATE, WRITER = "cmr-pilot", "cmr-sim", "cmr-driver", "last gate", "writer"
VICTIMS = (PILOT, SIMULATOR, DRIVER, GATE, WRITER)
ZERO, DRIVES, TWIN = "the duty is zero", "it drives again", "WORLD_STATE has its twin"
EVENTS = (ZERO, DRIVES, TWIN)
ZERO_WITHIN = 0.56  # s
ZERO_BY_MBOT = 1.1  # s; without the gate, its built-in watchdog stops it
BACK_WITHIN = 2.0  # s


@dataclass(frozen=True)
class Kill:
    """The result of one kill.

    `seconds` is the time until each event, `stalled` how long the machine stood still meanwhile [s]. `torn` describes
    an incomplete parameter file that was found; it is empty if there was none.
    """

    controller: str
    victim: str
    seconds: dict[str, float] = field(default_factory=dict)
    stalled: dict[str, float] = field(default_factory=dict)
    torn: str = ""

    def excess(self, event: str) -> float:
        """Return how much later than allowed an event happened [s]; negative if it was in time."""
        return self.seconds[event] - limit(self.controller, self.victim, event)

    def is_excused(self, event: str) -> bool:
        """Return whether an event was late by no more than the time for which the machine stood still."""
        return 0.0 < self.excess(event) <= self.stalled[event]

    def faults(self) -> list[str]:
        """Return a sentence for each check that failed."""
        late = [
            f"{self.controller}: after the kill of {self.victim}, {event} only after {seconds:.2f} s (the machine "
            f"stood still for {self.stalled[event]:.2f} s)"
            for event, seconds in self.seconds.items()
            if self.excess(event) > 0.0 and not self.is_excused(event)
        ]
        return late + [f"A parameter file was incomplete: {self.torn}"] * bool(self.torn)


def limit(controller: str, victim: str, event: str) -> float:
    """Return the time that is allowed until an event [s]."""
    if event != ZERO:
        return BACK_WITHIN
    return ZERO_BY_MBOT if (controller, victim) == ("mbot", GATE) else ZERO_WITHIN


def append_result(kill: Kill, path: Path) -> None:
    """Append a kill to a file of results."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(kill)) + "\n")


def read_results(path: Path) -> list[Kill]:
    """Return the kills in a file of results; none if there is no such file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [Kill(**json.loads(line)) for line in lines]


def stalled_time(stalls: Iterable[Interval], within: Interval) -> float:
    """Return how long the machine stood still within an interval [s]; stalls may overlap."""
    total, until = 0.0, within.begin
    for begin, end in sorted(stalls):
        total += max(0.0, min(end, within.end) - max(begin, until))
        until = max(until, end)
    return total


def report(kills: Iterable[Kill]) -> tuple[str, bool]:
    """Return a table of the results with the failed checks below it, and whether all checks passed.

    Times are the median and the maximum of those that are not excused, then the number and maximum of those that are.
    """
    groups: defaultdict[tuple[str, str], list[Kill]] = defaultdict(list)
    for kill in kills:
        groups[kill.controller, kill.victim].append(kill)
    lines = [f"| controller | killed | kills | {' | '.join(EVENTS)} |", "|---" * (3 + len(EVENTS)) + "|"]
    for (controller, victim), group in sorted(groups.items()):
        cells = [controller, victim, str(len(group)), *(_times(group, event) for event in EVENTS)]
        lines.append(f"| {' | '.join(cells)} |")
    faults = [fault for group in groups.values() for kill in group for fault in kill.faults()]
    torn = sum(bool(kill.torn) for group in groups.values() for kill in group)
    lines += ["", f"{sum(map(len, groups.values()))} kills; incomplete parameter files: {torn}."]
    return "\n".join(lines + faults), not faults


def _times(kills: list[Kill], event: str) -> str:
    """Return the table cell of the times until an event; a dash if it was not measured."""
    kills = [kill for kill in kills if event in kill.seconds]
    times = sorted(kill.seconds[event] for kill in kills if not kill.is_excused(event))
    excused = [kill.seconds[event] for kill in kills if kill.is_excused(event)]
    text = f"{times[len(times) // 2]:.2f} s, {times[-1]:.2f} s" if times else "-"
    return f"{text}; {len(excused)} excused, {max(excused):.2f} s" if excused else text
