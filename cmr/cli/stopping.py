"""Signals that ask a command to end: at its own pace, or at once if finished work is kept."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from cmr.cli.progress import leave_terminal

EXIT_INTERRUPTED = 130


class Stopping:
    """Whether a signal asked to end."""

    def __init__(self) -> None:
        self._asked = False

    def __bool__(self) -> bool:
        return self._asked

    def note(self, _number: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self._asked = True


@contextmanager
def stopped_by_signals() -> Iterator[Stopping]:
    """Provide an object that says whether SIGINT, SIGTERM or SIGHUP came; these then have no other effect."""
    stopping = Stopping()
    before = {number: signal.signal(number, stopping.note) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_on_signals(command: str) -> None:
    """End on SIGINT, SIGTERM and SIGHUP with a sentence; child processes end with their parent."""

    def end(_number: int, _frame: object) -> None:
        leave_terminal(f"\n{command}: stopped; the same command goes on from here.\n")
        os._exit(EXIT_INTERRUPTED)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)
