"""What free runs, and the gain measured with them, promise."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cmr.calibration import calibrate
from cmr.estimation.free_runs import (
    SIGNALS,
    WINDOW,
    Errors,
    Fold,
    Values,
    alternating_spans,
    errors_of,
    joined,
    windows_of,
)
from cmr.estimation.gain import gain_of, path_rmse
from cmr.estimation.segments import Segment, segments_of
from cmr.estimation.smoothing import smoothed_poses
from cmr.model.observer.observer import RESTART
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats
from cmr.recordings.wheel_angles import wheel_angles
from tests.reference_plant import NEUTRAL, REALISTIC, SILENT, Noise, packets, recording
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, figure_eight, rich_drive

pytestmark = pytest.mark.slow

TRUE = {name: getattr(NEUTRAL, name) for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
MANOEUVRES = {"figure-eight": (figure_eight(120.0, 6), 120.0), "rich": (rich_drive(), RICH_DRIVE_SECONDS)}
# Less than the noise of usual sensors; a start in the midst of a fast turn is not known better.
NOT_STRAYED = {"position": 2e-3, "heading": 5e-3, "psi_left": 5e-3, "psi_right": 5e-3, "yaw_rate": 5e-3}


@cache
def driven(
    manoeuvre: str, noise: Noise = REALISTIC, seed: int = 1, effect: tuple[tuple[str, float], ...] = ()
) -> Recording:
    drive, seconds = MANOEUVRES[manoeuvre]
    return recording(packets(drive, seconds), dict(effect), seconds, noise, seed)


def piece_of(one: Recording, splits: tuple[int, ...] = ()) -> Segment:
    (segment,) = segments_of(one, splits, 0)
    return segment


def test_after_a_gap_wheels_have_turned_as_far_as_their_encoders_counted_meanwhile() -> None:
    one = driven("rich")
    first = int(one.wheels.utime[0])
    gap = [one.signals[name].utime for name in ("wheels", "gyro", "poses")]
    keep = {
        name: (utime < first + 40_000_000) | (utime > first + 42_000_000)
        for name, utime in zip(("wheels", "gyro", "poses"), gap, strict=True)
    }
    before, after = segments_of(one.where(keep), (), 0)
    counted = np.interp(after.first, one.wheels.utime, wheel_angles(one.wheels)[0])
    assert before.observations.turned == (0.0, 0.0)
    assert after.observations.turned[0] == pytest.approx(counted, abs=0.1)
    assert abs(counted) > 1.0


def errors_with(one: Recording, *models: Values, window: float = WINDOW) -> tuple[Errors, ...]:
    return errors_of([piece_of(one)], [[Fold(models)]], window)


@pytest.mark.parametrize(
    "effect",
    [
        {},
        {"pose_offset": 0.144},
        {"pose_latency": 0.04, "gyro_latency": 0.02},
        {"gyro_bias": 0.01, "gyro_scale": 0.02},
        {"coulomb_friction": 4.0, "command_delay": 0.03},
        {"battery_drift": 0.3, "motor_heating": 0.3},
        {"turn_slip": 0.03, "lateral_skid": 0.06},
    ],
)
def test_a_model_that_knows_everything_does_not_stray(effect: dict[str, float]) -> None:
    of_paper, of_all = errors_with(driven("rich", SILENT, 1, tuple(effect.items())), TRUE, {**TRUE, **effect})
    for name in SIGNALS:
        assert of_all.rmse(name) < NOT_STRAYED[name]
    assert not effect or any(of_paper.rmse(name) > 2.0 * NOT_STRAYED[name] for name in SIGNALS)


def test_what_is_left_of_the_true_model_is_the_noise_of_the_pose() -> None:
    (errors,) = errors_with(driven("figure-eight", Noise(position=0.005)), TRUE)
    # Of both coordinates; and a little more, because the pose at a window's beginning is known only as well as that.
    assert math.sqrt(2.0) * 0.005 < path_rmse(errors) < 1.1 * math.sqrt(2.0) * 0.005


def test_a_start_is_known_better_than_a_single_pose() -> None:
    noise = Noise(position=0.005, heading=0.005)
    noisy, quiet = (piece_of(driven("rich", one)).observations for one in (noise, SILENT))
    off = smoothed_poses([noisy], TRUE)[0] - np.column_stack([quiet.pose[:, :2], np.unwrap(quiet.pose[:, 2])])
    assert np.all(np.std(off, axis=0) < 0.5 * 0.005)


def test_a_jump_of_the_tracker_is_no_error_of_the_model() -> None:
    whole = driven("figure-eight")
    jump = int(whole.poses.utime[1000])
    late = whole.poses.utime >= jump
    fields = {**whole.poses.fields, "x": whole.poses["x"] + 1.0 * late}
    torn = replace(whole, poses=replace(whole.poses, fields=fields))
    (errors,) = errors_of([piece_of(torn, (jump,))], [[Fold((TRUE,))]])
    (unspoilt,) = errors_with(whole, TRUE)
    assert path_rmse(errors) == pytest.approx(path_rmse(unspoilt), rel=0.1)


def test_every_window_is_run_with_the_parameters_that_were_found_without_it() -> None:
    segment = piece_of(driven("figure-eight"))
    wrong = {**TRUE, "base_width": 0.3}
    mine, others = alternating_spans(segment.observations.seconds, 2)
    mixed, _ = errors_of([segment], [[Fold((TRUE, TRUE), mine), Fold((wrong, TRUE), others)]])
    near, _ = errors_of([segment], [[Fold((TRUE, TRUE), mine)]])
    far, _ = errors_of([segment], [[Fold((wrong, TRUE), others)]])
    assert path_rmse(far) > 2.0 * path_rmse(near)
    of_mine = np.isin(mixed.begin, near.begin)
    assert mixed.squares["position"][of_mine] == pytest.approx(near.squares["position"])
    assert mixed.squares["position"][~of_mine] == pytest.approx(far.squares["position"])


def test_no_window_reaches_beyond_its_span_or_beyond_where_the_path_breaks() -> None:
    observations = piece_of(driven("figure-eight")).observations
    use = observations.pose_use.copy()
    use[500] = RESTART
    torn = replace(observations, pose_use=use)
    windows = windows_of(torn, WINDOW, 0.0, 10.0, 40.0)
    assert np.all((windows.begin >= 10.0) & (windows.end <= 40.0))
    assert np.all((windows.end <= torn.pose_time[500]) | (windows.begin >= torn.pose_time[500]))
    assert len(windows.begin) == 9  # of 3 s in 10 s and 20 s less what is left over


def test_models_that_are_alike_gain_nothing() -> None:
    before, after = errors_with(driven("figure-eight"), TRUE, dict(TRUE))
    gain = gain_of(before, after)
    assert gain.ratio == 1.0
    assert gain.interval == (1.0, 1.0)
    assert gain.signals == {"psi": 1.0, "yaw_rate": 1.0, "pose": 1.0}


def test_the_gain_is_the_ratio_of_the_errors_signal_by_signal() -> None:
    biased = driven("figure-eight", effect=(("gyro_bias", 0.03),))
    before, after = errors_with(biased, TRUE, {**TRUE, "gyro_bias": 0.03})
    gain = gain_of(before, after)
    assert gain.signals["yaw_rate"] == pytest.approx(before.rmse("yaw_rate") / after.rmse("yaw_rate"))
    assert gain.signals["yaw_rate"] > 1.5
    assert gain.signals["psi"] == gain.signals["pose"] == gain.ratio == 1.0


@pytest.mark.parametrize("manoeuvre", MANOEUVRES)
def test_the_same_parameters_err_alike_on_the_next_log_of_the_robot(manoeuvre: str) -> None:
    rough = {**TRUE, "k1": 1.02 * TRUE["k1"], "base_width": 1.02 * TRUE["base_width"]}
    found = [[path_rmse(one) for one in errors_with(driven(manoeuvre, seed=s), TRUE, rough)] for s in range(8)]
    least, most = np.min(found, axis=0), np.max(found, axis=0)
    assert np.all(most < 1.2 * least)


def fitted(one: Recording, spans: tuple[tuple[float, float], ...]) -> Values:
    """The paper's model fitted to some spans of a recording."""
    first = int(one.poses.utime[0])
    parts = [one.between(first + round(begin * 1e6), first + round(end * 1e6)) for begin, end in spans]
    return {**TRUE, **{name: estimate.value for name, estimate in calibrate(parts).estimates.items()}}


@pytest.mark.further  # statistics; scripts/study_diagnosis measures gains on other logs
def test_the_error_on_what_was_left_out_is_that_on_a_fresh_log() -> None:
    log, fresh = driven("figure-eight", seed=31), driven("figure-eight", seed=32)
    seconds = MANOEUVRES["figure-eight"][1]
    middle = seconds / 2.0
    halves = ((0.0, middle), (middle, seconds))
    folds = [Fold((fitted(log, (kept,)),), (left_out,)) for kept, left_out in (halves, halves[::-1])]
    (predicted,) = errors_of([piece_of(log)], [folds])
    (measured,) = errors_with(fresh, fitted(log, ((0.0, seconds),)))
    assert path_rmse(predicted) == pytest.approx(path_rmse(measured), rel=0.2)


def made(squares: Floats) -> Errors:
    """Errors by hand: overlapping windows with one position error each."""
    count = len(squares)
    ones, zeros = np.ones(count), np.zeros(count)
    return Errors(
        WINDOW,
        np.arange(count, dtype=np.float64) * WINDOW / 2.0,
        np.zeros(count, np.int64),
        {**dict.fromkeys(SIGNALS, zeros), "position": squares},
        {**dict.fromkeys(SIGNALS, zeros), "position": ones},
    )


def test_the_interval_covers_the_true_ratio_about_as_often_as_it_says() -> None:
    random = np.random.default_rng(5)
    covered = 0
    for _ in range(200):
        # Windows that overlap by half share half of what disturbs them; a wrong model adds an error of its own.
        halves = random.standard_normal(81)
        noise = (halves[1:] + halves[:-1]) / math.sqrt(2.0)
        low, high = gain_of(made((noise + 2.0) ** 2), made(noise**2)).interval
        covered += low <= math.sqrt(5.0) <= high
    assert 180 <= covered <= 198


def test_few_windows_give_a_ratio_and_no_interval() -> None:
    gain = gain_of(made(np.full(2, 4.0)), made(np.full(2, 1.0)))
    assert gain.ratio == 2.0
    assert all(math.isnan(end) for end in gain.interval)


def test_a_log_much_shorter_than_a_window_tells_nothing() -> None:
    whole = driven("figure-eight")
    first = int(whole.poses.utime[0])
    (errors,) = errors_with(whole.between(first, first + 2_200_000), TRUE, window=5.0)
    assert len(errors.begin) == 0
    assert math.isnan(path_rmse(errors))
    gain = gain_of(errors, errors)
    assert math.isnan(gain.ratio)
    assert gain.signals == {}


def test_a_log_in_pieces_a_little_shorter_than_a_window_is_measured_piece_by_piece() -> None:
    whole = driven("figure-eight")
    first = int(whole.poses.utime[0])
    parts = [
        whole.between(first + begin, first + begin + 2_400_000) for begin in range(5_000_000, 60_000_000, 5_000_000)
    ]
    found = [errors_with(part, TRUE)[0] for part in parts]
    assert [len(errors.begin) for errors in found] == [1] * len(parts)
    assert path_rmse(joined(found)) < 0.011


def without(one: Recording, *signals: str) -> Recording:
    return one.where({name: np.zeros(len(one.signals[name]), np.bool_) for name in signals})


def test_what_was_not_recorded_has_no_error_and_the_rest_has() -> None:
    whole = driven("figure-eight")
    (no_gyro,) = errors_with(without(whole, "gyro"), TRUE)
    assert math.isnan(no_gyro.rmse("yaw_rate"))
    assert path_rmse(no_gyro) < 0.011
    (no_poses,) = errors_with(without(whole, "poses"), TRUE)
    assert math.isnan(path_rmse(no_poses))
    assert no_poses.rmse("psi_left", "psi_right") < 0.1
    assert gain_of(no_poses, no_poses).signals == {"psi": 1.0, "yaw_rate": 1.0}
    (no_wheels,) = errors_with(without(whole, "wheels"), TRUE)
    assert math.isnan(no_wheels.rmse("psi_left"))
    assert path_rmse(no_wheels) < 0.011


def test_a_robot_without_commands_is_followed_by_its_wheels() -> None:
    commandless = without(driven("figure-eight"), "commands")
    true, narrow = errors_with(commandless, TRUE, {**TRUE, "base_width": 0.95 * TRUE["base_width"]})
    assert path_rmse(true) < 0.011
    assert path_rmse(narrow) > 2.0 * path_rmse(true)
    assert math.isnan(true.rmse("psi_left"))


def test_the_errors_of_several_recordings_count_together() -> None:
    first, second = (errors_with(driven("figure-eight", seed=seed), TRUE)[0] for seed in (1, 2))
    both = joined((first, second))
    assert path_rmse(both) == pytest.approx(math.hypot(path_rmse(first), path_rmse(second)) / math.sqrt(2.0), rel=0.01)


def test_pieces_are_smoothed_together_as_one_by_one() -> None:
    late = {**TRUE, "pose_latency": 0.05}
    whole = piece_of(driven("rich", Noise(position=0.005, heading=0.005)))
    pieces = [whole.observations, whole.observations, replace(whole.observations, time=300.0)]
    for together, one in zip(smoothed_poses(pieces, late), pieces, strict=True):
        assert np.allclose(together, smoothed_poses([one], late)[0], rtol=0.0, atol=1e-9)
