"""Steps in a terminal, as plain text. A question is answered by a line, a motion ended by any key."""

import os
import select
import sys
import termios
import textwrap
import tty
from contextlib import suppress
from types import TracebackType
from typing import TextIO

from robot_driver.guided.guide import Left
from robot_driver.guided.steps import Kind, Step

MOST = 4096  # bytes read at once
WIDTH = 100  # columns of text, where the terminal has as many
BAR = 20  # characters
ERASE = "\r\x1b[K"
BACKSPACE = ("\x7f", "\b")
GONE = "The terminal is closed: nobody can answer or stop a motion any more."


class Terminal:
    """A front in a terminal, as a context manager that restores the terminal, also after Ctrl-C.

    If the input is not a terminal, lines are read from it, and progress is not shown.
    """

    def __init__(self, source: int | None = None, output: TextIO | None = None) -> None:
        self._source = sys.stdin.fileno() if source is None else source
        self._output = sys.stdout if output is None else output
        self._is_terminal = os.isatty(self._source)
        self._settings: list[int | list[bytes | int]] | None = None
        self._step: Step | None = None
        self._waiting = ""  # characters received, but not processed yet
        self._typed = ""  # of the current line
        self._bar = ""

    def __enter__(self) -> "Terminal":
        if self._is_terminal:
            self._settings = termios.tcgetattr(self._source)
            tty.setcbreak(self._source, termios.TCSADRAIN)  # Ctrl-C still interrupts
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._end_line()
        if self._settings is not None:
            with suppress(termios.error):  # the terminal may be closed
                termios.tcsetattr(self._source, termios.TCSADRAIN, self._settings)

    def show(self, step: Step) -> None:
        """Write a step, and discard earlier input, which was meant for another one."""
        self._end_line()
        self._step = step
        self._forget_typed_ahead()
        self._write(f"\n{_wrapped(step.text)}\n")
        width = max((len(choice.key) for choice in step.choices), default=0)
        for choice in step.choices:
            self._write(f"  {choice.key:{width}}  {choice.text}\n")
        self._prompt()

    def progress(self, fraction: float, text: str) -> None:
        """Write a bar in place of the one before."""
        done = round(fraction * BAR)
        bar = f"[{'#' * done}{'.' * (BAR - done)}] {text}"
        if self._is_terminal and bar != self._bar:
            self._bar = bar
            self._write(f"{ERASE}{bar}")

    def answer(self) -> str | None:
        """Return the input: a line, or for a motion any key. Raises Left if the terminal is closed."""
        if self._step is None or self._step.kind is Kind.NOTE:
            return None
        pressed = self._pressed()
        if self._step.kind is Kind.MOTION:
            return pressed or None
        self._waiting += pressed
        while self._waiting:
            character, self._waiting = self._waiting[0], self._waiting[1:]
            if (line := self._line_with(character)) is not None:
                return line
        return None

    def refuse(self, problem: str) -> None:
        """Write why the answer was refused, and ask again."""
        self._write(f"{problem}\n")
        self._prompt()

    def dismiss(self, answer: str) -> None:
        """Close the step; write how a motion ended (an answer is on the screen already)."""
        if self._step is not None and self._step.kind is Kind.MOTION:
            self._write(f"{ERASE if self._is_terminal else ''}{answer}\n")
            self._bar = ""
        self._step = None

    def _pressed(self) -> str:
        """Return the characters received, without blocking."""
        try:
            if not select.select([self._source], [], [], 0.0)[0]:
                return ""
            data = os.read(self._source, MOST)
        except OSError as error:
            raise Left(GONE) from error
        if not data or b"\x04" in data:  # Ctrl-D
            raise Left(GONE)
        return data.decode("utf-8", "ignore")

    def _line_with(self, character: str) -> str | None:
        """Add one character; return the line when that ends it."""
        if character in ("\n", "\r"):
            line, self._typed = self._typed.strip(), ""
            self._write("\n")
            return line
        if character in BACKSPACE:
            if self._typed:
                self._typed = self._typed[:-1]
                self._write("\b \b")
        elif character.isprintable() and character:
            self._typed += character
            self._write(character)
        return None

    def _prompt(self) -> None:
        if self._step is not None and self._step.kind in (Kind.QUESTION, Kind.NUMBER):
            self._write(f"{self._step.unit}> ")

    def _end_line(self) -> None:
        """Go to a new line, if this one holds a bar or input."""
        if self._bar or self._typed:
            self._write("\n")
        self._bar = ""

    def _forget_typed_ahead(self) -> None:
        """Discard earlier input; lines that do not come from a terminal are kept for the questions to come."""
        self._typed = ""
        if self._is_terminal:
            self._waiting = ""
            with suppress(termios.error):
                termios.tcflush(self._source, termios.TCIFLUSH)
        elif self._step is not None and self._step.kind is Kind.MOTION:
            self._waiting += self._pressed()

    def _write(self, text: str) -> None:
        try:
            self._output.write(text)
            self._output.flush()
        except OSError as error:
            raise Left(GONE) from error


def _wrapped(text: str) -> str:
    """Return text in lines that fit; its own line breaks stay, and paths and options are not broken."""
    width = WIDTH
    with suppress(OSError, ValueError):
        width = min(os.get_terminal_size().columns, WIDTH)
    lines = (textwrap.fill(line, width, break_long_words=False, break_on_hyphens=False) for line in text.split("\n"))
    return "\n".join(lines)
