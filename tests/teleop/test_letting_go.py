"""Whoever lets go of a robot, in whatever way, stops it: real processes, an emulated robot, ten ways, once each.

`scripts/study_teleop` does it 500 times; how long it takes is in docs/measurements/teleop.md.
"""

import os
import termios
from functools import partial
from pathlib import Path

import pytest

from tests.support.hands import Terminal, led
from tests.support.letting_go import all_ways

pytestmark = pytest.mark.real_time
WAYS = 10


def shows(terminal: Terminal, words: bytes) -> bool:
    return words in terminal.shown


def test_in_each_way_the_robot_stops(tmp_path: Path) -> None:
    with led(tmp_path) as robot:
        trials = list(all_ways(robot, 1))
    print(*trials, sep="\n")
    assert len({trial.kind for trial in trials}) == WAYS
    late = [trial for trial in trials if trial.commanded - trial.pause > 0.2]
    assert late == [], "but for pauses of the computer"


def test_a_terminal_is_as_before_after_a_signal_and_after_a_mistake(tmp_path: Path) -> None:
    with led(tmp_path) as robot:
        for end in ("SIGTERM", "Ctrl-C"):
            terminal = Terminal(reports_releases=True)
            before = termios.tcgetattr(terminal.slave)
            again = os.dup(terminal.slave)
            process = robot.teleop(terminal)
            robot.until(partial(shows, terminal, b"ready"))
            process.terminate() if end == "SIGTERM" else terminal.type("\x1b[99;5u")
            assert process.wait(20.0) == (130 if end == "SIGTERM" else 0)
            robot.wait(0.2)
            assert termios.tcgetattr(again) == before
            assert terminal.shown.rfind(b"\x1b[?1049l") > terminal.shown.rfind(b"\x1b[?1049h")
            terminal.close()
