"""Promise 16: an empty battery is told first and stops the robot later, but a moment's dip does neither."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.msg import motor_feedback_t
from robot_driver import battery
from robot_driver.battery import DELAY, BatteryGuard, Thresholds
from tests.driver_bench import bench, wait_for

WARN_AND_STOP = Thresholds(11.0, 10.0)


def guard_after(*steps: tuple[float, float]) -> BatteryGuard:
    """Return a guard that has seen voltages for so many seconds each, ten times a second."""
    guard, tenths = BatteryGuard(WARN_AND_STOP), 0
    for voltage, seconds in steps:
        for _ in range(round(10 * seconds)):
            guard.take(voltage, tenths / 10)
            tenths += 1
    return guard


def test_16_a_step_down_warns_and_then_stops() -> None:
    assert guard_after((12.0, 5.0)).sentence == ""
    low = guard_after((12.0, 5.0), (10.5, DELAY + 0.2))
    assert (low.low, low.empty) == (True, False)
    assert "low: 10.5 V" in low.sentence
    assert guard_after((12.0, 5.0), (9.9, DELAY + 0.2)).empty


def test_16_a_stop_is_latched_and_a_warning_ends_only_well_above_its_threshold() -> None:
    assert guard_after((9.9, DELAY + 0.2), (12.0, 100.0)).empty
    assert guard_after((10.9, DELAY + 0.2), (11.1, 100.0)).low
    assert not guard_after((10.9, DELAY + 0.2), (11.3, 0.2)).low


def test_16_an_oscillation_shorter_than_the_delay_stops_nothing() -> None:
    dips = [(9.0, DELAY - 0.5), (12.0, 0.2)] * 20
    assert guard_after(*dips).sentence == ""


@given(st.lists(st.one_of(st.just(math.nan), st.floats(10.0, 20.0)), max_size=100))
def test_16_no_voltage_above_the_threshold_ever_stops(voltages: list[float]) -> None:
    guard = BatteryGuard(WARN_AND_STOP)
    for second, voltage in enumerate(voltages):
        guard.take(voltage, float(second))
    assert not guard.empty


@pytest.mark.parametrize("thresholds", [(10.0, 11.0), (-1.0, 0.0), (math.nan, 1.0)])
def test_16_thresholds_in_the_wrong_order_are_refused(thresholds: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="the warning must come"):
        Thresholds(*thresholds)


def test_16_the_motors_stop_and_stay_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(battery, "DELAY", 0.3)
    with bench(tmp_path, thresholds=Thresholds(12.3, 12.0)) as run:
        run.until_moving()
        assert "battery" not in run.thread.problem
        run.set_battery(12.2)
        run.until(lambda: "is low" in run.thread.problem)
        assert run.device.duty != [0, 0]
        run.set_battery(11.9)
        run.until(lambda: run.device.duty == [0, 0])
        assert "Stopped: the battery" in run.thread.problem
        run.set_battery(13.0)
        seen = len(run.feedback)
        run.until(lambda: len(run.feedback) > seen + 50)
        assert run.device.duty == [0, 0]
        wait_for(lambda: run.feedback[-1].status & motor_feedback_t.STATUS_BATTERY)
