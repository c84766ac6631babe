"""Promises 6, 8, 9 and 18: whatever happens, the motors stop; and nothing but a fresh, sane command moves them."""

import math
import random
import signal
import time
from itertools import count, pairwise
from pathlib import Path

import pytest

from cmr.bus.messages import make, now_utime
from cmr.bus.process import EXIT_INTERRUPTED
from cmr.bus.streams import MOTOR_COMMAND
from cmr.msg import motor_command_t
from robot_driver.driver import Driver
from robot_driver.emulator.device import Transmission
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.settings import load_settings
from robot_driver.gate.wire_roboclaw import ACKNOWLEDGED
from robot_driver.settings import Settings
from tests.robot_driver.golden_vectors import ROBOCLAW_STOP
from tests.support.driver_bench import DriverProcess, Robot, bench, driving, number, wait_for

pytestmark = pytest.mark.real_time

WATCHDOG = 0.5  # s, of the device
CYCLE = 0.01  # s
ESTOP_EVERY = 5  # commands, at 50 Hz: ESTOP is repeated at 10 Hz
HELD_UP = 0.15  # s; this machine's, not the promise's


def test_6_the_motors_stop_when_the_driver_is_killed(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.process.kill()
        driver.process.wait()
        last = robot.drives[-1]
        wait_for(lambda: robot.device.duty == [0, 0])
        assert last[1:] == (16384, 16384)
        assert robot.drives[-1][0] - last[0] < WATCHDOG + HELD_UP


def test_6_the_motors_stop_when_the_driver_is_stopped_and_what_waited_moves_nothing(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.process.send_signal(signal.SIGSTOP)
        driver.command_until(lambda: robot.device.duty == [0, 0])
        count = len(robot.drives)
        driver.process.send_signal(signal.SIGCONT)
        wait_for(lambda: len(robot.drives) > count + 20)
        assert {drive[1:] for drive in robot.drives[count:]} == {(0, 0)}
        driver.command_until(lambda: robot.device.duty == [16384, 16384])


def test_8_a_stale_command_becomes_zero_in_time_and_nothing_jumps_when_commands_return(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.command(0.5, 0.5)
        commanded = time.monotonic()
        wait_for(lambda: robot.device.duty == [0, 0])
        moving = [drive[0] for drive in robot.drives if drive[1]]
        assert moving[-1] - commanded < WATCHDOG + CYCLE + HELD_UP
        count = len(robot.drives)
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        returning = [drive[1] for drive in robot.drives[count:]]
        steps = [after - before for before, after in pairwise(returning)]
        assert 0 < max(steps) <= 0.2 * 32767 + 1  # two cycles of the ramp, where one was missed


def answers_to_zero(device: RoboclawDevice, monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Have the device's answer to the next zero be lost; return a list that takes its answers to each."""
    answers: list[bytes] = []
    receive = device.receive

    def noted(data: bytes, time: float) -> list[Transmission]:
        sent = receive(data, time)
        if data == ROBOCLAW_STOP:
            answers.append(b"".join(one.data for one in sent))
        return [] if data == ROBOCLAW_STOP and len(answers) == 1 else sent

    monkeypatch.setattr(device, "receive", noted)
    return answers


@pytest.mark.parametrize("number_of_signal", [signal.SIGTERM, signal.SIGINT])
def test_9_a_signal_at_any_moment_of_a_drive_leaves_the_motors_at_zero_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number_of_signal: int
) -> None:
    chance = random.Random(number_of_signal)
    for _ in range(number("CMR_SIGNALS", 1)):
        robot, driver = Robot(tmp_path), DriverProcess(tmp_path)
        drive_for(robot, driver, chance.uniform(0.0, 0.1))
        answers = answers_to_zero(robot.device, monkeypatch)
        assert robot.drives[-1][1] > 0
        code, _ = driver.end(number_of_signal)
        robot.unplug()
        assert code == EXIT_INTERRUPTED
        assert robot.drives[-1][1:] == (0, 0)
        assert len(answers) > 1
        assert answers[-1] == ACKNOWLEDGED


def drive_for(robot: Robot, driver: DriverProcess, seconds: float) -> None:
    """Command half duty until the motors turn and for so long after that: on the ramp, or when it is over."""
    driver.command_until(lambda: robot.device.duty[0] > 0)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        driver.command(0.5, 0.5)
        driver.listen(0.005)


def test_9_a_signal_while_the_driver_starts_moves_nothing(tmp_path: Path) -> None:
    robot, driver = Robot(tmp_path), DriverProcess(tmp_path)
    wait_for(lambda: robot.drives)  # the first zero: it is connecting
    code, _ = driver.end()
    robot.unplug()
    assert code == EXIT_INTERRUPTED
    assert {drive[1:] for drive in robot.drives} == {(0, 0)}


def test_9_an_exception_leaves_the_motors_at_zero_acknowledged(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    driver = Driver(Settings(port=str(tmp_path / "motor")))

    def fail_while_driving() -> None:
        with driver:
            wait_for(lambda: robot.drives)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_while_driving()
    robot.unplug()
    assert robot.drives[-1][1:] == (0, 0)


def test_18_a_released_emergency_stop_moves_nothing_until_zero_was_commanded(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.estop(True)
        driver.command_until(lambda: robot.device.duty == [0, 0])
        driver.command(0.0, 0.0)  # in advance, which does not count
        driver.estop(False)
        assert_nothing_moves(robot, driver)
        driver.command(0.0, 0.0)
        driver.command_until(lambda: robot.device.duty == [16384, 16384])
        driver.command_until(lambda: any("not_zero" in status.message for status in driver.statuses))


def test_18_an_emergency_stop_during_which_nobody_commands_is_followed_by_zero_first_too(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.estop(True)
        wait_for(lambda: robot.device.duty == [0, 0])
        driver.listen(0.1)
        driver.estop(False)
        assert_nothing_moves(robot, driver)
        driver.command(0.0, 0.0)
        driver.command_until(lambda: robot.device.duty == [16384, 16384])


def test_18_a_release_that_is_too_old_does_not_release(tmp_path: Path) -> None:
    with driving(tmp_path) as (robot, driver):
        driver.estop(True, age=5.0)
        driver.command_until(lambda: robot.device.duty == [0, 0])
        driver.estop(False, age=2.0)
        driver.command(0.0, 0.0)
        assert_nothing_moves(robot, driver)
        driver.command_until(
            lambda: any("Releases of ESTOP not taken: 1" in status.message for status in driver.statuses)
        )


def test_18_a_driver_that_starts_while_an_emergency_stop_is_engaged_moves_nothing(tmp_path: Path) -> None:
    robot, driver = Robot(tmp_path), DriverProcess(tmp_path)
    driver.in_service = True  # so that all that is commanded here is sent
    turn = count()

    def taken_at_last() -> bool:
        driver.command(0.0, 0.0)
        if next(turn) % ESTOP_EVERY == 0:
            driver.estop(True)
        return any("starting" in status.message for status in driver.statuses)

    driver.command_until(taken_at_last)
    driver.end()
    robot.unplug()
    assert {drive[1:] for drive in robot.drives} == {(0, 0)}


def assert_nothing_moves(robot: Robot, driver: DriverProcess) -> None:
    """However much is commanded."""
    count = len(robot.drives)
    driver.command_until(lambda: len(robot.drives) > count + 30)
    assert {drive[1:] for drive in robot.drives[count:]} == {(0, 0)}


def test_13_a_controller_that_was_reset_during_a_silence_is_not_driven_on(tmp_path: Path) -> None:
    settings = load_settings().ideal()
    duties: list[float] = []
    with bench(tmp_path) as run:
        run.until_moving()
        run.line.faults.silent = True
        run.line.device = RoboclawDevice(settings, Plant(settings), lambda left, _right: duties.append(left))
        time.sleep(0.2)
        told_in_silence = len(duties)
        run.line.faults.silent = False
        run.until(lambda: duties[told_in_silence:] and duties[-1] > 0.1)
    assert duties[told_in_silence] == 0.0


def test_commands_that_are_insane_old_or_for_another_robot_move_nothing_and_are_counted_on_the_bus(
    tmp_path: Path,
) -> None:
    robot, driver = Robot(tmp_path), DriverProcess(tmp_path)
    hour = 3_600_000_000  # us
    bad = {
        "not_finite": (0, 0, math.nan),
        "out_of_range": (0, 0, 1.5),
        "old": (-hour, 0, 0.5),
        "future": (hour, 0, 0.5),
        "MOTOR_COMMAND_0 wrong_robot": (0, 7, 0.5),
    }

    def all_are_counted() -> bool:
        for shift, robot_id, duty in bad.values():
            command = make(motor_command_t, utime=now_utime() + shift, robot_id=robot_id, left=duty, right=duty)
            driver.bus.publish(MOTOR_COMMAND, command, 0)
        driver.listen(0.05)
        return bool(driver.statuses) and all(reason in driver.statuses[-1].message for reason in bad)

    wait_for(all_are_counted)
    driver.end()
    robot.unplug()
    assert {drive[1:] for drive in robot.drives} == {(0, 0)}
