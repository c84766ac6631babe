"""Stamps go by a steady clock and follow the time of day, whatever happens to it."""

from itertools import pairwise

import pytest

from cmr.bus.clock_watch import SPOKEN_OF, ClockWatch
from robot_driver.clock import FURTHEST_BACK, SLOWEST, Stamps

EPOCH = 1_800_000_000_000_000  # us
PERIOD = 10_000  # us
HOUR = 3_600_000_000  # us


def stamps(*steps: tuple[float, int]) -> list[int]:
    """Return stamps every 10 ms for so many seconds each, while the clock is off by so much [us]."""
    offset, steady, result = 0, 0, []
    made = Stamps(lambda moment: EPOCH + moment // 1000 + offset)
    for seconds, offset in steps:  # noqa: B007 - the clock above reads it
        for _ in range(round(seconds * 1e6 / PERIOD)):
            steady += PERIOD
            result.append(made.next(steady * 1000))
    return result


def apart(stamps: list[int]) -> list[int]:
    return [later - earlier for earlier, later in pairwise(stamps)]


def test_an_hour_ahead_for_five_seconds_is_an_hour_ahead_for_five_seconds() -> None:
    made = stamps((5.0, 0), (5.0, HOUR), (5.0, 0))
    steps = [step for step in apart(made) if step != PERIOD]
    assert steps == [PERIOD + HOUR, PERIOD - HOUR]
    assert made[-1] == EPOCH + 15_000_000


def test_stamps_go_on_from_a_clock_that_was_set_back_by_an_hour() -> None:
    made = stamps((5.0, 0), (5.0, -HOUR))
    assert [step for step in apart(made) if step != PERIOD] == [PERIOD - HOUR]


@pytest.mark.parametrize("back", [1_000, 100_000, FURTHEST_BACK - PERIOD])
def test_a_clock_that_was_set_back_a_little_is_caught_up_with(back: int) -> None:
    made = stamps((5.0, 0), (12.0, -back))
    assert all(SLOWEST * PERIOD - 1 <= step <= PERIOD for step in apart(made))
    assert made[-1] == EPOCH + 17_000_000 - back


def test_moments_that_are_not_in_order_have_later_stamps_all_the_same() -> None:
    made = Stamps(lambda moment: EPOCH + moment // 1000)
    assert [made.next(moment * 1000) for moment in (5, 4, 7)] == [EPOCH + 5, EPOCH + 6, EPOCH + 7]


@pytest.mark.parametrize(("by", "said"), [(HOUR, "ahead by 3600.0 s"), (-HOUR, "back by 3600.0 s")])
def test_a_clock_that_was_set_is_spoken_of_for_a_minute(by: int, said: str) -> None:
    watch = ClockWatch()
    assert watch.look(EPOCH, 0) == watch.remark() == ""
    assert watch.look(EPOCH + 10_050, 10_000) == ""
    assert said in watch.look(EPOCH + by + 20_000, 20_000)
    assert watch.look(EPOCH + by + 30_000, 30_000) == ""
    assert said in watch.remark()
    watch.look(EPOCH + by + SPOKEN_OF + 20_001, SPOKEN_OF + 20_001)
    assert watch.remark() == ""


@pytest.mark.parametrize("held_up_at", range(6))
def test_a_process_that_waits_for_a_processor_takes_no_clock_for_set(
    held_up_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = HeldUp()
    monkeypatch.setattr("cmr.bus.clock_watch.time", clock)
    watch = ClockWatch()
    for look in range(4):
        utime = clock.time_ns() // 1000
        clock.reads_until_held_up = held_up_at if look == 1 else -1
        assert watch.look(utime) == ""
    clock.offset += 1_000_000_000
    assert "set ahead by 1.0 s" in watch.look(clock.time_ns() // 1000)


class HeldUp:
    """The clocks of a process that others may hold up for 1.3 s before it looks at one [ns]."""

    CLOCK_BOOTTIME = 7

    def __init__(self) -> None:
        self.now, self.offset, self.reads_until_held_up = 0, 1_800_000_000_000_000_000, -1

    def time_ns(self) -> int:
        return self.clock_gettime_ns(0) + self.offset

    def clock_gettime_ns(self, _clock: int) -> int:
        self.now += 1_300_000_000 if self.reads_until_held_up == 0 else 1_000
        self.reads_until_held_up -= 1
        return self.now
