"""The terminal as a keyboard and a screen; its earlier state is restored at the end, whatever the reason.

A terminal that hangs, or is being closed, must not delay a zero command. So it is opened a second time in non-blocking
mode, and a thread reads and writes: if the system blocks in such a call, the robot stops as for any other silence. Text
that the terminal does not accept is dropped.
"""

import os
import select
import sys
import termios
import threading
from contextlib import suppress
from io import StringIO
from types import TracebackType

from cmr.cli.errors import CommandError
from cmr.teleop.keys import ASK_FLAGS, BEGIN, END

# The alternate screen, no cursor, reports of the focus, marked pastes.
ENTER = b"\x1b[?1049h\x1b[?25l\x1b[?1004h\x1b[?2004h"
LEAVE = b"\x1b[?2004l\x1b[?1004l\x1b[?25h\x1b[?1049l"
HOME, TO_END_OF_LINE, TO_END = b"\x1b[H", b"\x1b[K", b"\x1b[J"
MOST_READ = 4096  # bytes at once
MOST_WAITING = 16_384  # bytes; above, text is dropped
PATIENCE = 0.3  # s for the thread to end
MOST_SAID = 20  # lines printed at the end
NO_TERMINAL = (
    "The keyboard needs a terminal: start cmr-teleop in one, not behind a pipe. A gamepad (--gamepad) needs none."
)


class Terminal:
    """The terminal of this process; a context manager. Text written to stderr meanwhile is shown at the end.

    `gone` tells whether it was closed. Raises CommandError if there is none.
    """

    def __init__(self) -> None:
        if not sys.stdin.isatty():
            raise CommandError(NO_TERMINAL)
        self.gone = False
        self.said = StringIO()
        self._came, self._waiting = b"", b""
        self._lock = threading.Lock()
        self._ends = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._stderr = sys.stderr
        try:
            self._file = os.open(os.ttyname(sys.stdin.fileno()), os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
        except OSError as error:
            raise CommandError(f"{NO_TERMINAL} ({error.strerror})") from error

    def __enter__(self) -> "Terminal":
        self._before = termios.tcgetattr(self._file)
        self._stderr, sys.stderr = sys.stderr, self.said
        try:
            termios.tcsetattr(self._file, termios.TCSANOW, _raw(self._before))
            self._woken, self._wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
            self.write(ENTER + BEGIN + ASK_FLAGS)
            self._thread.start()
        except BaseException:
            self._restore()
            raise
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._ends = True
        self._wake_up()
        self._thread.join(PATIENCE)
        self._restore()

    def read(self) -> bytes:
        """Return the bytes received."""
        with self._lock:
            came, self._came = self._came, b""
        return came

    def write(self, data: bytes) -> None:
        """Queue bytes for the terminal, in order."""
        with self._lock:
            if len(self._waiting) < MOST_WAITING:
                self._waiting += data
        self._wake_up()

    def _wake_up(self) -> None:
        with suppress(BlockingIOError):
            os.write(self._wake, b"x")

    def _run(self) -> None:
        while not (self._ends or self.gone):
            writes = [self._file] if self._waiting else []
            readable, writable, _ = select.select([self._file, self._woken], writes, [])
            if self._woken in readable:
                os.read(self._woken, MOST_READ)
            if self._file in readable:
                self._take()
            if writable:
                self._give()

    def _take(self) -> None:
        try:
            data = os.read(self._file, MOST_READ)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        self.gone |= not data
        with self._lock:
            self._came += data

    def _give(self) -> None:
        with self._lock:
            waiting = self._waiting
        try:
            given = os.write(self._file, waiting)
        except BlockingIOError:
            return
        except OSError:
            self.gone, given = True, len(waiting)
        with self._lock:  # more may have been added
            self._waiting = self._waiting[given:]

    def show(self, text: str) -> None:
        """Show a text on the whole screen, unless the previous one has not been written yet."""
        if not self._waiting:
            lines = text.encode(errors="replace").split(b"\n")
            self.write(HOME + b"\r\n".join(line + TO_END_OF_LINE for line in lines) + TO_END)

    def size(self) -> tuple[int, int]:
        """Return columns and lines."""
        try:
            columns, lines = os.get_terminal_size(self._file)
        except OSError:
            return 80, 24
        return columns or 80, lines or 24

    def _restore(self) -> None:
        """Restore the terminal, as far as possible if it hangs; do nothing if it is gone."""
        try:
            with suppress(BlockingIOError):
                os.write(self._file, END + LEAVE)
            termios.tcsetattr(self._file, termios.TCSANOW, self._before)
            termios.tcflush(self._file, termios.TCIFLUSH)  # its answers are not for the shell
        except (OSError, termios.error):
            self.gone = True
        os.close(self._file)
        if not self.gone:
            sys.stderr = self._stderr
            self._say()

    def _say(self) -> None:
        lines = self.said.getvalue().splitlines()[-MOST_SAID:]
        try:
            for line in lines:
                print(line, file=sys.stderr, flush=True)
        except (OSError, ValueError):
            pass


def _raw(attributes: list[int | list[bytes | int]]) -> list[int | list[bytes | int]]:
    """Return the attributes of raw mode: each key is passed on at once, unchanged, and output is never paused."""
    raw = [*attributes]
    inputs, outputs, _, local = raw[0], raw[1], raw[2], raw[3]
    assert isinstance(inputs, int)
    assert isinstance(outputs, int)
    assert isinstance(local, int)
    raw[0] = inputs & ~(termios.IXON | termios.IXOFF | termios.ICRNL | termios.INLCR | termios.IGNCR | termios.ISTRIP)
    raw[1] = outputs & ~termios.OPOST
    raw[3] = local & ~(termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN)
    return raw
