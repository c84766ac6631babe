"""A scripted person for tests: answers by the name of the step."""

from collections.abc import Callable, Mapping

from robot_driver.guided.steps import Kind, Step

Reply = str | Callable[[Step], str | None]


class NotInTheScript(AssertionError):  # noqa: N818 - named for the event
    """A step needs an answer that the script lacks."""


class Scripted:
    """A front with prepared answers.

    `replies` has, for the name of a step, the answer, or a function that is called at each poll and returns None while
    there is no answer yet. A motion without a reply is not interrupted. `shown` are the steps in order, `answers` the
    answers given.
    """

    def __init__(self, replies: Mapping[str, Reply]) -> None:
        self._replies = replies
        self._step: Step | None = None
        self.shown: list[Step] = []
        self.answers: list[tuple[str, str]] = []

    @property
    def text(self) -> str:
        """All that was shown, a paragraph for each step."""
        return "\n\n".join(step.text for step in self.shown)

    def show(self, step: Step) -> None:
        """Record the step."""
        self._step = step
        self.shown.append(step)

    def progress(self, fraction: float, text: str) -> None:
        """Show nothing."""

    def answer(self) -> str | None:
        """Answer the current step."""
        step = self._step
        if step is None:
            return None
        reply = self._replies.get(step.name)
        if reply is None and step.kind in (Kind.QUESTION, Kind.NUMBER):
            raise NotInTheScript(f"{step.name}: {step.text}")
        return reply(step) if callable(reply) else reply

    def refuse(self, problem: str) -> None:
        """Fail: answers of the script must be valid."""
        raise NotInTheScript(f"{self._step.name if self._step else ''}: {problem}")

    def dismiss(self, answer: str) -> None:
        """Record the answer."""
        assert self._step is not None
        self.answers.append((self._step.name, answer))
        self._step = None
