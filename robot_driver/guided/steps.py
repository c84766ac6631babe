"""The steps of a guided procedure, as data for any front and for messages."""

import math
from dataclasses import dataclass
from enum import IntEnum


class Kind(IntEnum):
    """What a step requires of the person."""

    NOTE = 0  # nothing: information only
    QUESTION = 1  # one of the choices; there is no default
    NUMBER = 2  # a number within bounds
    MOTION = 3  # nothing, but any answer ends the motion


@dataclass(frozen=True)
class Choice:
    """An answer that may be given: the short `key` to type, and what it means."""

    key: str
    text: str


@dataclass(frozen=True)
class Step:
    """One step of a procedure.

    `name` identifies it in scripts; it is unique within the procedure, but a step may be repeated. `seconds` is how
    long a motion lasts at most. A number is asked for in `unit`, from `lowest` to `highest`.
    """

    name: str
    kind: Kind
    text: str
    choices: tuple[Choice, ...] = ()
    unit: str = ""
    lowest: float = -math.inf
    highest: float = math.inf
    seconds: float = 0.0

    def problem_with(self, answer: str) -> str:
        """Return why this answer is invalid, as a sentence that says what is valid; "" if it is valid."""
        if self.kind is Kind.QUESTION:
            keys = [choice.key for choice in self.choices]
            return "" if answer in keys else f"Please answer {', '.join(keys[:-1])} or {keys[-1]}."
        if self.kind is Kind.NUMBER:
            return self._problem_with_number(answer)
        return ""

    def _problem_with_number(self, answer: str) -> str:
        wanted = f"Please give a number from {self.lowest:g} to {self.highest:g}"
        wanted += f", in {self.unit}." if self.unit else "."
        try:
            number = float(answer)
        except ValueError:
            return wanted
        return "" if self.lowest <= number <= self.highest else wanted


def no_or_yes(yes: str, no: str) -> tuple[Choice, ...]:
    """Return the choices of a question that is answered by yes or no, with what each means."""
    return Choice("yes", yes), Choice("no", no)
