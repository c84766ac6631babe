"""Logs with a hidden effect are what a diagnosis can fairly be measured on."""

import ast
import math
from collections.abc import Mapping
from pathlib import Path

import lcm
import numpy as np
import pytest

from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats
from tests.hidden_effects import Case, hidden_recording, hide, sets
from tests.hidden_effects.cases import (
    BRIEF,
    CONTROLLED_WINDOWS,
    EIGHT,
    EIGHT_OPEN,
    NOISES,
    RICH,
    SECONDS,
    SHORT_SECONDS,
    WINDOWS,
    Truth,
)
from tests.hidden_effects.driving import commands_of, eight
from tests.hidden_effects.hiding import truth_of
from tests.hidden_effects.laws.kinds import KINDS
from tests.hidden_effects.laws.visibility import VISIBLE, visibility
from tests.hidden_effects.robots import TYPICAL_ROBOT
from tests.hidden_effects.unknown import FRICTIONS, UNKNOWN
from tests.reference_plant import SILENT, TYPICAL, drive
from tests.support.lanes import further
from tests.support.project import PROJECT

pytestmark = pytest.mark.slow

ROOMS = ("hidden_effects", "hidden_effects/laws", "reference_plant")
GENERATOR = [
    *(
        path
        for room in ("hidden_effects", "hidden_effects/laws", "reference_plant")
        for path in PROJECT.glob(f"tests/{room}/*.py")
    ),
    *PROJECT.glob("cmr/plant/*.py"),
]
# They call the diagnosis, or say what CMR commands; the others make what it is measured on.
NOT_OF_PLANT = {"diagnosing.py", "rows.py", "answers.py", "commanded.py"}
SOME_KINDS = ("understeer", "cogging", "gyro_field")
SECOND = 100  # samples of wheels and gyro
HIDDEN = {**TYPICAL, **UNKNOWN}


def imports(path: Path) -> set[str]:
    """The modules that a source file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


def signals(recording: Recording) -> list[Floats]:
    """How far wheels turned, how far the robot came ahead and sideways, and turned, in each second, and its gyro.

    All in units of their noise.
    """
    noise, second = NOISES["realistic"], SECOND // 4
    ticks = [recording.wheels[f"ticks_{side}"] for side in ("left", "right")]
    place, theta = recording.poses["x"] + 1j * recording.poses["y"], np.unwrap(recording.poses["theta"])
    way = (place[second:] - place[:-second]) * np.exp(-1j * theta[:-second]) / noise.position
    turned = (theta[second:] - theta[:-second]) / noise.heading
    wheels = [count[SECOND:] - count[:-SECOND] for count in ticks]
    return [*wheels, way.real, way.imag, turned, recording.gyro["yaw_rate"] / noise.gyro]


def difference(truth: Truth, without: Mapping[str, float]) -> float:
    """How much the signals of a robot differ from those of another on the same drive, where they differ most."""
    commands = commands_of(truth, 0)
    robots = [drive(commands, robot, truth.case.seconds, SILENT).recording for robot in (truth.plant, without)]
    pairs = zip(*(signals(recording) for recording in robots), strict=True)
    return max(float(np.quantile(np.abs(one - other), 0.99)) for one, other in pairs)


def bytes_of(path: Path) -> bytes:
    """All that a log says: channel names and messages."""
    return b"".join(event.channel.encode() + event.data for event in lcm.EventLog(str(path), "r"))


def test_the_generator_shares_no_code_with_the_model() -> None:
    allowed = ("cmr.msg", "cmr.recordings", "cmr.parameters.file", "cmr.plant")
    for path in GENERATOR:
        if path.name not in NOT_OF_PLANT:
            ours = {name for name in imports(path) if name.startswith("cmr")}
            assert all(name.startswith(allowed) for name in ours), (path.name, ours)


@pytest.mark.parametrize("manoeuvre", [RICH, *further(*(one for one in SECONDS if one != RICH))])
def test_the_same_case_gives_the_same_log_and_another_seed_or_run_another(tmp_path: Path, manoeuvre: str) -> None:
    cases = [{"seed": 3}, {"seed": 3}, {"seed": 4}, {"seed": 3, "run": 1}]
    logs = [
        hide("coulomb_friction", manoeuvre=manoeuvre, path=tmp_path / f"{number}.lcm", **case)
        for number, case in enumerate(cases)
    ]
    # The announced file carries the time at which it was written.
    first, again, other, further = (Recording.read(log.path) for log in logs)
    assert np.array_equal(first.poses["x"], again.poses["x"])
    assert np.array_equal(first.wheels["ticks_left"], again.wheels["ticks_left"])
    assert not np.array_equal(first.poses["x"], other.poses["x"])
    assert not np.array_equal(first.poses["x"], further.poses["x"])
    assert logs[0].truth.robot == logs[3].truth.robot != logs[2].truth.robot
    assert logs[0].truth.parameters == logs[3].truth.parameters


@pytest.mark.parametrize("manoeuvre", SECONDS)
def test_the_log_reads_as_the_recording_in_memory(tmp_path: Path, manoeuvre: str) -> None:
    log = hide("gyro_bias", manoeuvre=manoeuvre, seed=1, path=tmp_path / "run.lcm")
    read, made = Recording.read(log.path), hidden_recording("gyro_bias", manoeuvre=manoeuvre, seed=1).recording
    assert not read.rejected
    assert not read.damaged_bytes
    assert 110.0 < read.pieces.lengths.sum() < 130.0
    for name, signal in made.signals.items():
        assert np.array_equal(read.signals[name].utime, signal.utime)
        for field, values in signal.fields.items():
            assert np.array_equal(read.signals[name][field], values, equal_nan=True), (name, field)


def test_the_log_announces_the_wheel_radius_as_it_is_and_all_else_some_percent_off(tmp_path: Path) -> None:
    log = hide("wheel_radius_scale", seed=2, path=tmp_path / "run.lcm")
    announced = Recording.read(log.path).parameters
    assert announced is not None
    assert announced.effects == ()
    assert announced.value("wheel_radius") == pytest.approx(log.truth.robot["wheel_radius"], rel=1e-12)
    for name in ("k2_over_k3", "k1", "base_width"):
        assert 0.01 < abs(announced.value(name) / log.truth.robot[name] - 1.0) < 0.09, name


@pytest.mark.parametrize("name", ["coulomb_friction", "surface_patch", "side_wind"])
def test_nothing_of_the_truth_is_in_the_log(tmp_path: Path, name: str) -> None:
    log = hide(name, seed=5, path=tmp_path / "run.lcm")
    said = bytes_of(log.path)
    for secret in {name, *log.truth.parameters}:
        assert secret.encode() not in said, secret
    true = [*log.truth.parameters.values(), *(log.truth.robot[key] for key in ("k2_over_k3", "k1", "base_width"))]
    assert not any(repr(value).encode() in said for value in true)


@pytest.mark.parametrize("name", HIDDEN)
def test_what_is_hidden_shows_on_the_rich_drive_several_times_as_large_as_the_noise(name: str) -> None:
    truth = truth_of(Case((name,), RICH, seed=3))
    weakest = {"gyro_bias": 2.0, "gyro_drift": 2.0}.get(name, 3.0)  # they are there all the time
    assert difference(truth, truth.robot) > weakest


@pytest.mark.parametrize("kind", [*SOME_KINDS, *further(*(kind for kind in KINDS if kind not in SOME_KINDS))])
def test_physics_of_the_literature_shows_clearly_to_an_observer_who_knows_it(kind: str) -> None:
    assert visibility(truth_of(Case((kind,), RICH, seed=3))) > VISIBLE


@pytest.mark.parametrize("law", [law for law in FRICTIONS if law != "dry"])
@pytest.mark.parametrize("effect", ["coulomb_friction", "static_friction"])
def test_friction_by_another_law_moves_the_robot_otherwise(effect: str, law: str) -> None:
    truth = truth_of(Case((effect,), RICH, seed=3, friction=law))
    assert difference(truth, {**truth.robot, **truth.parameters}) > 1.5


def test_robots_differ_by_fifteen_percent_and_sizes_by_a_quarter_of_what_scales_with_the_robot() -> None:
    truths = [truth_of(Case(("coulomb_friction",), seed=seed)) for seed in range(200)]
    for name, typical in TYPICAL_ROBOT.items():
        share = [truth.robot[name] / typical for truth in truths]
        assert (min(share), max(share)) == pytest.approx((0.85, 1.15), abs=0.01)
    share = [truth.parameters["coulomb_friction"] / 4.0 / (truth.robot["k2_over_k3"] / 118.0) for truth in truths]
    assert (min(share), max(share)) == pytest.approx((0.75, 1.25), abs=0.01)


@pytest.mark.parametrize("effect", ["payload_change", "surface_change"])
def test_what_changes_at_a_time_does_so_in_the_middle_third(effect: str) -> None:
    times = [truth_of(Case((effect,), seed=seed)).parameters[f"{effect}_time"] for seed in range(50)]
    assert SECONDS[RICH] / 3.0 < min(times) < max(times) < SECONDS[RICH] * 2.0 / 3.0


@pytest.mark.parametrize("manoeuvre", [RICH, *further(*(one for one in SECONDS if one != RICH))])
def test_a_patch_lies_where_the_robot_crosses_it_several_times(manoeuvre: str) -> None:
    for seed in range(3):
        hidden = hidden_recording("surface_patch", manoeuvre=manoeuvre, seed=seed)
        x, y, radius = (hidden.truth.parameters[f"surface_patch_{name}"] for name in ("x", "y", "radius"))
        inside = np.hypot(hidden.motion["x"] - x, hidden.motion["y"] - y) < radius
        assert np.count_nonzero(inside[1:] & ~inside[:-1]) >= 3
        assert 0.05 < np.mean(inside) < 0.45


@pytest.mark.parametrize("effects", [(), ("turn_rate_limit",), ("static_friction",), ("pose_latency", "slope")])
def test_a_pilot_who_sees_the_robot_keeps_it_on_its_eights(effects: tuple[str, ...]) -> None:
    hidden = hidden_recording(*effects, manoeuvre=EIGHT, seed=8)
    place = hidden.motion["x"] + 1j * hidden.motion["y"]
    half_width = float(hidden.truth.case.random("driving", 0).uniform(0.8, 1.1, 2)[1])
    path = eight(half_width) @ np.array([1.0, 1j])
    off = np.abs(place[::SECOND, np.newaxis] - path[np.newaxis]).min(axis=1)
    assert off.max() < 0.25
    along = (place[::10] * np.exp(0.25j * np.pi)).real
    assert np.count_nonzero(np.diff(np.sign(along[np.abs(along) > 0.3]))) >= 7  # from one lobe to the other
    rest = hidden.recording.commands["left"][[0, 100, -100, -1]]
    assert not rest.any()


@pytest.mark.parametrize("manoeuvre", SHORT_SECONDS)
def test_short_drives_are_short_and_turn_both_ways(manoeuvre: str) -> None:
    hidden = hidden_recording(manoeuvre=manoeuvre, seed=8)
    assert hidden.recording.wheels.seconds[-1] == pytest.approx(SHORT_SECONDS[manoeuvre], abs=0.1)
    assert SHORT_SECONDS[manoeuvre] <= 60.0
    assert hidden.motion["w"].min() < -0.3
    assert hidden.motion["w"].max() > 0.3


@pytest.mark.parametrize("seed", range(3))
def test_the_short_drive_is_over_within_its_minute_on_two_metres(seed: int) -> None:
    recording = hidden_recording(manoeuvre=BRIEF, seed=seed).recording
    assert not np.any([recording.commands[side][-25:] for side in ("left", "right")])
    assert max(np.abs(recording.poses[name]).max() for name in ("x", "y")) < 1.0  # m
    assert np.abs(recording.poses["x"]).max() > 0.2


def test_open_loop_eights_turn_both_ways_and_rest_at_both_ends() -> None:
    hidden = hidden_recording(manoeuvre=EIGHT_OPEN, seed=8)
    assert hidden.motion["w"].min() < -0.3
    assert hidden.motion["w"].max() > 0.3
    assert not hidden.recording.commands["left"][[0, -1]].any()


def test_noise_is_three_times_as_large_where_that_is_asked_for() -> None:
    quiet, loud = (hidden_recording(noise=noise, seed=1).recording for noise in ("realistic", "threefold"))
    resting = slice(0, 2 * SECOND)
    assert loud.gyro["yaw_rate"][resting].std() == pytest.approx(3.0 * quiet.gyro["yaw_rate"][resting].std(), rel=1e-6)


def test_a_coarse_encoder_gives_whole_steps_of_its_disc() -> None:
    assert not np.any(hidden_recording(noise="coarse", seed=1).recording.wheels["ticks_left"] % 10.0)


def test_names_that_nobody_knows_are_refused() -> None:
    for case in ({"effects": ("gremlins",)}, {"manoeuvre": "waltz"}, {"noise": "none"}, {"friction": "butter"}):
        with pytest.raises(ValueError, match="there are"):
            Case(**case)


def test_the_sets_hold_what_is_to_be_reached_and_no_case_twice() -> None:
    cases = {name: cases_of(sets.SEEDS) for name, cases_of in sets.SETS.items()}
    assert len(cases["single"]) == len(cases["eight"]) == 20 * len(sets.WITH_DUTIES)
    assert len(cases["null"]) == 300
    assert {(case.manoeuvre, case.noise) for case in cases["null"]} == {
        (manoeuvre, noise) for manoeuvre in (RICH, EIGHT) for noise in sets.NULL_NOISES
    }
    assert len(cases["short"]) == 120
    assert {case.manoeuvre for case in cases["short"]} == set(SHORT_SECONDS)
    assert {case.manoeuvre for case in cases["brief"]} == {BRIEF}
    assert {case.effects for case in cases["brief"]} == {case.effects for case in cases["single"]}
    assert len(cases["pairs"]) == 100
    assert {case.manoeuvre for case in cases["windows"]} == {WINDOWS, CONTROLLED_WINDOWS}
    assert {case.effects[-1] for case in cases["windows"]} == {"pose_latency"}
    assert {case.effects[0] for case in cases["unknown"]} == set(UNKNOWN)
    assert len(UNKNOWN) >= 8
    for name, own in cases.items():
        assert len(set(own)) == len(own), name
    assert cases["hours"][0].seconds > 2.0 * 3600.0


def test_no_physics_of_the_unknown_kind_is_an_effect_of_the_catalogue() -> None:
    parameters = {name for effect in TYPICAL.values() for name in effect}
    assert not set(UNKNOWN) & set(TYPICAL)
    assert not {name for kind in UNKNOWN.values() for name in kind} & parameters
    assert math.isfinite(sum(size for kind in UNKNOWN.values() for size in kind.values()))
