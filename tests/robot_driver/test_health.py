"""Promises 16 and 18: what the controller does not tell any more is not taken for well, and holds the motors."""

import math
from pathlib import Path

import pytest

from cmr.msg import motor_feedback_t
from robot_driver import battery, readings
from robot_driver.battery import Thresholds
from robot_driver.controllers import Request, Telemetry
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.emulator.boards import roboclaw
from robot_driver.emulator.device import Transmission
from robot_driver.gate.wire_roboclaw import READ_BATTERY, READ_STATUS, READ_TEMPERATURE
from robot_driver.health import Health
from tests.support.driver_bench import Bench, bench, open_gate, wait_for

pytestmark = pytest.mark.real_time

THRESHOLDS = Thresholds(11.0, 10.0)
ESTOP, BATTERY = motor_feedback_t.STATUS_ESTOP, motor_feedback_t.STATUS_BATTERY
PRESSED = 0x00000001  # in a status of four bytes


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reading is old after 0.3 s; the motors are held after 0.6 s without it."""
    monkeypatch.setattr(readings, "OLDEST", 0.3)


def mute(run: Bench) -> set[int]:
    """Return a set of commands that the device is not to answer; empty for now."""
    muted: set[int] = set()
    receive = run.line.receive

    def received(data: bytes, time: float) -> list[Transmission]:
        return [] if data[1] in muted else receive(data, time)

    run.line.receive = received  # type: ignore[method-assign]
    return muted


def assert_still(run: Bench, count: int = 30) -> None:
    """However much zero and duty are commanded: for so many messages the motors do not turn."""
    seen = len(run.feedback)

    def commanded() -> bool:
        run.command(0.0, 0.0)
        run.command(0.2, 0.2)  # is in force until the next time
        return len(run.feedback) >= seen + count

    wait_for(commanded)
    assert {(message.applied_left, message.applied_right) for message in run.feedback[seen:]} == {(0.0, 0.0)}


def assert_drives_only_after_zero(run: Bench) -> None:
    seen = len(run.feedback)
    run.until(lambda: len(run.feedback) > seen + 20)
    assert run.device.duty == [0, 0]
    run.command(0.0, 0.0)
    run.until_moving()


def test_16_a_voltage_that_does_not_come_any_more_is_unknown_and_holds_the_motors(tmp_path: Path) -> None:
    with bench(tmp_path, thresholds=THRESHOLDS) as run:
        muted = mute(run)
        run.until_moving()
        assert run.thread.problem == ""
        muted.add(READ_BATTERY)
        run.until(lambda: math.isnan(run.feedback[-1].battery_voltage))
        run.until(lambda: "battery voltage unknown for 0 s." in run.thread.problem)
        assert run.device.duty != [0, 0]
        run.until(lambda: run.feedback[-1].status & BATTERY)
        assert_still(run)
        assert "Not driving until it does and zero is commanded." in run.thread.problem
        muted.clear()
        run.until(lambda: run.feedback[-1].battery_voltage == 12.4)
        assert_drives_only_after_zero(run)
        assert run.thread.problem == ""


def test_16_a_battery_that_sinks_while_its_voltage_is_not_told_stops_the_motors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(battery, "DELAY", 0.3)
    with bench(tmp_path, thresholds=THRESHOLDS) as run:
        muted = mute(run)
        run.until_moving()
        faults = run.motors.faults
        muted.add(READ_BATTERY)
        run.until(lambda: run.motors.faults > faults + 7)
        run.set_battery(9.0)
        muted.clear()
        run.until(lambda: "Stopped: the battery" in run.thread.problem)
        assert_still(run)


def test_16_a_reading_counts_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(battery, "DELAY", 0.2)
    with bench(tmp_path, thresholds=THRESHOLDS) as run:
        muted = mute(run)
        run.set_battery(9.0)
        run.until(lambda: run.feedback[-1].battery_voltage == 9.0)
        muted.add(READ_BATTERY)
        run.set_battery(12.4)
        run.until(lambda: math.isnan(run.feedback[-1].battery_voltage))
        muted.clear()
        run.until(lambda: run.feedback[-1].battery_voltage == 12.4)
        assert "battery" not in run.thread.problem


def test_16_a_voltage_that_was_never_told_holds_the_motors_where_it_is_needed(tmp_path: Path) -> None:
    with bench(tmp_path, thresholds=THRESHOLDS) as run:
        muted = mute(run)
        muted.add(READ_BATTERY)
        run.line.faults.silent = True
        run.until(lambda: "does not answer" in run.thread.problem)
        run.line.faults.silent = False
        run.until(lambda: "battery voltage unknown." in run.thread.problem)
        assert_still(run)
        muted.clear()
        run.until(lambda: run.thread.problem == "")
        assert_drives_only_after_zero(run)


def test_a_reading_that_nothing_depends_on_is_told_as_unknown_and_holds_nothing(tmp_path: Path) -> None:
    with bench(tmp_path) as run:
        muted = mute(run)
        run.until_moving()
        muted |= {READ_BATTERY, READ_TEMPERATURE}
        run.until(lambda: "battery voltage unknown for 1 s, temperature unknown for 1 s" in run.thread.problem)
        assert math.isnan(run.feedback[-1].temperature)
        assert run.device.duty != [0, 0]
        muted.clear()
        run.until(lambda: run.thread.problem == "")
        run.until(lambda: run.feedback[-1].temperature == 31.5)


def test_18_a_state_of_the_emergency_stop_that_does_not_come_any_more_holds_the_motors(tmp_path: Path) -> None:
    with bench(tmp_path) as run:
        muted = mute(run)
        run.until_moving()
        muted.add(READ_STATUS)
        run.until(lambda: run.feedback[-1].status & ESTOP)
        assert_still(run)
        assert "state of its emergency stop and of its faults unknown for 1 s" in run.thread.problem
        muted.clear()
        run.until(lambda: run.thread.problem == "")
        assert_drives_only_after_zero(run)


def test_18_an_emergency_stop_of_the_controller_holds_from_the_first_moment_of_a_connection(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench(tmp_path) as run:
        run.until_moving()
        run.line.faults.silent = True
        run.until(lambda: "does not answer" in run.thread.problem)
        monkeypatch.setattr(roboclaw, "HEALTHY", PRESSED)
        run.line.faults.silent = False
        assert_still(run)
        assert run.thread.problem == "The motor controller reports: its emergency stop is engaged."


def test_18_an_emergency_stop_of_the_controller_is_not_released_by_a_connection_that_tells_nothing_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench(tmp_path) as run:
        run.until_moving()
        monkeypatch.setattr(roboclaw, "HEALTHY", PRESSED)
        run.until(lambda: run.feedback[-1].status & ESTOP)
        run.line.faults.silent = True
        run.until(lambda: "does not answer" in run.thread.problem)
        muted, receive = mute(run), run.line.receive

        def received(data: bytes, time: float) -> list[Transmission]:
            answers = receive(data, time)
            muted.add(data[1])  # which format the status has is told, but not what it says afterwards
            return answers if data[1] == READ_STATUS else run.line.device.receive(data, time)

        run.line.receive = received  # type: ignore[method-assign]
        run.line.faults.silent = False
        run.until(lambda: "state of its emergency stop and of its faults unknown." in run.thread.problem)
        assert_still(run)


def part(name: str) -> Request[Telemetry]:
    return Request(name, b"", 0, lambda _reply: 0, lambda _reply: Telemetry())


def test_18_an_emergency_stop_of_the_controller_holds_until_it_is_told_that_it_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench(tmp_path) as run:
        muted = mute(run)
        monkeypatch.setattr(roboclaw, "HEALTHY", PRESSED)
        run.until(lambda: run.feedback[-1].status & ESTOP)
        muted.add(READ_STATUS)
        assert_still(run, 80)


def test_18_the_state_of_the_emergency_stop_is_waited_for_from_the_beginning() -> None:
    gate = open_gate()
    health = Health(gate, Thresholds(), RoboClaw.essential, "port", 0.01)
    health.begin(1)
    assert "emergency stop and of its faults unknown. Not driving" in health.act(0.0)
    assert gate.drive(0.0).status & ESTOP
    health.take(part("status"), {"status": 0}, 0.1)
    assert health.act(0.1) == ""
    assert not gate.drive(0.1).status & ESTOP


def test_18_what_is_told_in_two_parts_is_unknown_when_one_of_them_is() -> None:
    both = readings.Readings(0.01, [])
    both.begin(2)
    first, second = (part(name) for name in ("?FF", "?FM"))
    both.take(first, {"status": 1}, 0.0)
    both.take(second, {"status": 2}, 0.1)
    both.take(second, {"status": 3}, 0.5)
    assert both.recent(0.5) == {"status": 3}
    assert both.unknown(0.5) == {"status": 0.5}


def test_18_a_slow_rhythm_makes_no_reading_old() -> None:
    slow = readings.Readings(0.2, [])
    slow.begin(5)
    slow.take(part("?V"), {"battery_voltage": 12.0}, 0.0)
    assert slow.recent(6 * 0.2) == {"battery_voltage": 12.0}
