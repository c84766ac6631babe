"""Text of strangers is shown, not obeyed: by terminals, and by programs that compute tables."""

import csv
import io
import json
import sys
import time
from contextlib import redirect_stderr
from typing import Any

import lcm
import pytest

from cmr.bus.bus import Bus
from cmr.bus.messages import make
from cmr.bus.process import LONGEST_MESSAGE, Process
from cmr.bus.rejections import MOST_NAMED, OTHERS, Rejections
from cmr.bus.streams import ESTOP, PARAMETERS
from cmr.bus.texts import LONGEST_TEXT
from cmr.cli.command_line import guarded, print_json
from cmr.cli.errors import CommandError
from cmr.cli.news import say
from cmr.cli.progress import Progress
from cmr.msg import estop_t, parameters_t
from cmr.parameters.file import announcement
from cmr.plain_text import cell, plain

HOSTILE = "ready\x1b[2J\x1b]0;owned\x07\r\x9b31m\u202e\x7f"


def test_what_a_terminal_obeys_is_not_in_a_plain_text() -> None:
    assert plain(HOSTILE).isprintable()
    assert plain("äπ → 5 °C\u202f%") == "äπ → 5 °C %"
    assert plain("one\ntwo\x1b", kept="\n") == "one\ntwo?"
    assert plain("x" * 100, 10) == "x" * 10 + "..."


@pytest.mark.parametrize("begin", "=+-@\t\r\n")
def test_a_cell_is_no_formula(begin: str) -> None:
    assert cell(f"{begin}cmd|'/c calc'!A0").startswith("'")
    assert cell("robot -5") == "robot -5"


@pytest.mark.parametrize("within", ["ok\r=1+1", "\x1b[2J=1+1", "=1+1\r\n\u202e"])
def test_a_cell_stays_one_and_steers_no_terminal(within: str) -> None:
    stream = io.StringIO(newline="")
    csv.writer(stream, lineterminator="\n").writerow([cell(within), "next"])
    [[read, following]] = csv.reader(io.StringIO(stream.getvalue(), newline=""))
    assert following == "next"
    assert read.replace("\n", "").isprintable()
    assert not read.startswith("=")


def fail(_arguments: list[str]) -> int:
    raise CommandError(f"POSE_0: {HOSTILE}")


def test_news_errors_and_progress_hold_nothing_that_a_terminal_obeys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["cmr-test"])
    said = io.StringIO()
    with redirect_stderr(said):
        say("cmr-pilot", HOSTILE)
        assert guarded(fail, []) == 1
        Progress().say(f"first\n{HOSTILE}")
        Progress().warn(HOSTILE)
    lines = said.getvalue().splitlines()
    assert len(lines) == 5
    assert all(line.isprintable() for line in lines)


def test_json_on_a_terminal_says_the_same_without_them(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"said": HOSTILE, "π": 1.0}, indent=None)
    text = capsys.readouterr().out
    assert text.rstrip("\n").isprintable()
    assert json.loads(text) == {"said": HOSTILE, "π": 1.0}


def test_channels_of_strangers_are_counted_and_not_all_named() -> None:
    rejections = Rejections()
    for k in range(60_000):
        rejections.note(f"POSE_{k:x}\x1b[2J", "unknown_channel")
    rejections.note("POSE_0\x1b[2J", "unknown_channel")
    assert rejections.total() == 60_001
    assert len(rejections) == MOST_NAMED + 1
    assert rejections[OTHERS, "unknown_channel"] == 60_000 - MOST_NAMED
    assert all(channel.isprintable() for channel, _ in rejections)


def test_the_report_of_a_process_is_short_and_plain_whatever_came() -> None:
    sent: list[Any] = []
    with Process("cmr-test", "memq://") as process:
        process.publish = lambda stream, message, robot_id=None: sent.append((stream, message, robot_id))
        for k in range(60_000):
            process.bus.rejected.note(f"POSE_{k:x}{HOSTILE}", "unknown_channel")
        process.message = HOSTILE * 1000
        process.publish_status()
    assert len(sent[0][1].message) <= LONGEST_MESSAGE + 3
    assert sent[0][1].message.isprintable()
    assert len(sent[0][1].encode()) < 10_000


def test_texts_from_the_bus_are_plain_and_short_but_for_parameter_files(url: str) -> None:
    bus, sender = Bus(url), lcm.LCM(url)
    stop = make(estop_t, utime=1, engaged=True, source=HOSTILE, reason=HOSTILE * 1000)
    file = announcement(0, f"schema: 1\n# {HOSTILE}", 1)
    bus.subscribe(ESTOP)
    bus.subscribe(PARAMETERS, 0)
    sender.publish("ESTOP", stop.encode())
    sender.publish("PARAMETERS_0", file.encode())
    messages: list[Any] = []
    end = time.monotonic() + 10.0
    while len(messages) < 2 and time.monotonic() < end:
        messages += [received.message for received in bus.receive(0.1)]
    heard = {type(message): message for message in messages}
    assert (heard[estop_t].source + heard[estop_t].reason).isprintable()
    assert len(heard[estop_t].reason) <= LONGEST_TEXT + 3
    assert heard[parameters_t].yaml == file.yaml
