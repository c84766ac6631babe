"""Estimates while a drive goes on: averages come in time, nothing jumps between them, and options are kept to."""

from typing import Any

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.calibration.calibrator import Calibrator
from cmr.calibration.loading import NOMINAL, made_up_recording
from cmr.calibration.running import RunningFit
from cmr.commands.calibrate import LOOK_PERIOD, _say
from cmr.estimation.estimates import Estimate
from cmr.model.parameters import DEFINITIONS
from cmr.msg import calibration_status_t
from cmr.recordings.recording import Recording
from tests.calibration.test_alone import figure_eight
from tests.support.lanes import further

pytestmark = pytest.mark.slow

LOOKS = LOOK_PERIOD  # s between looks, if each is that short


# Like the robot of cmr-demo: two effects that are seen soon, and two that are not for long.
HIDDEN = {"motor_gain_asymmetry": 0.025, "wheel_radius_asymmetry": 0.005, "coulomb_friction": 0.4, "turn_slip": 0.004}


@pytest.fixture(scope="module")
def drive() -> Recording:
    return figure_eight(HIDDEN, "two60")


def until(recording: Recording, seconds: float) -> Recording:
    begin = int(recording.wheels.utime[0])
    return recording.between(begin, begin + round(seconds * 1e6))


class SlowComputer:
    """A clock by which every look takes a given time [s]: it is asked at the beginning of a look, and at its end."""

    def __init__(self, takes: float) -> None:
        self.takes, self._time = takes, 0.0

    def __call__(self) -> float:
        self._time += self.takes
        return self._time


@pytest.mark.parametrize("takes", [0.1, *further(1.5, 3.0)])
def test_averages_begin_at_least_every_five_seconds_however_long_a_look_takes(drive: Recording, takes: float) -> None:
    running = RunningFit(None, clock=SlowComputer(takes))
    began, seconds = [], 20.0
    while seconds < 32.0:
        before = running.averages
        running.look(until(drive, seconds))
        if running.averages > before:
            began.append(seconds)
        seconds += max(takes, LOOKS)
    assert np.max(np.diff([*began, seconds])) < 5.0
    assert np.min(np.diff(began)) > 2.0  # not more often than is of use


def test_averages_that_take_too_long_use_fewer_readings_and_give_the_same_within_their_deviations(
    drive: Recording,
) -> None:
    slow, quick = RunningFit(None, clock=SlowComputer(7.0)), RunningFit(None, clock=SlowComputer(0.1))
    slow.look(until(drive, 40.0))
    few, all_of_them = slow.look(until(drive, 45.0)), quick.look(until(drive, 45.0))
    # An average may take 2 s: of 7 s, one reading of four.
    assert few.samples == pytest.approx(all_of_them.samples / 4.0, rel=0.01)
    for name, estimate in all_of_them.estimates.items():
        assert abs(few.estimates[name].value - estimate.value) < 3.0 * few.estimates[name].std, name


@pytest.mark.parametrize("seconds", [*further(40.0), 50.0])
def test_between_two_averages_the_estimates_move_by_what_new_data_tell(drive: Recording, seconds: float) -> None:
    running = RunningFit(None, clock=SlowComputer(0.1))
    average = running.look(until(drive, seconds))
    fitted = running.look(until(drive, seconds + 0.5))
    assert running.averages == 1
    # Where information grows with time, variances shrink by 0.5 s in `seconds`, and estimates move by the root of that.
    usual = np.sqrt(0.5 / seconds)
    for name, estimate in average.estimates.items():
        assert abs(fitted.estimates[name].value - estimate.value) < 4.0 * usual * estimate.std, name


def test_with_paper_only_the_estimates_so_far_are_of_the_three_parameters_alone(drive: Recording) -> None:
    calibrator = Calibrator(0, paper_only=True)
    calibrator.look(until(drive, 40.0))
    assert calibrator.preview is not None
    assert set(calibrator.preview.parameters) == set(DEFINITIONS)
    beside = RunningFit(None).look(until(drive, 40.0))
    assert set(beside.parameters) > set(DEFINITIONS)
    # Three parameters predict the path less well; the path error stated is theirs.
    assert calibrator.preview.path_rmse_after > 1.5 * beside.path_rmse_after


def test_the_drive_that_was_made_up_to_load_the_estimator_is_fitted_whole() -> None:
    result = RunningFit(NOMINAL).look(made_up_recording())
    for name in ("k2_over_k3", "k1", "base_width"):
        assert result.estimates[name].value == pytest.approx(NOMINAL.value(name), rel=0.02), name


def test_a_calibrator_says_that_it_loads_until_it_has_loaded() -> None:
    calibrator = Calibrator(0)
    calibrator.loading = True
    assert "Loading" in calibrator.status().message
    calibrator.load()
    assert "Waiting" in calibrator.status().message
    assert calibrator.result is None


def status(progress: float) -> Any:
    return make(
        calibration_status_t,
        robot_id=0,
        state=calibration_status_t.COLLECTING,
        progress=progress,
        k2_over_k3=118.0,
        k1=0.054,
        base_width=0.161,
        k2_over_k3_std=1.0,
        k1_std=0.001,
        base_width_std=0.001,
        message="Covered.",
        utime=0,
        path_rmse_before=0.1,
        path_rmse_after=0.01,
    )


def test_each_average_is_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    said = ""
    for averages in (1, 1, 2, 2, 2, 3):
        said = _say(0, status(1.0), {"k2_over_k3": Estimate(118.0, 1.0)}, averages, said)
    assert capsys.readouterr().out.count("So far: k2_over_k3 118") == 3
