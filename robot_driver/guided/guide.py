"""What a procedure says to a person, asks, and announces; no answer is ever assumed."""

from collections.abc import Callable
from typing import Protocol

from robot_driver.guided.steps import Choice, Kind, Step

LOOK = 0.02  # s between looks at whether somebody has answered


class Left(Exception):  # noqa: N818 - no fault: the person has gone
    """The person is not there any more: the terminal hung up, the input ended. Nothing may move from here on."""


class Front(Protocol):
    """Shows steps to a person and brings answers. None of its methods waits.

    Any of them may raise Left.
    """

    def show(self, step: Step) -> None:
        """Show a step in place of the one before; what was typed until now answers nothing."""

    def progress(self, fraction: float, text: str) -> None:
        """Show how far (0 to 1) the step is, and a few words."""

    def answer(self) -> str | None:
        """Return what the person has answered to the step that is shown, None when nothing yet."""

    def refuse(self, problem: str) -> None:
        """Say why the last answer was not taken; the step is still shown."""

    def dismiss(self, answer: str) -> None:
        """Show the step as over; `answer` is what it was answered with, or how it ended."""


class Guide:
    """Leads a person through steps.

    `wait` does whatever has to go on meanwhile, for so many seconds: the driver of a robot serves its motors there, in
    simulated time the clock advances. It may raise, which ends the procedure.
    """

    def __init__(self, front: Front, wait: Callable[[float], None]) -> None:
        self._front = front
        self._wait = wait

    def say(self, name: str, text: str) -> None:
        """Say something that needs no answer."""
        self._front.show(Step(name, Kind.NOTE, text))

    def progress(self, fraction: float, text: str = "") -> None:
        """Show how far the step is that is shown."""
        self._front.progress(min(max(fraction, 0.0), 1.0), text)

    def ask(self, name: str, text: str, choices: tuple[Choice, ...]) -> str:
        """Ask a question, wait for as long as it takes, and return the key of what was chosen."""
        return self._answer_to(Step(name, Kind.QUESTION, text, choices))

    def number(self, name: str, text: str, unit: str, lowest: float, highest: float) -> float:
        """Ask for a number within bounds."""
        return float(self._answer_to(Step(name, Kind.NUMBER, text, unit=unit, lowest=lowest, highest=highest)))

    def motion(self, name: str, text: str, seconds: float) -> "Motion":
        """Announce a motion of at most so many seconds, and return what says when it has to end."""
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
    """A motion that was announced, as a context manager; inside, `ended` is to be asked in each cycle.

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
        """Return whether it has to end now, `elapsed` seconds after it began: its time is over, or a key was pressed.

        Once ended by a key it stays so. Raises Left.
        """
        self.by_person = self.by_person or self._front.answer() is not None
        if not self.by_person:
            self._front.progress(min(elapsed / self._step.seconds, 1.0), "any key ends it")
        return self.by_person or elapsed >= self._step.seconds
