"""The whole driver on the one port of an emulated MBot board: it drives, its gyro is read, and above all it stops."""

import dataclasses
import math
import random
import signal
import struct
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import make, now_utime
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_DUTY, MOTOR_FEEDBACK
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t
from robot_driver.controllers.mbot import MBot, MBotGyro
from robot_driver.controllers.mbot.board import TIME_TELLING
from robot_driver.driver import Driver
from robot_driver.emulator.boards.mbot_topics import TIMESYNC
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.faults import Faults, FaultyLine
from robot_driver.emulator.mbot_device import MBotDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.gate.wire_mbot import START, packed
from robot_driver.main import main
from robot_driver.settings import Settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.driver_bench import DriverProcess, PunctualEngine, number, open_gate_of, wait_for
from tests.support.exchanges import Exchanges

pytestmark = pytest.mark.real_time

HALF, MIRRORED = (0.5, 0.5), (0.5, -0.5)
WATCHDOG = 1.0  # s, of the board
PATIENCE = 20.0 + 0.1 * number("CMR_TRANSACTIONS_WITH_DAMAGE", 0)  # s
PERIOD = 1.0 / 220.0  # s, of its loop
UNEVEN = 0.0001  # s; without a clock of its own for the board's turns it is up to 0.001
COUNTS = 7 + 8  # where they are in what the board says in one turn: after a header and the time
YAW_RATE = 56 + 28 + 7 + 8 + 2 * 4  # after encoders, odometry, a header, the time and two other rates


class Noted(MBotDevice):
    """Notes when it drove what, in its own time (s), and all counts and rates that it ever said."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.drives: list[tuple[float, tuple[float, float]]] = []
        self.counts: set[tuple[int, int]] = set()
        self.rates: set[float] = set()

    def wake(self, time: float) -> list[Transmission]:
        said = super().wake(time)
        self.drives.append((time, self.duty))
        for transmission in said:
            left, right = struct.unpack_from("<2q", transmission.data, COUNTS)
            self.counts.add((left, -right))
            self.rates.add(struct.unpack_from("<f", transmission.data, YAW_RATE)[0])
        return said

    @property
    def told_time(self) -> float:
        """When it was last told the time (s)."""
        return self._told_time


@contextmanager
def board(folder: Path, faults: Faults | None = None, **mbot: Any) -> Iterator[Noted]:
    settings = load_settings().ideal()
    settings = dataclasses.replace(settings, mbot=dataclasses.replace(settings.mbot, **mbot))
    plant = Plant(settings)
    device = Noted(settings, plant)
    line = FaultyLine(device, faults or Faults())
    with Ports(folder, ("motor",)) as ports, PunctualEngine(plant, {"motor": line}, ports.terminals) as engine:
        yield device
        engine.check()


class Client:
    """Commands a driver in this process, and takes what is measured."""

    def __init__(self, driver: Driver) -> None:
        self.driver = driver
        self.feedback: list[Any] = []
        self.gyro: list[Any] = []
        self.of = {MOTOR_FEEDBACK: self.feedback, GYRO: self.gyro, MOTOR_DUTY: []}
        open_gate_of(driver)

    def until(self, condition: Any, left: float = 0.5, right: float = 0.5) -> None:
        def commanded() -> object:
            utime = now_utime()
            command = make(motor_command_t, utime=utime, robot_id=0, left=left, right=right)
            self.driver.turn()
            self.driver.handle(utime, MOTOR_COMMAND.channel(0), command)
            for stream, _, message in self.driver.outgoing():
                self.of[stream].append(message)
            return condition()

        wait_for(commanded, PATIENCE)

    def more(self, count: int, left: float = 0.5, right: float = 0.5) -> None:
        seen = len(self.feedback)
        self.until(lambda: len(self.feedback) >= seen + count, left, right)


def settings(folder: Path) -> Settings:
    return Settings(port=str(folder / "motor"), controller="mbot")


def test_wheels_and_gyro_are_measured_through_one_port(tmp_path: Path, exchanges: Exchanges) -> None:
    with board(tmp_path) as device, Driver(settings(tmp_path)) as driver:
        client = Client(driver)
        client.until(lambda: device.duty == (0.25, -0.5), 0.25, 0.5)
        client.more(100, 0.25, 0.5)
        assert driver.problems() == ""
        exchanges.assert_only_stalls_failed()
    last = client.feedback[-1]
    assert (last.applied_left, last.applied_right, last.status) == (0.25, 0.5, 0)
    assert last.battery_voltage == pytest.approx(12.4)
    assert 0 < last.ticks_left < last.ticks_right
    assert {(message.ticks_left, message.ticks_right) for message in client.feedback} <= device.counts
    assert len(client.gyro) > 1.5 * 100
    assert client.gyro[-1].yaw_rate == pytest.approx(0.04 * (last.psi_right - last.psi_left) / 0.161, abs=0.2)
    assert all(message.valid and message.yaw_rate in device.rates for message in client.gyro)
    for messages in (client.feedback, client.gyro):
        assert all(earlier.utime < later.utime for earlier, later in pairwise(messages))


def test_measurements_keep_the_boards_pace_though_its_clock_is_set_again_and_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(MBot, "monotonic_ns", lambda _board: 20_000_000_000)
    settings = load_settings().ideal()
    device = MBotDevice(settings, Plant(settings))
    mbot, gyro, chance, told = MBot(), MBotGyro(), random.Random(0), -math.inf
    wheels: list[int] = []
    rates: list[int] = []
    for _ in range(1000):
        time = device.wake_time
        if time - told >= TIME_TELLING / 1e6:
            told, late = time, chance.uniform(0.0, 0.001)  # s
            device.receive(packed(TIMESYNC, struct.pack("<q", round(1e6 * (10.0 + time - late)))), time)
        said = b"".join(transmission.data for transmission in device.wake(time)) + START
        request = mbot.read_encoders()
        request.missing(said)
        request.parse(said)
        assert request.measured is not None
        wheels.append(request.measured())
        rates += [reading.measured for reading in gyro.feed(said) if reading.measured]
    for moments in (wheels, rates):
        steps = [(later - earlier) / 1e9 for earlier, later in pairwise(moments[100:])]
        assert len(steps) > 800
        assert max(abs(step - PERIOD) for step in steps) < UNEVEN


def test_7_it_never_drives_when_the_board_has_no_watchdog(tmp_path: Path) -> None:
    with board(tmp_path, ignores_watchdog=True) as device, Driver(settings(tmp_path)) as driver:
        client = Client(driver)
        client.more(10)
        assert "watchdog" in driver.problems()
    assert all(message.status & motor_feedback_t.STATUS_NOT_ARMED for message in client.feedback)
    assert {duty for _, duty in device.drives} == {(0.0, 0.0)}


@pytest.mark.parametrize("rate", [25.0, 220.0])
def test_a_board_that_takes_duties_for_velocities_is_refused_at_the_first_of_them(tmp_path: Path, rate: float) -> None:
    with board(tmp_path, takes_velocities=True, rate=rate) as device, Driver(settings(tmp_path)) as driver:
        client = Client(driver)
        client.until(lambda: "takes them for velocities" in driver.problems())
        count = len(device.drives)
        client.more(50)
        assert driver.problems().startswith("Not driving: the board reports duties other than those sent")
    assert max(abs(duty) for _, duties in device.drives for duty in duties) < 0.02
    assert {duty for _, duty in device.drives[count + 50 :]} == {(0.0, 0.0)}
    assert client.feedback[-1].status & motor_feedback_t.STATUS_NOT_ARMED


def test_a_slow_driver_refuses_such_a_board_as_well(tmp_path: Path) -> None:
    slow = dataclasses.replace(settings(tmp_path), rate=5.0)
    with board(tmp_path, takes_velocities=True) as device, Driver(slow) as driver:
        client = Client(driver)
        client.until(lambda: "takes them for velocities" in driver.problems())
        count = len(device.drives)
        client.more(3)
    assert {duty for _, duty in device.drives[count + 50 :]} == {(0.0, 0.0)}


def test_a_board_that_was_refused_stays_so_when_it_is_connected_anew(tmp_path: Path) -> None:
    faults = Faults()
    with board(tmp_path, faults, takes_velocities=True) as device, Driver(settings(tmp_path)) as driver:
        client = Client(driver)
        client.until(lambda: "takes them for velocities" in driver.problems() and device.duty == (0.0, 0.0))
        faults.lose = 1.0
        client.until(lambda: "controller" in driver.problems())
        faults.lose = 0.0
        count = len(device.drives)
        client.more(50)
        assert driver.problems().startswith("Not driving: the board reports duties other than those sent")
    assert {duty for _, duty in device.drives[count:]} == {(0.0, 0.0)}


def test_a_board_whose_topics_have_other_numbers_is_refused(tmp_path: Path) -> None:
    with board(tmp_path, topics_from=1000) as device, Driver(settings(tmp_path)) as driver:
        Client(driver).until(lambda: "It says only topics 1210, 1220" in driver.problems())
    assert {duty for _, duty in device.drives} == {(0.0, 0.0)}


def test_a_board_that_talks_25_times_a_second_is_waited_for(tmp_path: Path, exchanges: Exchanges) -> None:
    with board(tmp_path, rate=25.0) as device, Driver(settings(tmp_path)) as driver:
        client = Client(driver)
        client.until(lambda: device.duty == MIRRORED)
        client.more(10)
        assert driver.problems() == ""
        exchanges.assert_only_stalls_failed()


def test_damage_on_the_line_never_becomes_data(tmp_path: Path) -> None:
    faults = Faults()
    with board(tmp_path, faults) as device, Driver(settings(tmp_path)) as driver:
        client = Client(driver)
        client.more(10)
        faults.lose = faults.flip = faults.drop = faults.insert = 0.05
        client.more(number("CMR_TRANSACTIONS_WITH_DAMAGE", 200), 0.3, -0.3)
        assert driver.problems() == ""
    assert {(message.ticks_left, message.ticks_right) for message in client.feedback} <= device.counts
    assert {message.yaw_rate for message in client.gyro} <= device.rates


def test_no_tick_is_lost_when_the_line_is_dead_for_a_while(tmp_path: Path) -> None:
    faults = Faults()
    with board(tmp_path, faults) as device, Driver(settings(tmp_path)) as driver:
        client = Client(driver)
        client.until(lambda: device.duty == (0.25, -0.5), 0.25, 0.5)
        client.more(50, 0.25, 0.5)
        faults.lose = 1.0
        client.until(lambda: "controller" in driver.problems(), 0.25, 0.5)
        faults.lose = 0.0
        client.until(lambda: device.duty == (0.25, -0.5), 0.25, 0.5)
        client.more(50, 0.25, 0.5)
    assert {(message.ticks_left, message.ticks_right) for message in client.feedback} <= device.counts


@contextmanager
def driving(folder: Path) -> Iterator[tuple[Noted, DriverProcess]]:
    """A board that moves because cmr-driver obeys commands of half duty."""
    with ExitStack() as stack:
        device = stack.enter_context(board(folder))
        driver = DriverProcess(folder, "--controller", "mbot")
        stack.callback(driver.end, signal.SIGKILL)
        driver.bus.subscribe(GYRO, 0, every=True)
        driver.bus.subscribe(MOTOR_FEEDBACK, 0, every=True)
        driver.command_until(lambda: device.duty == MIRRORED, *HALF)
        yield device, driver


def test_the_process_publishes_both_and_a_signal_leaves_the_motors_at_zero(tmp_path: Path) -> None:
    with driving(tmp_path) as (device, driver):
        published = {gyro_t, motor_feedback_t}
        driver.command_until(lambda: published <= {type(message) for message in driver.heard})
        assert driver.end(signal.SIGTERM)[0] == 130
        assert device.duty == (0.0, 0.0)
        assert device.drives[-1][0] - device.told_time < WATCHDOG  # by the driver, not by the watchdog


def test_the_board_stops_the_motors_when_the_driver_is_killed(tmp_path: Path) -> None:
    with driving(tmp_path) as (device, driver):
        driver.end(signal.SIGKILL)
        wait_for(lambda: device.duty == (0.0, 0.0))
        moving = [time for time, duty in device.drives if duty != (0.0, 0.0)]
        assert moving[-1] - device.told_time < WATCHDOG + 2 * PERIOD


def test_the_board_stops_the_motors_when_the_driver_is_stopped_and_they_stay_so(tmp_path: Path) -> None:
    with driving(tmp_path) as (device, driver):
        driver.process.send_signal(signal.SIGSTOP)
        driver.command_until(lambda: device.duty == (0.0, 0.0))
        count, told = len(device.drives), device.told_time
        driver.process.send_signal(signal.SIGCONT)
        wait_for(lambda: device.told_time > told and len(device.drives) > count + 100)
        assert {duty for _, duty in device.drives[count:]} == {(0.0, 0.0)}


@pytest.mark.parametrize("wrong", [["--controller", "roboclaw"], ["--controller", "mbot", "--gyro-port", "/dev/null"]])
def test_a_gyro_on_a_board_that_has_none_is_wrong_usage(wrong: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--port", "/dev/null", "--gyro", "board", *wrong])
    assert end.value.code == 2
    assert "--gyro board" in capsys.readouterr().err
