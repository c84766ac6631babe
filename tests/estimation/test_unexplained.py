"""What no effect describes is found in what a model leaves, and nothing is found where nothing is."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cmr.diagnosis.words import REGRESSORS
from cmr.estimation.checks import looked_at
from cmr.estimation.noise import Noise, SignalNoise
from cmr.estimation.prediction import SIGNALS, Errors, Predictor
from cmr.estimation.preparation import prepare
from cmr.estimation.segments import segments_of
from cmr.estimation.unexplained.bursts import bursts
from cmr.estimation.unexplained.remaining import (
    BURSTS,
    LEAST,
    SMALLEST_SHARE,
    Remaining,
    bursts_count,
    holds,
    remaining,
    spread_of,
)
from cmr.estimation.unexplained.scores import Remainder, Score
from cmr.estimation.unexplained.share import coloured, share_predicted
from cmr.estimation.unexplained.terms import FADED, FADING, Drive, Term, _swinging, drives_of, terms_for
from cmr.estimation.unexplained.traces import DISTURBED, SEEN_IN, Disturbances, only, traces
from cmr.model.observer.observer import MOTION, Gains
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats
from tests.hidden_effects import hidden_recording
from tests.hidden_effects.cases import RICH, Case
from tests.hidden_effects.hiding import recorded, truth_of
from tests.reference_plant import NEUTRAL, packets, recording
from tests.reference_plant.manoeuvres import RICH_DRIVE_SECONDS, rich_drive

ROBOT = {name: getattr(NEUTRAL, name) for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
GAINS = Gains(0.2, 1.0, 0.15, 0.15)
SEED = 3
RESTING = 2.0  # s before which the robot has not set off


@cache
def left_by(*hidden: str, modelled: tuple[str, ...] = (), noise: str = "realistic") -> Remaining:
    """What remains of a rich drive beside a model that has these effects as they are."""
    case = hidden_recording(*hidden, seed=SEED, noise=noise)
    known = {name: case.truth.parameters[name] for name in modelled}
    return remaining_of([case.recording], case.recording.parameters, known)


def remaining_of(
    recordings: list[Recording], nominal: ParameterFile | None, known: Mapping[str, float] | None = None
) -> Remaining:
    """What remains beside the paper's model and what is `known`, all fitted."""
    known = known or {}
    assert nominal is not None
    ready = prepare(looked_at(recordings), nominal)
    problem, base = ready.problem, ready.base
    assert problem is not None
    assert base is not None
    values = {**base.values, **known}
    noise = Noise.found(problem.batch, problem.joint_errors(values))
    return remaining(problem, problem.fit(values, (*base.names, *known), noise), base)


@cache
def silent() -> Recording:
    return recording(packets(rich_drive(), RICH_DRIVE_SECONDS), {}, RICH_DRIVE_SECONDS)


@cache
def predictor() -> Predictor:
    (segment,) = segments_of(silent(), (), 0)
    return Predictor(segment)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [(), ("quadratic_drag",)])
def test_nothing_remains_of_a_robot_whose_model_knows_everything(hidden: tuple[str, ...]) -> None:
    left = left_by(*hidden, modelled=hidden)
    assert not left.unexplained.present, left.unexplained
    assert left.statistic < left.threshold


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "signals", "regressor"),
    [
        ("quadratic_drag", {"psi_left", "psi_right"}, "speed"),
        ("torque_ripple", {"psi_left", "psi_right", "yaw_rate"}, "wheel_angle_left"),
        ("side_wind", {"sideways"}, "heading"),
        ("caster_flip", {"yaw_rate"}, "time"),
    ],
)
def test_what_the_model_does_not_know_is_told_with_its_signal_and_what_it_goes_with(
    hidden: str, signals: set[str], regressor: str
) -> None:
    left = left_by(hidden)
    assert left.unexplained.present
    assert left.statistic > left.threshold
    assert left.unexplained.signal in signals
    assert regressor in left.unexplained.regressors
    assert 0.1 < left.unexplained.share < 1.0


@pytest.mark.slow
def test_coarse_encoders_are_not_taken_for_unknown_physics() -> None:
    unexplained = left_by(noise="coarse").unexplained
    assert not unexplained.present
    assert math.isnan(unexplained.share)  # not judged, which is not the same as nothing
    assert "ticks are so coarse" in unexplained.not_judged


def motion() -> dict[str, Floats]:
    """How the robot moves in the middle of each step."""
    columns = predictor().errors(ROBOT, GAINS).motion
    result = dict(zip(MOTION, (0.5 * (columns[1:] + columns[:-1])).T, strict=True))
    result["speed"] = 0.5 * ROBOT["wheel_radius"] * (result["psi_left"] + result["psi_right"])
    return result


def of(*columns: tuple[str, Floats]) -> Disturbances:
    """Disturbances of one thing each, by name."""
    shares = np.zeros((len(DISTURBED), len(columns)))
    for index, (name, _) in enumerate(columns):
        shares[DISTURBED.index(name), index] = 1.0
    return Disturbances(np.stack([course for _, course in columns], axis=1), shares)


def as_disturbances(effect: str) -> Disturbances:
    """What an effect of size 1 does, as its equation says it."""
    m = motion()
    drag = {side: -m[f"psi_{side}"] * np.abs(m[f"psi_{side}"]) for side in ("left", "right")}
    return {
        "slope_x": of(("left", -np.cos(m["theta"])), ("right", -np.cos(m["theta"]))),
        "quadratic_drag": of(*drag.items()),
        "lateral_skid": of(("sideways", -m["speed"] * m["yaw_rate"])),
        "wheel_radius_scale": of(("forward", m["speed"]), ("yaw_rate", m["yaw_rate"])),
        "encoder_scale": of(("left_encoder", m["psi_left"]), ("right_encoder", m["psi_right"])),
        "gyro_scale": of(("gyro", m["yaw_rate"])),
        "pose_offset": of(("east", np.cos(m["theta"])), ("north", np.sin(m["theta"]))),
        "pose_offset_lateral": of(("east", -np.sin(m["theta"])), ("north", np.cos(m["theta"]))),
    }[effect]


@pytest.mark.parametrize(
    "effect",
    [
        *("slope_x", "quadratic_drag", "lateral_skid", "wheel_radius_scale", "encoder_scale", "gyro_scale"),
        *("pose_offset", "pose_offset_lateral"),
    ],
)
def test_a_disturbance_leaves_the_traces_of_the_effect_that_does_the_same(effect: str) -> None:
    size = 1e-4
    without, beside = (
        predictor().told_once(predictor().errors(values, GAINS), GAINS) for values in (ROBOT, {**ROBOT, effect: size})
    )
    left = traces(predictor(), without.motion, ROBOT, GAINS, as_disturbances(effect))
    for signal in SIGNALS:
        real = (without.of[signal] - beside.of[signal])[:, 0] / size
        off = left.of[signal].sum(axis=1) - real
        assert np.linalg.norm(off) <= 0.1 * np.linalg.norm(real), signal


def test_of_some_signals_alone_the_traces_are_the_same() -> None:
    without = predictor().errors(ROBOT, GAINS)
    one = as_disturbances("lateral_skid")
    some = traces(only(predictor(), ("forward", "sideways")), without.motion, ROBOT, GAINS, one)
    every = traces(predictor(), without.motion, ROBOT, GAINS, one)
    assert set(some.of) == {"forward", "sideways"}
    for signal in some.of:
        assert np.array_equal(some.of[signal], every.of[signal])
    assert not any(np.any(every.of[signal]) for signal in set(SIGNALS) - set(some.of))


def test_dry_friction_holds_a_resting_wheel_against_a_disturbance() -> None:
    values = {**ROBOT, "coulomb_friction": 4.0}
    without = predictor().errors(values, GAINS)
    rest = predictor().times["psi_left"] < RESTING
    push = of(("left", np.ones(len(without.motion) - 1)))
    held, pushed = (traces(predictor(), without.motion, robot, GAINS, push) for robot in (values, ROBOT))
    assert not np.any(held.of["psi_left"][rest])
    assert np.all(pushed.of["psi_left"][rest] > 0.0)


def terms() -> list[Term]:
    return terms_for(drives_of([predictor()], [predictor().errors(ROBOT, GAINS)], ROBOT["k1"]), predicted=True)


def test_reports_know_the_names_of_what_terms_go_with() -> None:
    names = {name for term in terms() for name in term.regressors}
    assert names - set(REGRESSORS) == {"time_since_reversal"}
    assert {term.disturbed for term in terms()} <= set(SEEN_IN)


def test_columns_of_a_term_are_finite_and_as_many_in_every_drive() -> None:
    (drive,) = drives_of([predictor()], [predictor().errors(ROBOT, GAINS)], ROBOT["k1"])
    still = replace(drive, **{name: 0.0 * getattr(drive, name) for name in ("speed", "yaw_rate", "x", "y", "theta")})
    for term in terms_for([drive, still], predicted=True):
        columns = term.columns(drive)
        assert len(columns) == len(term.columns(still))
        assert all(np.all(np.isfinite(course)) and course.shape == drive.time.shape for _, course in columns)


def score(drop: float, **fields: float) -> Score:
    return Score(terms()[0], **{"drop": drop, "freedom": 4, "blocks": 80, **fields})  # type: ignore[arg-type]


def test_a_term_counts_that_explains_much_throughout_the_drive() -> None:
    assert holds(score(500.0, held_out=450.0, steady=300.0), 1.0, LEAST)


def test_a_small_term_counts_only_where_all_parts_of_the_drive_agree() -> None:
    assert holds(score(60.0, held_out=50.0, steady=40.0, agreement=45.0), 1.0, LEAST)
    assert not holds(score(60.0, held_out=50.0, steady=40.0, agreement=15.0), 1.0, LEAST)


@pytest.mark.parametrize(
    ("fields", "least"),
    [
        ({"held_out": 100.0, "steady": 300.0}, LEAST),  # it predicts little
        ({"held_out": 450.0, "steady": 20.0}, LEAST),  # a few moments make all of it
        ({"held_out": 450.0, "steady": 300.0}, 460.0),  # effects that explain much may leave as much
    ],
)
def test_a_term_does_not_count_for_its_drop_alone(fields: dict[str, float], least: float) -> None:
    assert not holds(score(500.0, **fields), 1.0, least)


@pytest.mark.slow
def test_drops_of_terms_that_explain_nothing_tell_how_far_the_noise_is_off() -> None:
    assert spread_of([score(12.0) for _ in range(9)]) == pytest.approx(3.0)
    assert spread_of([score(2.0) for _ in range(9)]) == 1.0
    assert spread_of([]) == 1.0


def white_noise() -> Remainder:
    """Yaw rates of a minute at 100 Hz."""
    rate, count = 100.0, 6000
    noise = np.random.default_rng(1).standard_normal(count)
    number = np.full(count, SIGNALS.index("yaw_rate"))
    zeros = np.zeros(count, np.int64)
    return Remainder(noise, noise, np.zeros((count, 1)), number, np.arange(count) / rate, zeros, zeros)


def test_noise_has_no_bursts_and_a_few_loud_moments_are_counted_as_such() -> None:
    noise = white_noise()
    (calm,) = bursts(noise)
    assert (calm.number, calm.excess) == (0, 0.0)
    at = np.isin((noise.time / 0.5).astype(int), (10, 50, 90))
    (loud,) = bursts(replace(noise, loud=np.where(at, 10.0 * noise.loud, noise.loud)))
    assert loud.number == 3
    assert bursts_count(loud, explained=0.0)
    assert not bursts_count(loud, explained=10.0 * loud.excess)
    assert not bursts_count(replace(loud, number=BURSTS - 1), explained=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["commands", "gyro", "poses"])
def test_what_was_not_recorded_is_done_without(missing: str) -> None:
    one = hidden_recording(seed=SEED).recording
    without = one.where({missing: np.zeros(len(one.signals[missing]), np.bool_)})
    left = remaining_of([without], one.parameters)
    assert not left.unexplained.present, left.unexplained
    disturbed = {score.term.disturbed for score in left.scores}
    assert ("left" in disturbed) == (missing != "commands")
    assert ("east" in disturbed) == (missing != "poses")


@pytest.mark.slow
def test_what_remains_of_two_recordings_holds_from_one_to_the_other() -> None:
    cases = [hidden_recording("gyro_magnetism", seed=SEED, run=run) for run in (0, 1)]
    left = remaining_of([case.recording for case in cases], cases[0].recording.parameters)
    assert left.unexplained.present
    assert (left.unexplained.signal, left.unexplained.regressors) == ("yaw_rate", ("heading",))


def noise_of(past: Floats, sizes: Floats) -> Noise:
    return Noise({name: SignalNoise(past, np.zeros(3), (sizes,)) for name in ("psi_left", "psi_right", "yaw_rate")})


def test_errors_made_white_are_put_back_as_they_were() -> None:
    count = len(predictor().times["yaw_rate"])
    random = np.random.default_rng(2)
    past, sizes = np.array([0.3, 0.2, 0.1, 0.0, 0.1, 0.02, 0.0, 0.0, 0.0]), random.uniform(1.0, 2.0, count)
    noise = noise_of(past, sizes)
    seen = only(predictor(), ("yaw_rate",))
    errors = 0.01 * random.standard_normal((count, 1))
    errors[:66] = 0.0  # the first have no past
    white = noise.white(0, seen, Errors({"yaw_rate": errors}, np.zeros((1, len(MOTION)))))["yaw_rate"]
    assert np.allclose(coloured(white[:, 0], 0, "yaw_rate", noise.of["yaw_rate"]), errors[:, 0], atol=1e-12)


def test_the_share_is_that_of_the_errors_themselves_and_never_negative() -> None:
    """What is slow is a small part of the white errors, and most of those that the model makes."""
    seen = only(predictor(), ("yaw_rate",))
    count = len(seen.times["yaw_rate"])
    past = np.zeros(9)
    past[0] = 0.9
    noise = noise_of(past, np.ones(count))
    random = np.random.default_rng(3)
    noisy, slow = random.standard_normal(count), np.full(count, 0.5)
    white = float(slow @ slow) / float((noisy + slow) @ (noisy + slow))
    shares = [share_predicted([seen], noise, noisy + slow, part, "yaw_rate") for part in (slow, -slow, 0.0 * slow)]
    # 1 / (1 - 0.9) times as large, and noise 1 / (1 - 0.9^2) times its variance.
    expected = 100.0 * 0.25 / (100.0 * 0.25 + 1.0 / (1.0 - 0.9**2))
    assert white < 0.25
    assert shares == [pytest.approx(expected, abs=0.05), 0.0, 0.0]


@pytest.mark.slow
def test_what_explains_next_to_nothing_of_the_errors_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    assert left_by("quadratic_drag").unexplained.share > SMALLEST_SHARE
    monkeypatch.setattr("cmr.estimation.unexplained.remaining.share_predicted", lambda *_: 0.9 * SMALLEST_SHARE)
    case = hidden_recording("quadratic_drag", seed=SEED)
    assert not remaining_of([case.recording], case.recording.parameters).unexplained.present


def test_what_swings_answers_a_jolt_by_a_swing_that_fades() -> None:
    dt, at, frequency = 0.01, 100, 1.26
    still, speed = np.zeros(1000), np.zeros(1000)
    speed[at:] = 1.0
    pair = still, still
    drive = Drive(still, still, still, still, speed, still, pair, pair, pair, pair, dt)
    away, moving = _swinging(frequency, drive)
    rate, since = 2.0 * np.pi * frequency, dt * np.arange(1000 - at)
    fading = np.exp(-FADING * rate * since)
    assert away == pytest.approx(np.concatenate([np.zeros(at), fading * np.sin(rate * since)]), abs=np.exp(-FADED))
    assert moving == pytest.approx(np.concatenate([np.zeros(at), fading * np.cos(rate * since)]), abs=np.exp(-FADED))


@pytest.mark.slow
def test_a_liquid_that_swings_is_seen_beside_encoders_whose_errors_are_their_ticks() -> None:
    """So a robot that only carries an open tank is never called one that has nothing."""
    truth = truth_of(Case(("slosh",), RICH, 1001))
    case = recorded(truth)
    left = remaining_of([case.recording], case.recording.parameters)
    assert left.unexplained.present
    assert left.unexplained.regressors == ("acceleration",)
