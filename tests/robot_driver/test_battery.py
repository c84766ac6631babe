"""Promise 16: an empty battery is told first and stops the robot later, but a moment's dip does neither."""

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.msg import motor_feedback_t
from robot_driver import battery
from robot_driver.battery import DELAY, BatteryGuard, Thresholds
from tests.support.driver_bench import bench, wait_for

pytestmark = pytest.mark.real_time

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
    assert guard_after((10.9, DELAY + 0.2), (11.3, 0.2)).low
    assert not guard_after((10.9, DELAY + 0.2), (11.3, DELAY + 0.3)).low


def test_16_without_a_threshold_to_stop_at_none_is_told() -> None:
    guard = BatteryGuard(Thresholds(warn=11.0))
    for second in range(5):
        guard.take(10.5, float(second))
    assert guard.sentence == "The battery is low: 10.5 V."


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(0.1, DELAY - 0.1), st.floats(0.3, 2.0)), max_size=10))
def test_16_dips_shorter_than_the_delay_between_longer_rests_stop_nothing(dips: list[tuple[float, float]]) -> None:
    steps = [step for dip, rest in dips for step in ((9.0, dip), (12.0, dip + rest))]
    assert guard_after((12.0, 1.0), *steps).sentence == ""


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.floats(1.0, DELAY - 0.1), st.floats(0.1, 0.5)), min_size=12, max_size=15),
    st.floats(10.2, 13.0),
)
def test_16_a_battery_that_is_mostly_empty_is_not_saved_by_moments_above(
    steps: list[tuple[float, float]], above: float
) -> None:
    assert guard_after(*(step for low, share in steps for step in ((9.0, low), (above, share * low)))).empty


def test_16_an_hour_below_for_all_but_one_reading_in_twenty_stops() -> None:
    assert guard_after(*[(9.0, 1.9), (12.0, 0.1)] * 1800).empty


@pytest.mark.parametrize("rate_hz", [0.5, 0.8, 1.0, 17.0])
def test_16_a_dip_stops_nothing_however_rarely_the_voltage_is_measured(rate_hz: float) -> None:
    guard = BatteryGuard(WARN_AND_STOP)
    for number in range(200):
        now = number / rate_hz
        guard.take(9.0 if now % 20.0 < DELAY - 0.1 else 12.0, now)
    assert guard.sentence == ""


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
