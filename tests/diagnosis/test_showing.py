"""What the paths and residuals that a report shows promise."""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import pytest

from cmr.diagnosis.paths import LONGEST, MOST_PATHS, MOST_POINTS, most_telling, paths_of
from cmr.diagnosis.result import Residual
from cmr.diagnosis.showing import (
    MOST_SAMPLES,
    residuals_of,
    structure,
    without_each,
)
from cmr.estimation.free_runs import Values
from cmr.estimation.segments import Segment, segments_of
from cmr.recordings.recording import Recording
from tests.reference_plant import NEUTRAL, REALISTIC, SILENT, Noise, packets, recording
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, constant, figure_eight, rich_drive

TRUE = {name: getattr(NEUTRAL, name) for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
SIGNALS = ("psi_left", "psi_right", "yaw_rate", "forward", "sideways", "heading")
OF_COMMANDS = {"command_left", "command_right", "command_change", "energy"}


@cache
def rich(noise: Noise = REALISTIC, effect: tuple[tuple[str, float], ...] = ()) -> Recording:
    return recording(packets(rich_drive(), RICH_DRIVE_SECONDS), dict(effect), RICH_DRIVE_SECONDS, noise, 4)


def segments(one: Recording, number: int = 0) -> list[Segment]:
    return segments_of(one, (), number)


def residuals(one: Recording, before: Values, after: Values) -> dict[str, Residual]:
    return {residual.signal: residual for residual in residuals_of(segments(one), before, after)}


def with_and_without(effect: Mapping[str, float]) -> dict[str, Residual]:
    """The residuals of a robot with an effect, by models without and with it."""
    return residuals(rich(REALISTIC, tuple(effect.items())), TRUE, {**TRUE, **effect})


def without(one: Recording, *signals: str) -> Recording:
    return one.where({name: np.zeros(len(one.signals[name]), np.bool_) for name in signals})


def test_the_path_after_is_the_real_one_where_the_model_knows_everything_and_before_it_is_not() -> None:
    effect = {"turn_asymmetry": 0.03, "pose_offset": 0.05}
    whole = rich(SILENT, tuple(effect.items()))
    one = whole.between(int(whole.poses.utime[0]), int(whole.poses.utime[0]) + round(LONGEST * 1e6))
    (path,) = paths_of(segments(one), TRUE, {**TRUE, **effect}, ["drive"])
    assert path.label == "drive"
    off_before, off_after = (
        np.hypot(x - path.x, y - path.y) for x, y in ((path.before_x, path.before_y), (path.after_x, path.after_y))
    )
    assert np.max(off_after) < 0.005
    assert np.max(off_before) > 0.09
    assert np.max(np.abs(path.after_theta - path.theta)) < 0.01
    assert path.x == pytest.approx(np.interp(path.time, one.poses.seconds, one.poses["x"]))


def test_a_path_is_told_from_the_recordings_first_sample_on_and_by_its_recording() -> None:
    one = rich()
    both = [*segments(one), *segments(one, 1)]
    paths = paths_of(both, TRUE, TRUE, ["a", "b"])
    assert "".join(path.label for path in paths) == "a" * (len(paths) // 2) + "b" * (len(paths) // 2)
    first = paths[: len(paths) // 2]
    assert [(path.piece, path.pieces) for path in first] == [(n + 1, len(first)) for n in range(len(first))]
    assert first[0].time[0] == 0.0
    assert first[-1].time[-1] == pytest.approx(one.poses.seconds[-1], abs=0.05)


def pieces(one: Recording, spans: Sequence[tuple[float, float]], number: int = 0) -> list[Segment]:
    """Parts of a recording, each from one time [s] to another."""
    first = int(one.poses.utime[0])
    parts = (one.between(first + round(begin * 1e6), first + round(end * 1e6)) for begin, end in spans)
    return [segment for part in parts for segment in segments(part, number)]


def test_of_a_recording_in_many_pieces_those_are_shown_in_which_the_effects_change_the_path_most() -> None:
    """The robot rests in most pieces, drives straight on in some, and turns, where the effect acts, in one."""
    seconds = 40.0
    still, straight, turning = (packets(constant(*duty), seconds) for duty in ((0.0, 0.0), (0.4, 0.4), (0.3, 0.5)))
    rest, ahead, turns = (recording(drive, {}, seconds, REALISTIC, 1) for drive in (still, straight, turning))
    many = [
        *pieces(rest, [(3.0 * n, 3.0 * n + 2.5) for n in range(8)]),
        *pieces(ahead, [(3.0 * n, 3.0 * n + 2.5) for n in range(1, 4)]),
        *pieces(turns, [(12.0, 14.5)]),
    ]
    shown = most_telling(paths_of(many, TRUE, {**TRUE, "turn_asymmetry": 0.2}, ["run"]))
    assert len(shown) == MOST_PATHS
    assert (shown[0].piece, shown[0].pieces) == (12, 12)
    alike = most_telling(paths_of(many, TRUE, TRUE, ["run"]))
    assert {path.piece for path in alike} == {9, 10, 11, 12}  # those that lead somewhere


def test_of_several_recordings_one_piece_of_each_comes_first() -> None:
    spans = [(10.0 * n, 10.0 * n + 6.0) for n in range(4)]
    both = [*pieces(rich(), spans, 0), *pieces(rich(REALISTIC, (("turn_asymmetry", 0.2),)), spans, 1)]
    shown = most_telling(paths_of(both, TRUE, {**TRUE, "turn_slip": 0.05}, ["a", "b"]))
    assert {path.label for path in shown[:2]} == {"a", "b"}
    assert len({(path.label, path.piece) for path in shown}) == MOST_PATHS


def test_long_recordings_are_cut_and_shown_by_as_many_points_as_a_page_can_bear() -> None:
    seconds = 400.0
    long = recording(packets(figure_eight(seconds, 16), seconds), {}, seconds, REALISTIC, 1)
    paths = paths_of(segments(long), TRUE, {**TRUE, "turn_asymmetry": 0.1}, [""])
    assert len(paths) == np.ceil(seconds / LONGEST)
    for path in paths:
        assert len(path.x) <= MOST_POINTS
        assert 0.0 < path.time[-1] - path.time[0] <= LONGEST
        assert 0.0 < np.min(np.diff(path.time)) < np.max(np.diff(path.time)) < 0.1  # what is drawn of it stays smooth
        assert path.before_x[0] == path.after_x[0] == pytest.approx(path.x[0], abs=0.02)  # begun again
    assert paths[-1].time[-1] == pytest.approx(seconds, abs=0.1)
    for residual in residuals_of(segments(long), TRUE, TRUE):
        assert len(residual.before) <= MOST_SAMPLES
        assert all(len(values) == len(residual.before) for values in residual.regressors.values())
        assert np.all(np.diff(residual.regressors["time"]) > 0.0)


def test_the_bias_of_a_gyro_shows_in_the_yaw_rate_at_its_size_and_is_gone_after() -> None:
    yaw_rate = with_and_without({"gyro_bias": 0.05})["yaw_rate"]
    assert np.mean(yaw_rate.before) == pytest.approx(0.05, abs=0.005)
    assert np.mean(yaw_rate.after) == pytest.approx(0.0, abs=0.005)
    assert yaw_rate.unit == "rad/s"


def test_a_wheel_that_turns_slower_than_simulated_has_a_negative_residual() -> None:
    still_fast = {**TRUE, "k1": 0.9 * TRUE["k1"]}
    seconds = 20.0
    straight = recording(packets(constant(0.5, 0.5), seconds), {}, seconds, REALISTIC, 1)
    too_fast = residuals(straight, still_fast, TRUE)
    expected = 0.5 / TRUE["k1"] - 0.5 / still_fast["k1"]
    assert np.median(too_fast["psi_left"].before) == pytest.approx(expected, rel=0.05)
    assert np.median(too_fast["psi_right"].after) == pytest.approx(0.0, abs=0.05)
    # Grown over a second: so much less way than predicted.
    assert np.median(too_fast["forward"].before) == pytest.approx(0.9 * expected * TRUE["wheel_radius"], rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "signal", "regressor", "share"),
    [
        ({"lateral_skid": 0.06}, "sideways", "speed_times_yaw_rate", 0.5),
        ({"slope_x": 1.0, "slope_y": -0.6}, "psi_left", "heading", 0.5),
        ({"quadratic_drag": 0.06}, "psi_right", "command_right", 0.5),
        ({"battery_drift": 0.3}, "forward", "energy", 0.03),
        ({"gyro_drift": 0.1}, "yaw_rate", "time", 0.5),
        ({"gyro_latency": 0.02}, "yaw_rate", "yaw_acceleration", 0.3),
        ({"pose_latency": 0.1}, "forward", "acceleration", 0.3),
        ({"command_delay": 0.03}, "psi_left", "command_change", 0.2),
        ({"turn_asymmetry": 0.1}, "heading", "yaw_rate", 0.5),
    ],
)
def test_an_effect_shows_over_the_regressor_that_it_is_made_of_and_is_gone_after(
    effect: dict[str, float], signal: str, regressor: str, share: float
) -> None:
    residual = with_and_without(effect)[signal]
    over = residual.regressors[regressor]
    assert structure(residual.before, over) > share
    assert structure(residual.after, over) < 0.25 * share


def test_each_of_two_effects_is_shown_by_what_the_full_model_leaves_without_it_alone() -> None:
    skid, bias = {"lateral_skid": 0.06}, {"gyro_bias": 0.05}
    shown = residuals(rich(REALISTIC, tuple((skid | bias).items())), TRUE, {**TRUE, **skid, **bias})
    sideways, yaw_rate = shown["sideways"], shown["yaw_rate"]
    assert set(sideways.without) == set(yaw_rate.without) == {"lateral_skid", "gyro_bias"}
    over = sideways.regressors["speed_times_yaw_rate"]
    assert structure(sideways.without["lateral_skid"], over) > 0.5
    assert structure(sideways.without["gyro_bias"], over) < 0.1
    assert np.mean(yaw_rate.without["gyro_bias"]) == pytest.approx(0.05, abs=0.005)
    assert np.mean(yaw_rate.without["lateral_skid"]) == pytest.approx(0.0, abs=0.005)
    only_one = residuals(rich(), TRUE, {**TRUE, **skid})["sideways"]
    assert only_one.without["lateral_skid"] == pytest.approx(only_one.before)


def test_an_effect_of_a_moment_is_switched_off_and_its_moment_stays() -> None:
    later = {"surface_change_k1": 0.05, "surface_change_base_width": 0.04, "surface_change_time": 60.0}
    assert without_each({**TRUE, **later, "gyro_bias": 0.0}, {}) == {
        "surface_change": {
            **TRUE,
            **later,
            "surface_change_k1": 0.0,
            "surface_change_base_width": 0.0,
            "gyro_bias": 0.0,
        }
    }
    assert without_each(TRUE, {}) == {}


def test_an_effect_that_is_known_is_shown_as_far_as_it_departs() -> None:
    values, given = {**TRUE, "gyro_bias": 0.05, "gyro_scale": 0.02}, {"gyro_bias": 0.02, "gyro_scale": 0.02}
    assert without_each(values, given) == {"gyro_bias": {**values, "gyro_bias": 0.02}}


def test_noise_alone_shows_no_structure_over_anything() -> None:
    noisy_sensors = Noise(ticks_per_turn=480.0, gyro=0.02, position=0.02, heading=0.02)
    for residual in residuals(rich(noisy_sensors), TRUE, TRUE).values():
        assert np.array_equal(residual.before, residual.after)
        for name, over in residual.regressors.items():
            assert structure(residual.before, over) < 0.1, (residual.signal, name)


def test_angles_of_wheels_and_headings_are_within_one_turn() -> None:
    for residual in residuals(rich(), TRUE, TRUE).values():
        for name in ("wheel_angle_left", "wheel_angle_right"):
            assert np.all((residual.regressors[name] >= 0.0) & (residual.regressors[name] < 2.0 * np.pi))
        assert np.all(np.abs(residual.regressors["heading"]) <= np.pi)


def test_regressors_of_a_steady_drive_are_what_a_pocket_calculator_says() -> None:
    seconds, left, right = 20.0, 0.3, 0.5
    steady = recording(packets(constant(left, right), seconds), {}, seconds, SILENT, 1)
    regressors = residuals(steady, TRUE, TRUE)["yaw_rate"].regressors
    late = regressors["time"] > 10.0
    speed = TRUE["wheel_radius"] * (left + right) / 2.0 / TRUE["k1"]
    yaw_rate = TRUE["wheel_radius"] * (right - left) / TRUE["k1"] / TRUE["base_width"]
    load = 0.2 * (left**2 + right**2)  # at a wheel speed of duty / K1
    for name, expected in (
        ("speed", speed),
        ("yaw_rate", yaw_rate),
        ("speed_times_yaw_rate", speed * yaw_rate),
        ("command_left", left),
        ("command_right", right),
        ("acceleration", 0.0),
        ("command_change", 0.0),
    ):
        assert regressors[name][late] == pytest.approx(expected, rel=1e-4, abs=1e-9)
    spent = np.polyfit(regressors["time"][late], regressors["energy"][late], 1)[0]
    assert spent == pytest.approx(load, rel=1e-4)


def test_only_what_was_recorded_has_residuals() -> None:
    one = rich()
    assert set(residuals(one, TRUE, TRUE)) == set(SIGNALS)
    assert set(residuals(without(one, "gyro"), TRUE, TRUE)) == set(SIGNALS) - {"yaw_rate"}
    assert set(residuals(without(one, "poses"), TRUE, TRUE)) == {"psi_left", "psi_right", "yaw_rate"}
    assert set(residuals(without(one, "wheels"), TRUE, TRUE)) == set(SIGNALS) - {"psi_left", "psi_right"}
    assert paths_of(segments(without(one, "poses")), TRUE, TRUE, [""]) == []
    assert residuals_of([], TRUE, TRUE) == ()


def test_without_commands_nothing_is_shown_over_commands() -> None:
    shown = residuals(without(rich(), "commands"), TRUE, TRUE)
    assert set(shown) == {"yaw_rate", "forward", "sideways", "heading"}
    assert not any(OF_COMMANDS & set(residual.regressors) for residual in shown.values())


def test_a_log_of_some_seconds_is_shown_too() -> None:
    whole = rich()
    first = int(whole.poses.utime[0])
    for seconds in (2.1, 2.6, 4.0):
        short = whole.between(first, first + round(seconds * 1e6))
        assert len(paths_of(segments(short), TRUE, TRUE, [""])) == 1
        assert set(residuals(short, TRUE, TRUE)) == set(SIGNALS)


def test_structure_is_the_share_of_the_variance_that_a_function_of_the_regressor_makes() -> None:
    random = np.random.default_rng(3)
    over = random.uniform(-1.0, 1.0, 3000)
    noise = random.standard_normal(3000)
    function = 2.0 * np.sin(3.0 * over)
    share = np.var(function) / np.var(function + noise)
    assert structure(function + noise, over) == pytest.approx(share, abs=0.03)
    assert structure(noise, over) == pytest.approx(0.0, abs=0.02)


def test_structure_sees_a_trend_over_time_but_neither_a_constant_nor_a_single_event() -> None:
    random = np.random.default_rng(3)
    time, noise = np.arange(3000.0), random.standard_normal(3000)
    assert structure(noise + 1e-3 * time, time) == pytest.approx(0.43, abs=0.05)
    assert structure(noise + 5.0, time) < 0.02
    assert structure(noise, np.ones(3000)) == 0.0
    assert structure(noise[:20], time[:20]) == 0.0
    once = noise + 10.0 * (time == 1500.0)
    assert structure(once, time) < 0.02


def test_structure_passes_over_what_is_not_finite() -> None:
    random = np.random.default_rng(3)
    over = random.uniform(-1.0, 1.0, 3000)
    broken = np.where(np.arange(3000) % 7 == 0, np.nan, over)
    assert structure(over, over) > 0.98
    assert structure(broken, over) > 0.98
    assert structure(over, broken) > 0.98
