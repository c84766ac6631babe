"""The driver reports within a second that two processes command its robot, and never that one does twice."""

import math
import tracemalloc
from itertools import pairwise
from random import Random

import pytest

from robot_driver.commanders import Commanders

pytestmark = pytest.mark.real_time

Command = tuple[int, float, float]


def sender(rate: float, seconds: float, first: int, seed: int, amplitude: float = 0.3) -> list[Command]:
    """The commands [us, duty, duty] of a steady sender whose clock and values jitter a little."""
    random = Random(seed)
    times = [first + int(1e6 * k / rate + random.uniform(0.0, 2000.0)) for k in range(int(rate * seconds))]
    return [(t, amplitude * math.sin(t * 1e-6 + seed) + random.gauss(0.0, 0.002), amplitude) for t in times]


def reported_at(commands: list[Command]) -> int | None:
    """When two senders were first reported [us]; None if they never were."""
    commanders = Commanders()
    for command in sorted(commands):
        commanders.take(*command)
        if commanders.problem(command[0]):
            return command[0]
    return None


@pytest.mark.parametrize(("rate", "phase"), [(50.0, 10_000), (50.0, 3_000), (100.0, 0), (10.0, 7_000), (20.0, 1_000)])
def test_a_second_sender_is_reported_within_a_second(rate: float, phase: int) -> None:
    begin = 2_000_000
    commands = sender(50.0, 6.0, 0, 1) + sender(rate, 3.0, begin + phase, 2)
    at = reported_at(commands)
    assert at is not None
    assert begin < at < begin + 1_000_000


def test_a_sender_of_zero_beside_one_that_drives_is_reported() -> None:
    assert reported_at(sender(50.0, 2.0, 0, 1) + sender(50.0, 2.0, 9_000, 2, amplitude=0.0)) is not None


@pytest.mark.parametrize("seed", range(5))
def test_one_sender_is_never_reported_however_it_drives(seed: int) -> None:
    random = Random(seed)
    smooth = sender(50.0, 20.0, 0, seed)
    steps = [(t, math.copysign(0.5, left), right) for t, left, right in smooth]
    noisy = [(t, left + random.gauss(0.0, 0.1), right + random.gauss(0.0, 0.1)) for t, left, right in smooth]
    for commands in (smooth, steps, noisy):
        assert all(earlier[0] <= later[0] for earlier, later in pairwise(sorted(commands)))
        assert reported_at(commands) is None


def test_the_report_ends_when_one_is_alone_again() -> None:
    commanders = Commanders()
    for command in sorted(sender(50.0, 2.0, 0, 1) + sender(50.0, 2.0, 9_000, 2)):
        commanders.take(*command)
    assert commanders.problem(2_000_000)
    assert not commanders.problem(8_000_000)


def test_one_command_stamped_an_hour_ahead_does_not_fill_the_memory() -> None:
    commanders = Commanders()
    commanders.take(3_600_000_000, 0.1, 0.1)
    for command in sender(50.0, 60.0, 0, 1):
        commanders.take(*command)
    assert len(commanders._commands) < 60


def test_commands_that_all_have_one_stamp_are_not_kept_without_end() -> None:
    commanders = Commanders()
    tracemalloc.start()
    try:
        for _ in range(50_000):
            commanders.take(1_700_000_000_000_000, 0.1, 0.1)
        assert tracemalloc.get_traced_memory()[0] < 200_000
    finally:
        tracemalloc.stop()
