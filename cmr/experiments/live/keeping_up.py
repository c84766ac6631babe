"""Whether the computer kept up with a run; otherwise the measurements are not valid."""

from collections.abc import Iterable
from typing import NamedTuple

TOO_LATE = 0.1  # of a process's cycles, each late by a whole period; as in cmr.world.lateness
TOO_SLOW = 0.9  # of the rate at which the world should be published
SHORTEST = 1.0  # s; shorter times are not sufficient
ADVICE = (
    "The computer was too busy; robots and cables are not the cause. "
    "Close other programs or simulate fewer robots, then repeat the run."
)


class Pace(NamedTuple):
    """Timing of a process: the rate of its loop [Hz], and the number of cycles late by a whole period."""

    name: str
    rate: float
    late: int


def late_share(pace: Pace, seconds: float) -> float:
    """Return the share of a process's cycles in `seconds` that were late."""
    return pace.late / max(pace.rate * seconds, pace.late, 1.0)


def is_too_late(pace: Pace, seconds: float) -> bool:
    """Return whether too many cycles of a process were late for its results to be reliable."""
    return seconds >= SHORTEST and late_share(pace, seconds) > TOO_LATE


def what_was_too_slow(paces: Iterable[Pace], seconds: float, world_rate: float, wanted_rate: float) -> list[str]:
    """Return a clause for each sign that the computer was too busy; empty if it kept up.

    `paces` are those of the processes that move robots, in a run of `seconds`; the world was published at `world_rate`
    and should have been at `wanted_rate` [Hz].
    """
    if seconds < SHORTEST:
        return []
    found = [
        f"{pace.name} was late in {100.0 * late_share(pace, seconds):.0f} % of its cycles"
        for pace in paces
        if is_too_late(pace, seconds)
    ]
    if world_rate < TOO_SLOW * wanted_rate:
        found.append(f"the world was published at {world_rate:.0f} Hz instead of {wanted_rate:.0f} Hz")
    return found


def in_words(found: Iterable[str]) -> str:
    """Return the sentences for a person; empty without findings."""
    clauses = "; ".join(found)
    return f"Unreliable: {clauses}. {ADVICE}" if clauses else ""
