"""One bar shows on a terminal how far a command is; it leaves the terminal, and what is printed, as they were."""

import os
import pty
import re
import subprocess
import sys

import pytest

from cmr.cli import news, progress
from cmr.cli.progress import BYTES, Progress
from tests.support.terminals import plain, read_all

BAR_AND_RESULT = """
import sys, time
from cmr.cli.progress import Progress
with Progress(4, "runs") as progress:
    progress.advance(3, "third")
    progress.say("a line that stays")
    time.sleep(0.3)
    print("result")
"""
ENDED_BY_A_SIGNAL = """
import os, signal, threading, time
from cmr.cli.progress import Progress
from cmr.cli.start import _end
signal.signal(signal.SIGTERM, _end)
with Progress(4, "runs") as progress:
    live = progress._rich.live
    drawing = threading.Thread(target=lambda: [live.refresh() for _ in iter(int, 1)], daemon=True)
    drawing.start()
    time.sleep(0.3)
    os.kill(os.getpid(), signal.SIGTERM)
"""


def on_a_terminal(script: str) -> tuple[str, str, int]:
    """Run a script with a terminal as stderr; return what it shows there and prints, and its exit code."""
    terminal, errors = pty.openpty()
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=errors, text=True)
    os.close(errors)
    shown = read_all(terminal)
    return shown, process.communicate()[0], process.returncode


def test_a_bar_is_gone_in_the_end_and_results_go_where_they_always_go() -> None:
    shown, printed, _ = on_a_terminal(BAR_AND_RESULT)
    assert printed == "result\n"
    assert "3/4 runs" in plain(shown)
    assert shown.index("a line that stays") < shown.rindex("3/4")
    assert shown.endswith("\x1b[2K")


def test_a_process_that_a_signal_ends_leaves_no_bar_and_shows_the_cursor_again() -> None:
    shown, _, code = on_a_terminal(ENDED_BY_A_SIGNAL)
    assert code == 130
    assert "\x1b[?25l" in shown
    assert shown.endswith("\r\x1b[2K\x1b[?25h")


def test_without_a_terminal_a_long_work_writes_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "BETWEEN_LINES", 0.0)
    with Progress(4, "runs", lines=True) as patient, Progress(2_000_000, BYTES) as silent:
        patient.advance(1, "fast")
        silent.advance(1_000_000)
    assert re.fullmatch(r"1 of 4 runs, about \d+ s left: fast\n", capsys.readouterr().err)


def test_after_quiet_there_are_warnings_alone(capsys: pytest.CaptureFixture[str]) -> None:
    news.be_quiet()
    try:
        with Progress(4, "runs", lines=True) as shown:
            shown.say("news")
            shown.warn("no workers")
    finally:
        news.be_quiet(False)
    assert capsys.readouterr().err == "no workers\n"
