"""Input from a script, for tests and demonstrations: `ahead 3, left 1, rest 1`."""

from collections.abc import Sequence
from typing import NamedTuple

from cmr.teleop.hands import STILL, Hands

WORDS = {
    "ahead": Hands(1.0, 0.0),
    "back": Hands(-1.0, 0.0),
    "left": Hands(0.0, 1.0),
    "right": Hands(0.0, -1.0),
    "ahead-left": Hands(1.0, 0.5),
    "ahead-right": Hands(1.0, -0.5),
    "rest": STILL,
}


LONGEST = 3600.0  # s; of a step


class Step(NamedTuple):
    """A demand, and its duration [s]."""

    hands: Hands
    seconds: float


def steps(text: str) -> list[Step]:
    """Return the steps of a script. Raises ValueError naming the invalid step."""
    found = []
    for part in text.split(","):
        word, _, seconds = part.strip().partition(" ")
        if word not in WORDS:
            raise ValueError(f"{word!r} is none of {', '.join(WORDS)}")
        duration = float(seconds)
        if not 0.0 < duration <= LONGEST:
            raise ValueError(f"a step takes up to {LONGEST:g} s, not {seconds} s")
        found.append(Step(WORDS[word], duration))
    return found


class Scripted:
    """Executes a script step by step; begins at the first call of `look`, and ends after the last step."""

    name = "script"

    def __init__(self, script: Sequence[Step]) -> None:
        self._script = script
        self._began: float | None = None

    def look(self, now: float) -> None:
        """Begin."""
        self._began = now if self._began is None else self._began

    def hands(self, now: float) -> Hands:
        """Return the demand of the current step."""
        return next((step.hands for step, end in self._ends() if now < end), STILL)

    def requests(self) -> list[str]:
        """Return nothing: a script ends by `is_over`."""
        return []

    def problem(self, _now: float) -> str:
        """Nothing keeps a script from going on."""
        return ""

    def is_over(self, now: float) -> bool:
        """Return whether all steps are done."""
        return all(now >= end for _, end in self._ends())

    def _ends(self) -> list[tuple[Step, float]]:
        """Return each step with the time [s] at which it ends."""
        end, result = self._began or 0.0, []
        for step in self._script:
            end += step.seconds
            result.append((step, end))
        return result
