"""Promises 1 to 5 and 17: a bad line costs time, but never a wrong datum, the rhythm, or the process."""

import os
import re
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random

import pytest

from cmr.msg import motor_feedback_t
from cmr.priority import go_first
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.faults import DELAY, Faults
from robot_driver.gate.wire_roboclaw import DRIVE_BOTH
from robot_driver.port_thread import PortThread
from robot_driver.rhythm import Rhythm, quantile
from tests.support.driver_bench import Bench, NotedRhythm, bench, bench_apart, number, wait_for
from tests.support.exchanges import Exchanges
from tests.support.stalls import Stalls

pytestmark = pytest.mark.real_time

STALE = motor_feedback_t.STATUS_COMMAND_STALE


FULL_DUTY = 32767
# What a RoboClaw answers to 80 31: its currents, here -0.45 A and -0.76 A. A request to drive (80 22 31...) that loses
# its second byte on the way is such a request.
CURRENTS = bytes.fromhex("ffd3ffb4e158")


def assert_all_true(run: Bench) -> None:
    """Everything published was so when the device read its encoders: where the wheels were, and what drove them."""
    readings = list(run.device.readings)
    start = readings[0]
    truth = {((left - start[0]) % 2**32, (right - start[1]) % 2**32, *duties) for left, right, *duties in readings}
    for message in run.feedback:
        duties = round(message.applied_left * FULL_DUTY), round(message.applied_right * FULL_DUTY)
        assert (message.ticks_left % 2**32, message.ticks_right % 2**32, *duties) in truth
        assert message.battery_voltage == 12.4 or message.battery_voltage != message.battery_voltage
        assert message.status & ~STALE == 0


def test_1_replies_one_byte_at_a_time_lose_and_corrupt_nothing(tmp_path: Path, exchanges: Exchanges) -> None:
    with bench(tmp_path, Faults(byte_gap=number("CMR_BYTE_GAP_MS", 8) / 1e3)) as run:
        run.until_transactions(number("CMR_TRANSACTIONS_IN_PIECES", 60))
        exchanges.assert_only_stalls_failed()
        assert run.thread.problem == ""
    assert_all_true(run)


def test_1_gaps_that_are_too_long_cost_samples_but_corrupt_nothing(tmp_path: Path) -> None:
    with bench(tmp_path) as run:
        run.until_transactions(30)
        run.line.faults.byte_gap = 0.025
        run.until_transactions(30)
        assert run.motors.faults > 5
        run.line.faults.byte_gap = 0.0
        wait_for(lambda: run.thread.problem == "")  # it may have to connect again, which takes some more transactions
        run.until_transactions(30)
    assert_all_true(run)


def test_2_lost_replies_do_not_upset_the_rhythm(tmp_path: Path, stalls: Stalls) -> None:
    periods = number("CMR_PERIODS_WITH_LOSSES", 400)
    with bench_apart(tmp_path, Faults(lose_answer=0.05), rate_hz=50.0) as motors:
        rhythm = motors.rhythm = NotedRhythm()
        wait_for(lambda: len(rhythm.turns) > periods, 5.0 + periods / 25.0)
    lasted = rhythm.intervals()
    late = [interval for interval in lasted if interval.end - interval.begin > 1.5 / 50.0]
    kept = set(lasted).difference(stalls.excused(late, len(lasted)))
    within = quantile([50.0 * (end - begin) for begin, end in kept], 0.99)
    print(f"{motors.faults} losses in {periods} periods; 99 % of those not excused within {within:.2f} periods")
    assert motors.faults > 0.1 * periods
    assert within <= 1.5


def thread_of(served: PortThread) -> threading.Thread:
    """Return the thread of the operating system that serves a port of the real computer."""
    worker = served._thread
    assert isinstance(worker, threading.Thread)
    return worker


def test_2_what_serves_a_port_goes_first_where_it_may(tmp_path: Path) -> None:
    ours = os.sched_getscheduler(0)
    with ThreadPoolExecutor(1) as elsewhere:
        elsewhere.submit(go_first).result()
        best = elsewhere.submit(os.sched_getscheduler, 0).result()
    with bench(tmp_path) as run:
        assert os.sched_getscheduler(thread_of(run.thread).native_id or 0) == best
    assert best in (os.SCHED_RR, ours)
    assert os.sched_getscheduler(0) == ours


def test_2_what_may_not_go_first_serves_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbid(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", forbid)
    with bench(tmp_path) as run:
        run.until_moving()
        assert os.sched_getscheduler(thread_of(run.thread).native_id or 0) == os.sched_getscheduler(0)


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


def test_3_whatever_happens_to_a_line_nothing_untrue_is_published(tmp_path: Path) -> None:
    afflictions = (
        Faults(byte_gap=0.018),
        Faults(lose=0.2, delay_answer=0.3),
        Faults(silent=True),
        Faults(byte_gap=0.025),
        Faults(flip=0.05, drop=0.05, insert=0.05),
        Faults(latency=0.025),
        Faults(byte_gap=0.004, flip=0.1, delay_answer=0.3),
        Faults(),
    )
    random = Random(number("CMR_SEED", 1))
    with bench(tmp_path) as run:
        for _ in range(number("CMR_ROUNDS_OF_AFFLICTIONS", 1)):
            for run.line.faults in random.sample(afflictions, len(afflictions)):
                duties, end = (
                    (random.uniform(-1, 1), random.uniform(-1, 1)),
                    time.monotonic() + random.uniform(0.1, 0.9),
                )
                while time.monotonic() < end:
                    run.command(*duties)
                    time.sleep(0.02)
        assert run.motors.faults > 20
    assert_all_true(run)


def mishandle_drives(run: Bench, *fates: str) -> list[str]:
    """Have the next requests to drive "lost", "misread", or acknowledged "late"; what is returned grows empty."""
    remaining, receive = list(fates), run.line.receive

    def mishandled(data: bytes, time: float) -> list[Transmission]:
        fate = remaining.pop(0) if remaining and data[1] == DRIVE_BOTH else ""
        if fate == "misread":
            return [Transmission(time, CURRENTS)]
        answers = [] if fate == "lost" else receive(data, time)
        return [answer._replace(time=answer.time + DELAY) for answer in answers] if fate == "late" else answers

    run.line.receive = mishandled  # type: ignore[method-assign]
    return remaining


def test_3_a_late_acknowledgement_is_not_taken_for_that_of_the_next_duty(tmp_path: Path) -> None:
    with bench(tmp_path, rate_hz=200.0) as run:
        run.until_moving()
        run.command(1.0, 1.0)  # each duty on the ramp differs from the one before
        remaining = mishandle_drives(run, "late", "lost")
        wait_for(lambda: run.feedback[-1].applied_left == 1.0)
        assert not remaining
    assert_all_true(run)


def test_3_an_answer_that_begins_like_an_acknowledgement_is_none(tmp_path: Path) -> None:
    with bench(tmp_path, rate_hz=200.0) as run:
        run.until_moving()
        run.command(1.0, 1.0)
        remaining = mishandle_drives(run, "misread", "", "misread")
        wait_for(lambda: run.feedback[-1].applied_left == 1.0)
        assert not remaining
    assert_all_true(run)


def test_9_a_late_acknowledgement_is_not_taken_for_that_of_the_last_zero(tmp_path: Path) -> None:
    with bench(tmp_path) as run:
        run.until_moving()
        remaining = mishandle_drives(run, "late", "lost")
        wait_for(lambda: len(remaining) < 2)
    assert not remaining
    assert run.device.duty == [0, 0]


def test_4_a_slow_line_with_a_slow_adapter_works(tmp_path: Path, exchanges: Exchanges) -> None:
    with bench(tmp_path, Faults(latency=0.012), rate_hz=20.0, baud=38400) as run:
        run.until_transactions(60)
        exchanges.assert_only_stalls_failed()
        assert run.thread.problem == ""
    assert_all_true(run)


def test_4_an_answer_that_takes_its_time_on_the_wire_is_waited_for(tmp_path: Path, exchanges: Exchanges) -> None:
    with bench(tmp_path, rate_hz=5.0, baud=2400) as run:  # where an answer takes up to 0.1 s
        run.until_transactions(20)
        exchanges.assert_only_stalls_failed()
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


@pytest.mark.parametrize("reads_are_understood", [False, True])
def test_6_a_device_that_no_longer_understands_duties_is_left_alone_until_it_stops_by_itself(
    tmp_path: Path, reads_are_understood: bool
) -> None:
    with bench(tmp_path) as run:
        run.until_moving()
        known = dict(run.device.commands)
        if reads_are_understood:
            del run.device.commands[DRIVE_BOTH]
        else:
            run.line.faults.deaf = True
        # 0.4 s without an acknowledged duty, 0.5 s of attempts at zero, 0.5 s until the device's watchdog.
        run.until(lambda: run.device.duty == [0, 0], 3.0)
        run.line.faults.deaf = False
        run.device.commands.update(known)
        run.until_moving()
        assert run.thread.problem == ""


def test_5_what_the_wheels_do_in_a_silence_is_counted(tmp_path: Path) -> None:
    with bench(tmp_path) as run:
        run.until_transactions(60)
        run.line.faults.silent = True
        wait_for(lambda: "does not answer" in run.thread.problem)
        run.line.faults.silent = False
        run.until_transactions(60)
        assert run.thread.problem == ""
    assert_all_true(run)


def test_13_a_device_that_was_reset_in_a_silence_goes_on_from_the_total(tmp_path: Path) -> None:
    with bench(tmp_path) as run:
        run.until_transactions(60)
        run.line.faults.silent = True
        wait_for(lambda: "does not answer" in run.thread.problem)
        wait_for(lambda: run.device.board.speeds() == (0, 0))
        before = run.feedback[-1]
        run.device.board.switch_on()
        run.line.faults.silent = False
        seen = len(run.feedback)
        wait_for(lambda: len(run.feedback) > seen)
        after = run.feedback[seen]
        assert (after.ticks_left, after.ticks_right) == (before.ticks_left, before.ticks_right)
        assert (after.psi_left, after.psi_right) == (0.0, 0.0)


def test_17_rate_and_latency_are_measured(tmp_path: Path) -> None:
    with bench(tmp_path, Faults(latency=0.016), rate_hz=16.0) as run:
        rhythm, begin = run.motors.rhythm, time.monotonic()
        rhythm.round_trips.clear()
        rhythm.periods.clear()
        run.until_transactions(40)
        turns, seconds, sentence = len(rhythm.periods), time.monotonic() - begin, rhythm.sentence()
        assert 0.016 < quantile(list(rhythm.round_trips), 0.5) < 0.021
        measured = re.search(r" at ([0-9.]+) Hz", sentence)
        assert measured
        # A turn is under way at the begin and at the end.
        assert (turns - 1.0) / seconds < float(measured[1]) < (turns + 1.0) / max(seconds - 2.0 / 16.0, 0.1)
        assert sentence.count("ms") == 3


def test_17_nothing_is_told_before_anything_was_measured() -> None:
    assert Rhythm().sentence() == ""
    with pytest.raises(IndexError):
        quantile([], 0.5)
