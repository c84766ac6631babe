"""A replay sends each message at its time: at any speed, over pauses, jumps, loops and gaps, by a clock of the test."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from cmr.recordings.events import Event
from cmr_tools.replay.player import BATCH, LADDER, Player


class Clock:
    """A clock that goes on when the test says so."""

    def __init__(self) -> None:
        self.seconds = 1000.0

    def __call__(self) -> float:
        return self.seconds


class ListTape:
    """Messages at these moments [s], by turns on the channels A and B."""

    def __init__(self, moments: Sequence[float]) -> None:
        self._events = [
            (moment, Event(number, round(moment * 1e6), "AB"[number % 2], b"")) for number, moment in enumerate(moments)
        ]

    def read(self, begin: float) -> Iterator[tuple[float, Event]]:
        return (entry for entry in self._events if entry[0] >= begin)


class Replay:
    """A player on a clock of the test; `sent` has the numbers of the messages, and when they were sent [s]."""

    def __init__(self, moments: Sequence[float], **options: Any) -> None:
        self.clock = Clock()
        self.sent: list[tuple[int, float]] = []
        self.due: list[float] = []
        self.player = Player(ListTape(moments), self.clock, self._take, **options)

    def run(self, seconds: float = math.inf) -> bool:
        """Play for so long, or to the end; return whether it ended."""
        until = self.clock.seconds + seconds
        while True:
            wait = self.player.play()
            if wait is None:
                return True
            if self.clock.seconds + wait > until:
                self.clock.seconds = until
                return False
            self.clock.seconds += wait

    @property
    def moments(self) -> list[float]:
        return [moment for _, moment in self.sent]

    @property
    def numbers(self) -> list[int]:
        return [number for number, _ in self.sent]

    def _take(self, event: Event, due: float, _speed: float) -> None:
        self.sent.append((event.number, self.clock.seconds - 1000.0))
        self.due.append(due - 1000.0)


@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0, 3.0, 100.0])
def test_messages_come_at_the_recorded_times_divided_by_the_speed(speed: float) -> None:
    moments = [0.0, 0.5, 0.5, 0.75, 4.0, 60.0]
    replay = Replay(moments, speed=speed)
    assert replay.run()
    assert replay.numbers == [0, 1, 2, 3, 4, 5]
    assert replay.moments == pytest.approx([moment / speed for moment in moments], abs=1e-9)


def test_as_fast_as_possible_waits_for_nothing() -> None:
    replay = Replay([0.0, 1.0, 1e6], speed=math.inf)
    assert replay.run()
    assert replay.sent == [(0, 0.0), (1, 0.0), (2, 0.0)]
    assert replay.due == replay.moments, "what is due at once is due now"


def test_many_small_steps_do_not_add_up_to_a_drift() -> None:
    clock, due = Clock(), [0.0]
    player = Player(_Regular(30_000), clock, lambda _event, moment, _speed: due.append(moment))
    while (wait := player.play()) is not None:
        clock.seconds += wait
    assert due[-1] == pytest.approx(1000.0 + 29.999, abs=1e-7)


class _Regular:
    """Messages each millisecond."""

    def __init__(self, count: int) -> None:
        self._count = count

    def read(self, begin: float) -> Iterator[tuple[float, Event]]:
        return ((number / 1000.0, Event(number, number, "A", b"")) for number in range(int(begin * 1000), self._count))


def test_a_pause_moves_all_that_follows_by_its_length() -> None:
    replay = Replay([0.0, 1.0, 2.0, 3.0], speed=2.0)
    replay.run(0.75)
    replay.player.toggle()
    assert replay.player.paused
    replay.run(10.0)
    assert replay.numbers == [0, 1], "nothing is sent while it is paused"
    assert replay.player.position == pytest.approx(1.5)
    replay.player.toggle()
    replay.run()
    assert replay.moments == pytest.approx([0.0, 0.5, 11.0, 11.5])


def test_speed_changes_from_where_it_is_and_by_the_steps_of_the_ladder() -> None:
    replay = Replay([0.0, 10.0, 20.0])
    replay.run(5.0)
    replay.player.faster()
    assert replay.player.speed == 2.0
    replay.run(3.0)
    assert replay.moments == pytest.approx([0.0, 7.5])
    for speed in reversed(LADDER[:4]):
        replay.player.slower()
        assert replay.player.speed == speed
    replay.player.slower()
    assert replay.player.speed == LADDER[0], "there is nothing slower"
    assert replay.player.position == pytest.approx(11.0)
    replay.run()
    assert replay.moments[-1] == pytest.approx(8.0 + 9.0 / 0.1)


def test_from_as_fast_as_possible_one_comes_back_to_the_recorded_pace() -> None:
    replay = Replay([index * 0.01 for index in range(3 * BATCH)], speed=math.inf)
    replay.player.play()
    assert len(replay.sent) == BATCH
    replay.player.slower()
    assert replay.player.speed == 100.0
    replay.run()
    assert replay.moments[-1] == pytest.approx(2 * BATCH * 0.01 / 100.0)


def test_speed_can_be_changed_during_a_pause() -> None:
    replay = Replay([0.0, 10.0])
    replay.run(5.0)
    replay.player.toggle()
    replay.run(100.0)
    replay.player.faster()
    assert replay.player.position == pytest.approx(5.0)
    replay.player.toggle()
    replay.run()
    assert replay.moments == pytest.approx([0.0, 107.5])


@pytest.mark.parametrize("paused", [False, True])
def test_a_jump_goes_on_at_the_other_place_at_once(paused: bool) -> None:
    replay = Replay([float(index) for index in range(100)])
    replay.run(5.5)
    if paused:
        replay.player.toggle()
    replay.player.jump(10.0)
    assert replay.player.position == pytest.approx(15.5)
    if paused:
        replay.run(3.0)
        replay.player.toggle()
    replay.sent.clear()
    replay.run(1.0)
    assert replay.numbers == [16]
    assert replay.moments == pytest.approx([6.0 + (3.0 if paused else 0.0)])
    replay.player.jump(-10.0)
    replay.run(1.0)
    assert replay.numbers == [16, 7]


def test_no_jump_leads_before_the_beginning_and_one_beyond_the_end_ends() -> None:
    replay = Replay([float(index) for index in range(100)], begin=4.0)
    replay.run(0.5)
    replay.player.jump(-10.0)
    assert replay.player.position == 4.0
    replay.player.jump(1000.0)
    assert replay.run(0.0)
    assert replay.numbers == [4]


def test_only_the_part_between_beginning_and_end_is_played() -> None:
    replay = Replay([float(index) for index in range(100)], begin=10.5, end=13.0)
    assert replay.run()
    assert replay.numbers == [11, 12, 13]
    assert replay.moments == pytest.approx([0.5, 1.5, 2.5])


def test_a_loop_begins_again_at_once() -> None:
    replay = Replay([0.0, 1.0, 2.0], loop=True, begin=1.0)
    replay.run(2.5)
    assert replay.numbers == [1, 2, 1, 2, 1]
    assert replay.moments == pytest.approx([0.0, 1.0, 1.0, 2.0, 2.0])
    assert replay.player.rounds == 2


def test_a_loop_with_nothing_to_send_ends() -> None:
    assert Replay([], loop=True).run()
    assert Replay([0.0], loop=True, begin=5.0).run()


def test_long_silences_are_cut_and_short_ones_are_kept() -> None:
    replay = Replay([0.0, 1.0, 61.0, 62.0, 65.0], longest_gap=2.0, speed=2.0)
    assert replay.run()
    assert replay.moments == pytest.approx([0.0, 0.5, 1.5, 2.0, 3.0])


def test_a_silence_is_one_of_the_chosen_channels() -> None:
    replay = Replay([0.0, 5.0, 50.0, 55.0], longest_gap=1.0, wanted=lambda channel: channel == "A")
    assert replay.run()
    assert replay.numbers == [0, 2]
    assert replay.moments == pytest.approx([0.0, 1.0])


def test_who_was_held_up_catches_up_but_sends_no_burst_of_all_that_was_missed() -> None:
    replay = Replay([index * 0.1 for index in range(100)])
    replay.run(1.05)
    replay.clock.seconds += 0.3
    replay.run(0.1)
    assert replay.moments[-1] == pytest.approx(1.4), "what is little is made up for"
    replay.clock.seconds += 5.0
    before = len(replay.sent)
    replay.run(0.01)
    assert len(replay.sent) - before == 1, "what is much is not made up for"
    replay.run()
    assert replay.moments[-1] == pytest.approx(9.9 + 5.0, abs=0.2)


def test_keys_are_heard_while_much_is_passed_over() -> None:
    replay = Replay([0.0] * 10 * BATCH, wanted=lambda _channel: False)
    turns = 0
    while replay.player.play() is not None:
        turns += 1
    assert turns == 10
