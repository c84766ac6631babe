"""Promises 1 to 5 and 17: a bad line costs time, but never a wrong datum, the rhythm, or the process."""

import os
import time
from itertools import pairwise
from pathlib import Path

import pytest

from cmr.msg import motor_feedback_t
from robot_driver.emulator.faults import Faults
from robot_driver.rhythm import Rhythm, quantile
from tests.driver_bench import Bench, bench, number, wait_for

STALE = motor_feedback_t.STATUS_COMMAND_STALE


def assert_all_true(run: Bench) -> None:
    """Everything published was said by the device."""
    answered = run.counts_answered()
    first = answered[0]
    truth = {tuple((now - then) % 2**32 for now, then in zip(counts, first, strict=True)) for counts in answered}
    for message in run.feedback:
        assert (message.ticks_left % 2**32, message.ticks_right % 2**32) in truth
        assert message.battery_voltage == 12.4 or message.battery_voltage != message.battery_voltage
        assert message.status & ~STALE == 0


# The promise is 1.5 periods, on a machine that does nothing else; a loop that waits for a lost reply takes five.
PERIODS = 1.5 if "CMR_TRANSACTIONS_WITH_LOSSES" in os.environ else 2.5


def test_1_replies_one_byte_at_a_time_lose_and_corrupt_nothing(tmp_path: Path) -> None:
    transactions = number("CMR_TRANSACTIONS_IN_PIECES", 30)
    with bench(tmp_path, Faults(byte_gap=number("CMR_BYTE_GAP_MS", 8) / 1e3)) as run:
        run.until_transactions(transactions)
        late = sum(after - before > 0.010 for before, after in pairwise(list(run.written)))
        print(f"{run.motors.faults} errors in {len(run.line.truth)} transactions; {late} gaps were longer than 10 ms")
        assert run.motors.faults <= late  # a busy machine may hold up the emulator
        assert run.thread.problem == ""
    assert_all_true(run)


def test_2_lost_replies_do_not_upset_the_rhythm(tmp_path: Path) -> None:
    transactions = number("CMR_TRANSACTIONS_WITH_LOSSES", 300)
    for _ in range(3):  # a machine that is busy with something else may spoil one
        with bench(tmp_path, Faults(), rate_hz=50.0) as run:
            run.line.faults.lose = 0.05
            run.motors.rhythm.periods.clear()
            run.until_transactions(transactions)
            assert run.motors.faults > 3
            assert run.thread.problem == ""
            within = quantile(list(run.motors.rhythm.periods), 0.99) * 50.0
        print(f"99 % of periods within {within:.2f} periods")
        if within <= PERIODS:
            return
    raise AssertionError(f"99 % of periods took up to {within:.2f} periods")


def test_3_after_damage_it_is_back_in_step_and_publishes_only_what_is_true(tmp_path: Path) -> None:
    with bench(tmp_path, Faults(), rate_hz=500.0) as run:
        share = 0.01 if number("CMR_TRANSACTIONS_WITH_DAMAGE", 0) else 0.05
        run.line.faults = Faults(flip=share / 3, drop=share / 3, insert=share / 3)
        run.until_transactions(number("CMR_TRANSACTIONS_WITH_DAMAGE", 1000))
        damages = run.line.damaged.total()
        assert damages > 20
        # Each damage spoils its own transaction and at most the one after.
        assert 0 < run.motors.faults <= 2 * damages
        assert run.thread.problem == ""
        run.line.faults = Faults()
        before = run.motors.faults
        run.until_transactions(50)
        assert run.motors.faults <= before + 1
    assert_all_true(run)


def test_4_a_slow_line_with_a_slow_adapter_works(tmp_path: Path) -> None:
    with bench(tmp_path, Faults(latency=0.012), rate_hz=20.0, baud=38400) as run:
        run.until_transactions(60)
        # A deadline that forgets line and adapter loses all; one answer in ten may be late on a busy machine.
        assert run.motors.faults <= 6
        assert run.thread.problem == ""
    assert_all_true(run)


def test_5_a_silent_device_is_waited_for(tmp_path: Path) -> None:
    with bench(tmp_path) as run:
        run.command(0.5, 0.5)
        run.line.faults.silent = True
        wait_for(lambda: "does not answer" in run.thread.problem)
        time.sleep(number("CMR_SECONDS_OF_SILENCE", 1))
        run.line.faults.silent = False
        seen = len(run.feedback)
        wait_for(lambda: len(run.feedback) > seen + 5)
        assert run.thread.problem == ""
        assert run.device.duty == [0, 0]


def test_17_rate_and_latency_are_measured(tmp_path: Path) -> None:
    with bench(tmp_path, Faults(latency=0.016), rate_hz=16.0) as run:
        run.motors.rhythm.round_trips.clear()
        run.until_transactions(40)
        assert 0.016 < quantile(list(run.motors.rhythm.round_trips), 0.5) < 0.021
        assert " at 1" in run.motors.rhythm.sentence()
        assert run.motors.rhythm.sentence().count("ms") == 3


def test_17_nothing_is_told_before_anything_was_measured() -> None:
    assert Rhythm().sentence() == ""
    with pytest.raises(IndexError):
        quantile([], 0.5)
