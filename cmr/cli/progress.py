"""Progress of work, on the terminal or in a notebook; the only module that draws it."""

import os
import sys
import time
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING

from cmr.cli.news import is_quiet
from cmr.plain_text import LINES, plain

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as RichProgress

BYTES = "bytes"  # a unit shown in kB, MB or GB
AMOUNT = "{task.completed:.0f}/{task.total:.0f} {task.fields[unit]}"
BAR = 24  # characters
BETWEEN_LINES = 10.0  # s, without a terminal
LINE_CLEARED, CURSOR_SHOWN = b"\r\x1b[2K", b"\x1b[?25h"

_bars = 0  # number of bars shown by this process


class Progress:
    """A bar on stderr that disappears when the work is done; a context manager.

    `total` is the number of `unit`; None: unknown, and only the text is shown. If stderr is neither a terminal nor a
    notebook's, nothing is shown, or with `lines` a line every 10 s. After --quiet, nothing is shown.
    """

    def __init__(self, total: float | None = None, unit: str = "", lines: bool = False) -> None:
        self._total, self._unit = total, unit
        self._done, self._text = 0.0, ""
        self.visible = not is_quiet() and (sys.stderr.isatty() or "ipykernel" in sys.modules)
        self._has_lines = lines and not self.visible and not is_quiet()
        self._began = self._last_line = time.monotonic()
        self._rich: RichProgress | None = None

    def __enter__(self) -> "Progress":
        global _bars
        if self.visible:
            self._rich = _bar(self._total is not None, self._unit)
            self._rich.add_task("", total=self._total, unit=self._unit)
            self._rich.start()
            _bars += 1
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        global _bars
        if self._rich is not None:
            self._rich.stop()
            self._rich = None
            _bars -= 1

    def show(self, text: str | None = None, done: float | None = None) -> None:
        """Show the current activity and the amount done, if given."""
        if done is not None:
            self._done = done
        if text is not None:
            self._text = plain(text)
        if self._rich is not None:
            self._rich.update(self._rich.task_ids[0], description=self._text, completed=self._done)
        elif self._has_lines and time.monotonic() - self._last_line >= BETWEEN_LINES:
            self._last_line = time.monotonic()
            print(self._line(), file=sys.stderr, flush=True)

    def advance(self, more: float = 1.0, text: str | None = None) -> None:
        """Advance the amount done."""
        self.show(text, self._done + more)

    def say(self, text: str) -> None:
        """Print a permanent line on stderr, above the bar if there is one; not after --quiet."""
        if not is_quiet():
            self._write(text)

    def warn(self, text: str) -> None:
        """Print a permanent line on stderr, amber on a terminal; also after --quiet."""
        self._write(text, style="yellow")

    def _write(self, text: str, style: str | None = None) -> None:
        text = plain(text, kept=LINES)
        if self._rich is not None or (style and sys.stderr.isatty()):
            console = self._rich.console if self._rich is not None else _console()
            console.print(text, highlight=False, markup=False, soft_wrap=True, style=style)
        else:
            print(text, file=sys.stderr, flush=True)

    def _line(self) -> str:
        """Return the bar's contents in words."""
        if self._total is None:
            return self._text
        left = (time.monotonic() - self._began) / max(self._done, 1e-9) * (self._total - self._done)
        rest = f", about {left:.0f} s left" if self._done else ""
        done, total = round(self._done, 1), round(self._total, 1)
        return f"{done:g} of {total:g} {self._unit}{rest}{': ' if self._text else ''}{self._text}"


def leave_terminal(last_words: str = "") -> None:
    """Remove a bar, show the cursor again and print last words; for signal handlers that end the process at once.

    If there is a bar, nothing can be printed after it: its drawing thread would draw it once more.
    """
    with suppress(OSError):  # a closed terminal must not block the end
        terminal = os.dup(2)
        if _bars and os.isatty(terminal):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            os.write(terminal, LINE_CLEARED + CURSOR_SHOWN)
        os.write(terminal, last_words.encode())


def _console() -> "Console":
    from rich.console import Console  # importing it takes as long as the rest of a start

    return Console(stderr=True)


def _bar(counted: bool, unit: str) -> "RichProgress":
    from rich import progress as parts
    from rich.table import Column

    text = parts.TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, ratio=1))
    columns: list[parts.ProgressColumn] = [parts.SpinnerColumn()]
    if counted:
        amount = parts.DownloadColumn() if unit == BYTES else parts.TextColumn(AMOUNT)
        columns += [parts.BarColumn(BAR), amount, parts.TimeRemainingColumn()]
    # Other output appears above the bar; results for a file or pipe still go there.
    return parts.Progress(
        *columns, text, console=_console(), transient=True, expand=True, redirect_stdout=sys.stdout.isatty()
    )
