"""Signals that ask a command to end, which then ends in its own time."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Stopping:
    """Whether a signal asked to end; false until then."""

    def __init__(self) -> None:
        self._asked = False

    def __bool__(self) -> bool:
        return self._asked

    def note(self, _number: int, _frame: FrameType | None) -> None:
        """Take a signal."""
        self._asked = True


@contextmanager
def stopped_by_signals() -> Iterator[Stopping]:
    """Give what says whether SIGINT, SIGTERM or SIGHUP came, which then end nothing by themselves."""
    stopping = Stopping()
    before = {number: signal.signal(number, stopping.note) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
