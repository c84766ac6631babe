"""What the comparison of clocks promises: lags are found to a fraction of a sample, or are called unknown."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cmr.recordings.faults.checks import check
from cmr.recordings.lags import lags_of
from tests.support.emulated_drive import DEFAULT, EPOCH, figure_eight
from tests.support.faulty_drive import Duties, at_rest, circle, later, lively, recording, scattered, without

PERIOD = 0.02  # s between two poses of the emulated drives


@pytest.mark.parametrize("seconds", [-1.9, -0.2, 0.013, 0.5, 1.9])
@pytest.mark.parametrize("duties", [figure_eight, lively])
def test_the_time_by_which_poses_are_late_is_found_to_a_fraction_of_a_sample(seconds: float, duties: Duties) -> None:
    faulty, _ = scattered(later(recording(duties, 5), "poses", seconds), 7, 1.0)
    lag = next(lag for lag in lags_of(faulty) if lag.sensor == "poses")
    assert lag.known
    # The emulated ground follows the wheels by 2 ms.
    assert abs(lag.seconds - seconds - 0.002) < 4.0 * lag.std
    assert lag.std < PERIOD / 2.0
    found = check(faulty)["poses_clock"]
    assert found.found == (abs(seconds) > 0.03)
    assert ("later than the wheels" if seconds > 0.0 else "earlier than the wheels") in found.sentence
    assert ("clock is ahead" if seconds > 0.0 else "clock is behind") in found.sentence


@pytest.mark.parametrize("seconds", [-11.0, 3.7, 14.0])
def test_a_clock_that_nobody_set_is_found_far_off(seconds: float) -> None:
    lag = next(lag for lag in lags_of(later(recording(lively, 5), "poses", seconds)) if lag.sensor == "poses")
    assert lag.known
    assert abs(lag.seconds - seconds - 0.002) < 4.0 * lag.std


def test_poses_of_another_drive_have_no_lag() -> None:
    for drive, other in ((lively, figure_eight), (figure_eight, lively)):
        strange = replace(recording(drive, 5), poses=recording(other, 6).poses)
        assert not next(one for one in lags_of(strange) if one.sensor == "poses").known


@pytest.mark.parametrize("seconds", [-1.9, 0.1, 0.7])
def test_the_time_by_which_the_gyro_is_late_is_found(seconds: float) -> None:
    lag = check(later(recording(lively, 5), "gyro", seconds)).lag("gyro")
    assert lag is not None
    # The emulated gyro gives the mean rate since the sample before, so it is 5 ms late by itself.
    assert abs(lag.seconds - seconds - 0.005) < 4.0 * lag.std + 0.001


def test_wheels_follow_their_commands_by_about_the_motors_time_constant() -> None:
    truth = DEFAULT.robot
    lag = check(recording(lively, 5)).lag("wheels")
    assert lag is not None
    assert 0.5 / (truth.k1 * truth.k2_over_k3) < lag.seconds < 1.1 / (truth.k1 * truth.k2_over_k3)


@pytest.mark.slow
def test_the_scatter_of_lags_is_as_large_as_their_standard_deviation_says() -> None:
    errors = []
    for seed in range(12):
        lag = next(lag for lag in lags_of(recording(lively, seed)) if lag.sensor == "poses")
        errors.append((lag.seconds - 0.002) / lag.std)
    # The mean square of 12 is above 2.75 in one of 1,000 cases (chi-square); far below 1 the deviations say nothing.
    assert 0.1 < np.mean(np.square(errors)) < 2.75


def test_lags_are_unknown_where_nothing_changes() -> None:
    rest = recording(at_rest, 1)
    assert all(not lag.known and lag.why_unknown for lag in lags_of(rest))
    steady = recording(circle, 1)
    middle = steady.between(EPOCH + 5_000_000, EPOCH + 30_000_000)
    assert check(middle).lag("poses") is None
    assert "cannot be compared" in check(middle)["poses_clock"].sentence
    assert check(middle)["poses_clock"].found == 0


def test_that_poses_follow_commands_as_motors_do_is_no_fault_of_a_clock() -> None:
    whole = without(recording(lively, 5), "wheels", "gyro")
    for seconds, found in ((0.0, 0), (0.2, 0), (-0.5, 1), (1.5, 1)):
        finding = check(later(whole, "poses", seconds))["poses_clock"]
        assert finding.found == found
        assert "after the commands, motors included" in finding.sentence


@pytest.mark.slow
def test_coarse_encoders_neither_hide_a_lag_nor_make_it_look_more_certain_than_it_is() -> None:
    errors = []
    for seed in range(8):
        whole = recording(figure_eight, seed)
        dt, tick = 0.01, 2.0 * np.pi / 48  # s, rad
        fields = dict(whole.wheels.fields)
        for side in ("left", "right"):
            counts = np.floor(np.cumsum(fields[f"psi_{side}"]) * dt / tick)
            fields[f"psi_{side}"] = np.diff(counts, prepend=counts[:1]) * tick / dt
        coarse = replace(whole, wheels=replace(whole.wheels, fields=fields))
        lag = next(lag for lag in lags_of(coarse) if lag.sensor == "poses")
        assert lag.std < PERIOD
        errors.append((lag.seconds - 0.002) / lag.std)
    # The mean square of 8 is above 3.3 in one of 1,000 cases (chi-square).
    assert 0.1 < np.mean(np.square(errors)) < 3.3


def test_a_manoeuvre_that_repeats_itself_does_not_tell_by_how_many_periods_a_clock_is_late() -> None:
    def swinging(share: float) -> tuple[float, float]:
        turning = 0.3 * math.sin(2.0 * math.pi * 30.0 * share)  # once a second
        return 0.2 + turning, 0.2 - turning

    whole = later(recording(swinging, 1), "poses", 0.68)
    start = int(whole.poses.utime[0])
    lag = lags_of(whole.between(start + 5_000_000, start + 25_000_000))[0]
    assert not lag.known
    assert lag.why_unknown == "several lags fit alike"
