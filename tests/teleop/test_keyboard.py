"""A terminal's keys drive while they are held, as far as it can say so, and nothing that is old moves a robot."""

import pytest

from cmr.teleop.hands import END, FASTER, SILENCE, STILL, STOP, Hands
from cmr.teleop.keyboard import Keyboard
from cmr.teleop.keys import ASK, RELEASES, Decoder, Event

TURN = 0.02  # s


class Desk:
    """A keyboard whose terminal answers at once, unless it hangs, as time passes."""

    def __init__(self, reports_releases: bool) -> None:
        self.now = 100.0
        self.hangs = False
        self.typed = b"\x1b[?11u" if reports_releases else b""
        self.keyboard = Keyboard(self._read, self._write)
        self.held_up = b""  # what a terminal that hangs says when it goes on
        self.wait(0.1)

    def wait(self, seconds: float, *, repeats: str = "") -> float:
        """Let time pass; return for how long of it the robot was to move [s]."""
        moved, repeat_due = 0.0, self.now + 0.033
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += TURN
            if repeats and self.now >= repeat_due:
                repeat_due += 0.033
                self.type(repeats)
            self.keyboard.look(self.now)
            moved += TURN * (self.keyboard.hands(self.now) != STILL)
        return moved

    def type(self, text: str) -> None:
        self.typed += text.encode()

    def wake(self) -> None:
        self.hangs, self.typed, self.held_up = False, self.held_up + self.typed, b""

    def _read(self) -> bytes:
        if self.hangs:
            self.held_up, self.typed = self.held_up + self.typed, b""
        said, self.typed = self.typed, b""
        return said

    def _write(self, data: bytes) -> None:
        if data == ASK:
            self.typed += b"\x1b[0n"


def test_where_releases_are_reported_keys_held_together_drive_until_each_is_let_go() -> None:
    desk = Desk(reports_releases=True)
    desk.type("\x1b[119;1:1u\x1b[97;1:1u")
    desk.wait(0.5)
    assert desk.keyboard.hands(desk.now) == Hands(1.0, 0.5)
    desk.type("\x1b[97;1:3u")
    desk.wait(TURN)
    assert desk.keyboard.hands(desk.now) == Hands(1.0, 0.0)
    desk.type("\x1b[119;1:3u")
    assert desk.wait(TURN) == 0.0


def test_elsewhere_a_key_moves_nothing_until_it_repeats_and_not_for_long_after_the_last_time() -> None:
    desk = Desk(reports_releases=False)
    desk.type("w")
    assert desk.wait(0.5) == 0.0, "nobody knows yet whether it is held"
    assert desk.wait(1.0, repeats="w") == pytest.approx(1.0, abs=0.12)
    assert desk.wait(1.0) <= SILENCE + TURN
    desk.type("w")
    assert desk.wait(0.4) == 0.0, "to press it once more is no repeat"


def test_another_key_begins_anew() -> None:
    desk = Desk(reports_releases=False)
    desk.wait(0.5, repeats="w")
    desk.type("a")
    assert desk.wait(0.3) == 0.0


@pytest.mark.parametrize("reports_releases", [True, False])
def test_a_terminal_that_hangs_stops_the_robot_and_what_it_says_later_moves_nothing(reports_releases: bool) -> None:
    desk = Desk(reports_releases)
    desk.type("\x1b[119;1:1u" if reports_releases else "")
    desk.wait(0.5, repeats="\x1b[119;1:2u" if reports_releases else "w")
    assert desk.keyboard.hands(desk.now) != STILL
    desk.hangs = True
    assert desk.wait(1.0, repeats="" if reports_releases else "w") <= SILENCE + TURN
    assert "this terminal" in desk.keyboard.problem(desk.now)
    desk.wait(0.2)  # meanwhile the key is let go
    desk.wake()
    assert desk.wait(0.5) == 0.0
    assert desk.keyboard.problem(desk.now) == ""


def test_a_release_that_is_late_on_the_way_is_no_reason_to_go_on() -> None:
    """All that comes over a slow line is as old as the answer before it."""
    desk = Desk(reports_releases=True)
    desk.type("\x1b[119;1:1u")
    desk.wait(0.3)
    answers: list[bytes] = []
    desk.keyboard._write = answers.append  # from now on answers take half a second
    moved = 0.0
    for k in range(50):
        if k >= 25:
            desk.type("\x1b[0n")
        moved += desk.wait(TURN)
    assert moved <= SILENCE + TURN


def test_a_window_that_loses_the_focus_lets_all_keys_go_and_a_paste_drives_nothing() -> None:
    desk = Desk(reports_releases=True)
    desk.type("\x1b[119;1:1u")
    desk.wait(0.1)
    desk.type("\x1b[O")
    assert desk.wait(0.3) == 0.0
    legacy = Desk(reports_releases=False)
    legacy.type("\x1b[200~wwwwww \x1b[201~")
    assert legacy.wait(0.3) == 0.0
    assert legacy.keyboard.requests() == []


@pytest.mark.parametrize(
    ("typed", "requested"),
    [
        (" ", STOP),
        ("\x1b", STOP),
        ("\x1b[27;1:1u", STOP),
        ("\x1b[32u", STOP),
        ("\x03", END),
        ("\x1b[99;5u", END),
        ("\x1b[99;5:1u", END),
        ("+", FASTER),
    ],
)
def test_keys_for_all_else_work_in_both_kinds_of_terminals(typed: str, requested: str) -> None:
    desk = Desk(reports_releases=False)
    desk.type(typed)
    desk.wait(0.1)
    assert desk.keyboard.requests() == [requested]


def test_arrows_are_keys_in_all_their_spellings_and_parts_of_a_sequence_wait_for_the_rest() -> None:
    decoder = Decoder()
    assert list(decoder.feed(b"\x1b[A\x1bOB\x1b[1;1:3C\x1b[")) == [
        Event("typed", "up"),
        Event("typed", "down"),
        Event("release", "right"),
    ]
    assert list(decoder.feed(b"D\x1b[?11u")) == [Event("typed", "left"), Event("flags", number=RELEASES | 1)]
    assert not decoder.waits
    assert list(decoder.feed(bytes(range(128, 256)) + b"\x1b[999999999999999999u\x1b[;;;u\x1b[<<u")) is not None
