"""A process says on the terminal, with the time of day, when it is ready, has a problem, is over it, and ends."""

import re

import pytest

from cmr import news
from cmr.bus.process import Process
from cmr.msg import process_status_t


def said(text: str) -> list[str]:
    lines = text.splitlines()
    assert all(re.match(r"cmr-x: \d\d:\d\d:\d\d ", line) for line in lines)
    return [line.split(" ", 2)[2] for line in lines]


def live(url: str) -> None:
    """Be ready, have a problem for a while, and end."""
    with Process("cmr-x", url) as process:
        for turn, _utime in enumerate(process.loop(rate_hz=500.0)):
            process.state = process_status_t.DEGRADED if 3 < turn < 6 else process_status_t.RUNNING
            process.message = "The robot is gone." if 3 < turn < 6 else ""
            process.publish_status()
            if turn == 9:
                break


def test_each_change_is_said_once_with_the_time_of_day(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    live(url)
    assert said(capsys.readouterr().err) == ["ready", "The robot is gone.", "problem over", "stopped"]


def test_quiet_processes_say_nothing(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    news.be_quiet()
    try:
        live(url)
    finally:
        news.be_quiet(False)
    assert capsys.readouterr().err == ""
