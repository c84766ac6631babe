"""A gamepad drives while its dead-man button is held, a page while it answers."""

import os
from collections.abc import Mapping
from pathlib import Path

import pytest

from cmr.teleop.gamepad import ABS_X, ABS_Y, BTN_EAST, BTN_TL, EV_ABS, EV_KEY, EV_SYN, EVENT, SYN_DROPPED, Gamepad
from cmr.teleop.hands import END, SILENCE, STILL, STOP, Hands
from cmr.teleop.pads import PadFile
from cmr.teleop.remote import Remote
from cmr.teleop.scripted import Scripted, steps


class Device:
    """The file of a device that says what a test has it say; None: unplugged."""

    name = "a test"

    def __init__(self) -> None:
        self.ranges: Mapping[int, tuple[int, int]] = {ABS_X: (0, 255), ABS_Y: (0, 255)}
        self.said: bytes | None = b""

    def read(self, _now: float) -> bytes | None:
        said, self.said = self.said, b"" if self.said is not None else None
        return said

    def say(self, *events: tuple[int, int, int]) -> None:
        self.said = (self.said or b"") + b"".join(EVENT.pack(1, 2, *event) for event in (*events, (EV_SYN, 0, 0)))


def seen(pad: Gamepad) -> Hands:
    pad.look(0.0)
    return pad.hands(0.0)


def test_the_stick_drives_only_while_the_dead_man_button_is_held() -> None:
    device = Device()
    pad = Gamepad(device)
    device.say((EV_ABS, ABS_Y, 0), (EV_ABS, ABS_X, 255))
    assert seen(pad) == STILL
    assert "dead-man" in pad.problem(0.0)
    device.say((EV_KEY, BTN_TL, 1))
    assert seen(pad) == Hands(1.0, -1.0)
    device.say((EV_ABS, ABS_Y, 128), (EV_ABS, ABS_X, 120))
    assert seen(pad) == STILL, "a stick at rest is never quite in its centre"
    device.say((EV_ABS, ABS_Y, 255))
    device.say((EV_KEY, BTN_TL, 0))
    assert seen(pad) == STILL


@pytest.mark.parametrize("what", ["unplugged", "events were lost"])
def test_after_it_was_unplugged_or_events_were_lost_the_button_must_be_pressed_anew(what: str) -> None:
    device = Device()
    pad = Gamepad(device)
    device.say((EV_ABS, ABS_Y, 0), (EV_KEY, BTN_TL, 1))
    assert seen(pad) != STILL
    if what == "unplugged":
        device.said = None
    else:
        device.say((EV_SYN, SYN_DROPPED, 0), (EV_KEY, BTN_TL, 1))
    assert seen(pad) == STILL
    device.said = b""
    device.say((EV_ABS, ABS_Y, 0))
    assert seen(pad) == STILL
    device.say((EV_KEY, BTN_TL, 1))
    assert seen(pad) == Hands(1.0, 0.0)


def test_a_button_stops_all_robots_and_events_may_come_in_pieces() -> None:
    device = Device()
    pad = Gamepad(device)
    device.say((EV_KEY, BTN_EAST, 1))
    assert device.said is not None
    whole = device.said
    for byte in whole:
        device.said = bytes([byte])
        pad.look(0.0)
    assert pad.requests() == [STOP]


def test_a_device_that_comes_back_is_opened_again(tmp_path: Path) -> None:
    path = tmp_path / "pad"
    file = PadFile(path)
    assert file.read(0.0) is None
    os.mkfifo(path)
    assert file.read(0.1) is None, "it is looked for twice a second"
    assert file.read(1.0) is None, "nobody writes"
    writer = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
    assert file.read(1.1) == b""
    os.write(writer, b"x")
    assert file.read(1.2) == b"x"
    os.close(writer)
    assert file.read(1.3) is None
    file.close()


class Line:
    """What a page says, to be read once."""

    def __init__(self) -> None:
        self.said: bytes | None = b""

    def read(self) -> bytes | None:
        said, self.said = self.said, b"" if self.said is not None else None
        return said


def test_a_page_drives_while_it_repeats_new_beats_and_old_ones_move_nothing() -> None:
    line = Line()
    page = Remote(line.read)
    beat = page.beat(10.0)
    line.said = b'{"beat": %d, "forward": 1.0, "turn": -0.5}\n' % beat
    page.look(10.05)
    assert page.hands(10.05) == Hands(1.0, -0.5)
    assert page.hands(10.0 + SILENCE + 0.001) == STILL
    line.said = b'{"beat": %d, "forward": 1.0, "turn": 0}\n' % beat
    page.look(11.0)
    assert page.hands(11.0) == STILL, "it was held up on the way"
    page.beat(11.0)
    assert "page" in page.problem(11.2)


def test_nonsense_from_a_page_moves_nothing_and_its_end_ends_the_drive() -> None:
    line = Line()
    page = Remote(line.read)
    beat = page.beat(10.0)
    for text in (b"[]", b"{", b'{"beat": 99, "forward": 1, "turn": 0}', b'{"beat": true, "forward": NaN, "turn": 1}'):
        line.said = text + b"\n"
        page.look(10.0)
        assert page.hands(10.0) == STILL
    line.said = b'{"beat": %d, "forward": 1e999, "turn": 0}\n{"request": "stop"}\n' % beat
    page.look(10.0)
    assert (page.hands(10.0), page.requests()) == (STILL, [STOP])
    line.said = None
    page.look(10.0)
    assert page.requests() == [END]


def test_a_script_does_one_thing_after_the_other_from_when_it_is_first_looked_at() -> None:
    script = Scripted(steps("ahead 2, left 1"))
    script.look(50.0)
    assert [script.hands(when) for when in (51.0, 52.5, 53.5)] == [Hands(1.0, 0.0), Hands(0.0, 1.0), STILL]
    assert not script.is_over(52.9)
    assert script.is_over(53.0)
    with pytest.raises(ValueError, match="none of ahead, back"):
        steps("jump 3")
