"""Notes, questions and announcements of a procedure to a person; no answer is ever assumed."""

from collections.abc import Callable
from typing import Protocol

from robot_driver.guided.steps import Choice, Kind, Step

LOOK = 0.02  # s between polls for an answer


class Left(Exception):  # noqa: N818 - not an error: the person has left
    """The person has left: the terminal was closed, or the input ended. Nothing may move from here on."""


class Front(Protocol):
    """Shows steps to a person and returns answers. None of its methods blocks.

    Any of them may raise Left.
    """

    def show(self, step: Step) -> None:
        """Show a step in place of the one before; earlier input is not an answer to it."""

    def progress(self, fraction: float, text: str) -> None:
        """Show the progress of the step (0 to 1), and a few words."""

    def answer(self) -> str | None:
        """Return the person's answer to the current step, None if there is none yet."""

    def refuse(self, problem: str) -> None:
        """Say why the last answer was refused; the step is still shown."""

    def dismiss(self, answer: str) -> None:
        """Show the step as over; `answer` is the answer to it, or how it ended."""


class Guide:
    """Leads a person through steps.

    `wait` does everything that must continue meanwhile, for this many seconds: a driver serves its motors, a simulation
    advances its clock. It may raise, which ends the procedure.
    """

    def __init__(self, front: Front, wait: Callable[[float], None]) -> None:
        self._front = front
        self._wait = wait

    def say(self, name: str, text: str) -> None:
        """Show a text that needs no answer."""
        self._front.show(Step(name, Kind.NOTE, text))

    def progress(self, fraction: float, text: str = "") -> None:
        """Show the progress of the current step."""
        self._front.progress(min(max(fraction, 0.0), 1.0), text)

    def ask(self, name: str, text: str, choices: tuple[Choice, ...]) -> str:
        """Ask a question, wait for as long as it takes, and return the key of the choice."""
        return self._answer_to(Step(name, Kind.QUESTION, text, choices))

    def number(self, name: str, text: str, unit: str, lowest: float, highest: float) -> float:
        """Ask for a number within bounds."""
        return float(self._answer_to(Step(name, Kind.NUMBER, text, unit=unit, lowest=lowest, highest=highest)))

    def motion(self, name: str, text: str, seconds: float) -> "Motion":
        """Announce a motion of at most so many seconds, and return an object that tells when it must end."""
        return Motion(self._front, Step(name, Kind.MOTION, text, seconds=seconds))

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self._wait(seconds)

    def _answer_to(self, step: Step) -> str:
        self._front.show(step)
        while True:
            answer = self._front.answer()
            if answer is None:
                self._wait(LOOK)
            elif problem := step.problem_with(answer):
                self._front.refuse(problem)
            else:
                self._front.dismiss(answer)
                return answer


class Motion:
    """A motion that was announced, as a context manager; inside, call `ended` in each cycle.

    `by_person` says whether a key, and not its time, has ended it.
    """

    def __init__(self, front: Front, step: Step) -> None:
        self._front = front
        self._step = step
        self.by_person = False

    def __enter__(self) -> "Motion":
        self._front.show(self._step)
        return self

    def __exit__(self, kind: type[BaseException] | None, _error: BaseException | None, _trace: object) -> None:
        if kind is None:
            self._front.dismiss("ended by you" if self.by_person else "done")

    def ended(self, elapsed: float) -> bool:
        """Return whether it must end now, `elapsed` seconds after it began: its time is over, or a key was pressed.

        Once ended by a key it stays so. Raises Left.
        """
        self.by_person = self.by_person or self._front.answer() is not None
        if not self.by_person:
            self._front.progress(min(elapsed / self._step.seconds, 1.0), "any key ends it")
        return self.by_person or elapsed >= self._step.seconds
