"""A guide takes only answers that a step offers, assumes none, and ends a motion at any key."""

import os
import pty
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import StringIO

import pytest

from robot_driver.guided import Guide, Kind, Left, NotInTheScript, Scripted, Step, Terminal, no_or_yes

YES_OR_NO = no_or_yes("It turned.", "It did not.")
AT_MOST = 100  # looks, after which a step is held to wait for ever


class NobodyError(Exception):
    """It was waited for long enough."""


def impatient() -> Guide:
    """A guide whose person never answers."""
    looks = iter(range(AT_MOST))

    def wait(_seconds: float) -> None:
        if next(looks, None) is None:
            raise NobodyError

    return Guide(Scripted({"turned": lambda _step: None}), wait)


@contextmanager
def terminal() -> Iterator[tuple[int, Terminal, StringIO]]:
    """A terminal, with the end at which a person types."""
    hand, source = pty.openpty()
    output = StringIO()
    try:
        with Terminal(source, output) as front:
            yield hand, front, output
    finally:
        os.close(hand)
        os.close(source)


def typing(hand: int, *lines: str) -> Callable[[float], None]:
    """What waits, and types a line each time."""
    left = iter(lines)

    def wait(_seconds: float) -> None:
        os.write(hand, next(left, "").encode())
        time.sleep(0.01)

    return wait


def test_no_answer_is_ever_assumed() -> None:
    with pytest.raises(NobodyError):
        impatient().ask("turned", "Did it turn?", YES_OR_NO)
    with pytest.raises(NotInTheScript):
        Guide(Scripted({}), lambda _seconds: None).ask("turned", "Did it turn?", YES_OR_NO)


def test_only_answers_that_are_offered_are_taken() -> None:
    with terminal() as (hand, front, output):
        guide = Guide(front, typing(hand, "maybe\n", "\n", "ye\x7f\x7fno\n"))
        assert guide.ask("turned", "Did it turn?", YES_OR_NO) == "no"
        assert output.getvalue().count("Please answer yes or no.") == 2
        guide = Guide(front, typing(hand, "x\n", "0\n", "3.5\n"))
        assert guide.number("radius", "How large is a wheel?", "mm", 1.0, 1000.0) == 3.5
        assert output.getvalue().count("Please give a number from 1 to 1000, in mm.") == 2


def test_what_was_typed_before_a_question_does_not_answer_it() -> None:
    with terminal() as (hand, front, _output):
        os.write(hand, b"yes\n")
        guide = Guide(front, typing(hand, "no\n"))
        assert guide.ask("turned", "Did it turn?", YES_OR_NO) == "no"


def test_any_key_ends_a_motion_and_answers_nothing_after_it() -> None:
    with terminal() as (hand, front, output):
        guide = Guide(front, lambda _seconds: None)
        with guide.motion("left", "The left motor turns for 1 s.", 1.0) as motion:
            assert not motion.ended(0.1)
            os.write(hand, b" ")
            time.sleep(0.05)
            assert motion.ended(0.2)
            assert motion.ended(0.3), "it stays ended"
        assert motion.by_person
        assert front.answer() is None
        assert "ended by you" in output.getvalue()


def test_a_motion_without_a_key_takes_its_time() -> None:
    script = Scripted({})
    with Guide(script, lambda _seconds: None).motion("left", "It turns.", 1.0) as motion:
        assert [motion.ended(0.5), motion.ended(0.99), motion.ended(1.0)] == [False, False, True]
    assert not motion.by_person
    assert script.answers == [("left", "done")]


def test_a_terminal_that_hangs_up_ends_everything() -> None:
    hand, source = pty.openpty()
    with Terminal(source, StringIO()) as front:
        front.show(Step("turned", Kind.QUESTION, "Did it turn?", YES_OR_NO))
        os.close(hand)
        with pytest.raises(Left):
            front.answer()
    os.close(source)


def test_lines_of_a_pipe_answer_questions_but_end_no_motion() -> None:
    reader, writer = os.pipe()
    os.write(writer, b"yes\nno\n")
    with Terminal(reader, StringIO()) as front:
        guide = Guide(front, lambda _seconds: None)
        with guide.motion("left", "It turns.", 1.0) as motion:
            assert not motion.ended(0.5)
        assert guide.ask("first", "?", YES_OR_NO) == "yes"
        assert guide.ask("second", "?", YES_OR_NO) == "no"
        os.close(writer)
        with pytest.raises(Left), guide.motion("right", "It turns.", 1.0) as motion:
            motion.ended(0.5)
    os.close(reader)


def test_ctrl_c_leaves_the_terminal_as_it_was() -> None:
    hand, source = pty.openpty()
    before = termios.tcgetattr(source)
    # Where tests run in the background of a script, processes start with Ctrl-C ignored.
    program = (
        "import signal, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from robot_driver.guided import *\nwith Terminal() as front:\n"
        "    Guide(front, time.sleep).ask('turned', 'Did it turn?', no_or_yes('a', 'b'))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=source, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout is not None
    assert "turn?" in process.stdout.readline().decode() + process.stdout.readline().decode()
    while termios.tcgetattr(source)[3] == before[3]:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    process.communicate()
    assert termios.tcgetattr(source) == before
    os.close(hand)
    os.close(source)
