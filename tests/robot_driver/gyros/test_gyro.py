"""Promises 14 and 15: readings are stamped when they were taken, and what is no rate is never told as one."""

import math
import os
import random
import select
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cmr.priority import go_first
from robot_driver.clock import Stamps, utime_at
from robot_driver.clock_fit import ClockFit
from robot_driver.emulator.dsp3000_device import INCREMENTAL_ANGLE, Dsp3000Device
from robot_driver.emulator.faults import Faults, FaultyLine
from robot_driver.emulator.kvh_binary_device import KvhBinaryDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.gyro_device import GyroDevice
from robot_driver.gyros.dsp3000 import SETTLING, Dsp3000
from robot_driver.gyros.kvh_binary import SEQUENCE, KvhBinary
from robot_driver.port_thread import PortThread
from robot_driver.serial_port import SerialPort
from robot_driver.terminals.pseudo_terminal import Ports
from tests.robot_driver.emulator.test_emulator_kvh_binary import RATE, kvh_settings
from tests.robot_driver.gyros.test_dsp3000_protocol import scattered
from tests.support.driver_bench import PunctualEngine, number, wait_for

pytestmark = pytest.mark.real_time

LINE = b"       1.000000   1\r\n"
WIRE_TIME = len(LINE) * 10 / 38400  # s
PATIENCE = 10.0  # s


@contextmanager
def listening(path: str) -> Iterator[tuple[list[Any], PortThread]]:
    """What the driver's gyro thread publishes while it reads the port at `path`."""
    published: list[Any] = []
    port = SerialPort(path, 38400)
    with PortThread(port, GyroDevice(port, Dsp3000, robot_id=0, sign=1, publish=published.append)) as thread:
        yield published, thread


def said(master: int) -> bytes:
    """Return what the driver says next."""
    assert select.select([master], [], [], PATIENCE)[0], "the driver says nothing"
    return os.read(master, 10)


@contextmanager
def line_end() -> Iterator[tuple[int, str]]:
    """The device's end of a serial line, and the path of the driver's."""
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_14_bursts_of_five_lines_are_spread_over_the_time_in_which_they_were_measured() -> None:
    rate, begin, late = 102.0, time.monotonic() + 0.1, []

    def send(master: int) -> None:
        go_first()
        os.write(master, b"\n")
        for burst in range(number("CMR_GYRO_BURSTS", 40)):
            due = begin + (5 * burst + 4) / rate + WIRE_TIME  # when the last of its lines has come
            time.sleep(max(due - time.monotonic(), 0.0))
            late.append(time.monotonic() - due)
            os.write(master, 5 * LINE)

    with line_end() as (master, path), listening(path) as (published, _):
        sender = threading.Thread(target=send, args=(master,))
        sender.start()
        sender.join()
        wait_for(lambda: len(published) == 5 * len(late))
    true = [begin + number_of_line / rate + min(late) for number_of_line in range(len(published))]
    offset = utime_at(0)
    errors = [(message.utime - offset) / 1e6 - moment for message, moment in zip(published, true, strict=True)]
    print(f"largest error {1e3 * max(map(abs, errors[50:])):.2f} ms")
    # Lines that this computer sent late may be stamped as much too late, no others.
    held_up = [lateness - min(late) for lateness in late for _ in range(5)]
    assert all(abs(error) < 0.002 + own for error, own in list(zip(errors, held_up, strict=True))[50:])
    assert all(before.utime < after.utime for before, after in pairwise(published))


@pytest.mark.parametrize("rate", [96.0, 97.5, 100.0, 102.5, 104.0])
def test_14_the_gyros_own_rate_is_found_under_any_delay(rate: float) -> None:
    chance, fit, errors = random.Random(0), ClockFit(100.0), []
    for burst in range(1000):
        arrived = (5 * burst + 4) / rate + chance.expovariate(1 / 0.002)
        lines = [(5 * burst + i, round(1e9 * (arrived - (4 - i) * WIRE_TIME))) for i in range(5)]
        errors += [fitted / 1e9 - line / rate for fitted, (line, _) in zip(fit.times_of(lines), lines, strict=True)]
    assert max(map(abs, errors[100:])) < 0.002
    assert max(map(abs, errors[2000:])) < 0.0005
    assert fit.pace == (1.0 if rate == 100.0 else pytest.approx(rate / 100.0, rel=1e-3))


@pytest.mark.parametrize("late", [0.086, 0.3])
@pytest.mark.parametrize("busy_from", [0.01, 1.0, 4.0, 4.9, 8.0])
@pytest.mark.parametrize("busy_for", [0.1, 2.0, 10.0])
def test_14_a_computer_that_becomes_busy_does_not_change_the_pace_of_a_gyro(
    late: float, busy_from: float, busy_for: float
) -> None:
    fit, chance = ClockFit(100.0, SEQUENCE), random.Random(0)
    for taken in range(2500):
        moment = 0.01 * taken + chance.expovariate(1 / 0.0005)
        moment += late if busy_from <= 0.01 * taken <= busy_from + busy_for else 0.0
        fit.times_of([(taken, round(1e9 * moment))])
        assert fit.pace == 1.0


@pytest.mark.parametrize("told", [5, 10, 25, 50, 100, 250, 500, 750, 1000, 3600, 5000])
@pytest.mark.parametrize("pace", [0.962, 1.04])
def test_14_a_gyro_that_is_four_per_cent_off_what_it_says_is_followed(told: int, pace: float) -> None:
    true, frame = told * pace, 0.016 if told > 100 else 0.001  # s after which an adapter passes on what has come
    chance, fit, errors, count = random.Random(0), ClockFit(told, SEQUENCE), list[float](), 0
    while len(errors) < 4000:
        moment = frame * math.ceil((count + 1) / true / frame) + chance.expovariate(1 / 0.0005)
        numbers = range(count, max(math.floor(moment * true), count) + 1)
        fitted = fit.times_of([(number, round(1e9 * moment)) for number in numbers])
        errors += [time / 1e9 - number / true for time, number in zip(fitted, numbers, strict=True)]
        count = numbers[-1] + 1
    assert max(map(abs, errors[2000:])) < 0.002


def test_14_after_readings_were_lost_unnoticed_or_a_pause_the_fit_finds_back() -> None:
    fit, errors = ClockFit(100.0), []
    for taken in range(2000):
        if taken in (700, 701):
            continue
        moment = taken * 0.0099 + (3.0 if taken > 1500 else 0.0)
        (fitted,) = fit.times_of([(taken - (2 if taken > 700 else 0), round(1e9 * moment))])
        errors.append(abs(fitted / 1e9 - moment))
    assert max(errors[:700]) < 0.002
    assert max(errors[800:]) < 0.002


def test_14_readings_lost_unnoticed_bend_stamps_by_no_more_than_the_lost_and_not_for_long() -> None:
    chance, fit, errors, number = random.Random(0), ClockFit(100.0), [], 0
    for taken in range(10_000):
        if chance.random() < 0.01:
            continue
        (fitted,) = fit.times_of([(number, round(1e9 * (taken / 101.3 + chance.expovariate(1 / 0.0005))))])
        errors.append(abs(fitted / 1e9 - taken / 101.3))
        number += 1
    assert sum(error > 0.002 for error in errors[100:]) < 0.1 * len(errors)
    assert max(errors[100:]) < 0.035


@pytest.mark.parametrize("pace", [0.985, 1.0, 1.007])
def test_14_stamps_stay_true_where_one_reading_in_twenty_is_lost_behind_a_slow_adapter(pace: float) -> None:
    chance, fit, errors, number = random.Random(0), ClockFit(100.0), list[float](), 0
    waiting: list[int] = []
    for taken in range(10_000):
        if chance.random() >= 0.05:
            waiting.append(taken)
        if not waiting or int(taken / pace / 1.6) == int((taken + 1) / pace / 1.6):
            continue  # the adapter's timer of 16 ms has not ended
        arrived = 0.016 * (int(taken / pace / 1.6) + 1) + (
            chance.expovariate(1 / 0.004) if chance.random() < 0.1 else 0.0
        )
        lines = [(number + index, round(1e9 * arrived)) for index in range(len(waiting))]
        errors += [time / 1e9 - one / (100.0 * pace) for time, one in zip(fit.times_of(lines), waiting, strict=True)]
        number, waiting = number + len(waiting), []
    assert math.sqrt(math.fsum(error**2 for error in errors[200:]) / len(errors[200:])) < 0.005
    assert max(map(abs, errors[200:])) < 0.05


def test_14_damaged_lines_count_as_readings() -> None:
    gyro = Dsp3000()
    readings = gyro.feed(b"1   1\r\n" + LINE + b"       1.0x0000   1\r\n" + b"   1\r\n" + LINE + LINE)
    assert [reading.lost_before for reading in readings] == [0, 2, 0]


def test_a_gyro_that_tells_angles_and_is_faster_than_it_says_is_not_told_as_slower(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robot_driver.clock_fit.RATE_KNOWN", 1.0)
    monkeypatch.setattr("robot_driver.clock_fit.LONGEST_DRIFT", 0.03)
    settings = kvh_settings(rate=250, clock_error=0.04)
    plant = Plant(settings)
    plant.command(-0.1, 0.1)
    plant.left.velocity, plant.right.velocity = -0.1 / 0.054, 0.1 / 0.054  # it turns steadily
    device = KvhBinaryDevice(settings, plant)
    published: list[Any] = []
    port = SerialPort(str(tmp_path / "gyro"), 4_000_000)
    with (
        Ports(tmp_path, ("gyro",)) as ports,
        PunctualEngine(plant, {"gyro": device}, ports.terminals),
        PortThread(port, GyroDevice(port, KvhBinary, robot_id=0, sign=1, publish=published.append)),
    ):
        wait_for(lambda: len(published) > 500)
    assert published[-1].yaw_rate == pytest.approx(RATE, rel=0.005)
    assert published[-1].utime - published[-251].utime == pytest.approx(1e6 / 1.04, rel=0.005)


@given(st.lists(st.integers(-(10**9), 10**9), min_size=1, max_size=50))
@example([0, 0, -999_999_769])  # followed the clock back, where its reading took as long
@example([10**9, -(10**9)])
def test_14_stamps_strictly_increase(moments: list[int]) -> None:
    stamps = Stamps()
    told = [stamps.next(10**12 + moment) for moment in moments]
    assert all(before < after for before, after in pairwise(told))


def test_15_a_gyro_is_put_into_its_mode_read_and_woken_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot_driver.clock_fit.FIRST_SIGHT", 0.0)
    with line_end() as (master, path), listening(path) as (published, thread):
        assert said(master) == b"RRR"
        os.write(master, b"5 1\r\n" + scattered(SETTLING + 1) + b"       2.0000")
        time.sleep(0.01)
        os.write(master, b"00   0\r\n")
        wait_for(lambda: len(published) == SETTLING + 2)
        assert thread.problem == ""
        assert said(master) == b"RRR"
        wait_for(lambda: "sends no readings" in thread.problem)
        assert said(master) == b"RRR"
    assert [message.valid for message in published] == SETTLING * [0] + [1, 0]
    assert published[-2].yaw_rate == pytest.approx(-math.radians(1.0), abs=0.001)
    assert all(math.isnan(message.yaw_rate) for message in published if not message.valid)


@pytest.mark.parametrize("lost", [1, 2])
def test_15_a_mode_letter_that_is_lost_is_sent_again_before_any_reading_is_believed(lost: int) -> None:
    gyro, requests, line = Dsp3000(), 0, b"       0.010000   1\r\n"  # an angle
    gyro.feed(b"\n")
    for _ in range(3 * SETTLING):
        readings = gyro.feed(line)
        requests += bool(gyro.next_request())
        line = LINE if requests > lost else line
        assert not readings[0].valid or line == LINE
    assert readings[0].valid


def test_15_a_gyro_that_comes_back_in_another_mode_never_tells_an_angle_as_a_rate(tmp_path: Path) -> None:
    settings = load_settings().ideal()
    plant = Plant(settings)
    gyro = Dsp3000Device(settings, plant)
    line = FaultyLine(gyro, Faults())
    plant.command(-0.3, 0.3)
    plant.left.velocity, plant.right.velocity = -0.3 / 0.054, 0.3 / 0.054  # it turns steadily
    rate = 2 * 0.3 / 0.054 * 0.04 / 0.161
    with (
        Ports(tmp_path, ("gyro",)) as ports,
        PunctualEngine(plant, {"gyro": line}, ports.terminals),
        listening(str(tmp_path / "gyro")) as (published, thread),
    ):
        wait_for(lambda: published and published[-1].valid)
        line.faults.silent = True
        wait_for(lambda: thread.problem)
        gyro._mode, seen = INCREMENTAL_ANGLE, len(published)
        line.faults.silent = False
        wait_for(lambda: len(published) > seen + 2 * SETTLING and published[-1].valid)
    assert thread.problem == ""
    rates = [message.yaw_rate for message in published[20:] if message.valid]
    assert min(rates) == pytest.approx(rate, abs=0.1)
