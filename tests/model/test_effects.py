"""The catalogue: complete entries with the interface's names, and equations that hold what the entries promise."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cmr.model.catalogue import (
    CATALOGUE,
    DEFINITIONS,
    catalogue_of,
    definitions_of,
    effects_on,
    typical,
    with_effects,
)
from cmr.model.effect import Effect
from cmr.model.extended.compose import compose
from cmr.model.extended.model import drive as drive_extended
from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import ParameterDefinition, RobotParameters
from cmr.model.sensitivity import sensitivities
from cmr.model.sensors import read_sensors
from tests.support.documentation_blocks import DOCS, blocks_of
from tests.support.project import PROJECT

OWN_EFFECT = PROJECT / "docs" / "effect_of_your_own.py"
ROBOT = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.161)
DT = 0.01
NAMES = """
battery_sag battery_drift saturation current_limit slew_limit deadband command_delay command_jitter command_loss
turn_rate_limit wheel_separation_error electrical_lag coulomb_friction static_friction quadratic_drag
motor_gain_asymmetry back_emf_asymmetry
motor_heating motor_coupling backlash payload_change wheel_radius_scale wheel_radius_asymmetry wheel_wobble turn_slip
travel_reduction
turn_asymmetry longitudinal_slip lateral_skid slope surface_change surface_patch encoder_scale encoder_asymmetry
encoder_quantisation wheel_speed_latency gyro_bias gyro_scale gyro_drift gyro_latency pose_latency clock_skew
pose_smoothing pose_offset pose_offset_lateral pose_distortion pose_heading_offset
"""
EFFECTS = list(CATALOGUE.values())
MOTION = [effect for effect in EFFECTS if not effect.is_sensor]
SENSORS = [effect for effect in EFFECTS if effect.is_sensor]


def named(effect: Effect) -> str:
    return effect.name


def wild_duties(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps, reversals, rest and slow ramps: something of everything that an effect may wait for."""
    t = np.arange(steps) * DT
    left = 0.7 * np.sign(np.sin(5.0 * t)) * (np.sin(0.9 * t) > -0.5)
    return left, np.where(np.sin(1.3 * t) > 0.3, left, 0.4 * np.sin(2.0 * t))


def driven(parameters: RobotParameters, time: float = 0.0) -> Trajectory:
    return drive(*wild_duties(400), np.full(400, DT), parameters, RobotState.at_rest(), time=time)


def test_the_catalogue_has_all_effects_of_the_interface() -> None:
    assert sorted(CATALOGUE) == sorted(re.findall(r"\w+", NAMES))


@pytest.mark.parametrize("effect", EFFECTS, ids=named)
def test_every_entry_is_complete(effect: Effect) -> None:
    assert effect.equations
    assert effect.needs
    assert effect.shows_in
    assert set(effect.confused_with) <= set(CATALOGUE) - {effect.name}
    names = [parameter.name for parameter in effect.parameters]
    assert names == [effect.name] or all(name.startswith(f"{effect.name}_") for name in names)
    for parameter in effect.given:
        assert parameter.meaning
        assert parameter.unit
        assert parameter.name.startswith(f"{effect.name}_")
        assert not parameter.switches
    for parameter in effect.parameters:
        assert parameter.meaning
        assert parameter.unit
        assert parameter.neutral is not None
        assert parameter.typical is not None
        assert parameter.allows(parameter.typical)
        assert parameter.allows(parameter.neutral)
        assert not parameter.switches or not parameter.is_neutral(parameter.typical)


@pytest.mark.parametrize("effect", EFFECTS, ids=named)
def test_every_cause_is_a_sentence_with_every_size_in_it(effect: Effect) -> None:
    sentence = effect.sentence(typical(effect))
    assert re.fullmatch(r"[A-Z][^{}]*\.", sentence)
    for parameter in effect.parameters:
        if parameter.switches:
            assert f"{{{parameter.name}:" in effect.cause


def test_a_limit_of_commanded_turns_counts_by_the_width_that_commands_are_made_with() -> None:
    """Wheels that are told to turn a body of 0.16 m at 1 rad/s are limited as such, however it turns on the ground."""
    own = with_effects(ROBOT, {"turn_rate_limit": 1.0})
    sliding = ROBOT._replace(base_width=2.0 * ROBOT.base_width)
    told = with_effects(sliding, {"turn_rate_limit": 1.0, "turn_rate_limit_base_width": ROBOT.base_width})
    assert np.array_equal(driven(told).psi_right, driven(own).psi_right)
    assert not np.array_equal(driven(with_effects(sliding, {"turn_rate_limit": 1.0})).psi_right, driven(own).psi_right)


def test_a_cause_names_the_direction() -> None:
    gyro = CATALOGUE["gyro_bias"]
    assert gyro.sentence({"gyro_bias": 0.01}) == "The gyro reads 0.0100 rad/s too high."
    assert gyro.sentence({"gyro_bias": -0.01}) == "The gyro reads 0.0100 rad/s too low."


@pytest.mark.parametrize("effect", MOTION, ids=named)
def test_every_effect_on_the_motion_changes_the_motion_and_its_neutral_value_does_not(effect: Effect) -> None:
    plain = driven(ROBOT)
    neutral = {parameter.name: parameter.neutral for parameter in effect.parameters}
    for values, reference in zip(driven(with_effects(ROBOT, neutral)), plain, strict=True):
        assert np.array_equal(values, reference)
    early = {name: 1.0 if name.endswith("_time") else size for name, size in typical(effect).items()}
    at_hand = {name: 0.1 if name.endswith(("patch_x", "patch_y")) else size for name, size in early.items()}
    changed = driven(with_effects(ROBOT, at_hand))
    assert np.hypot(changed.x - plain.x, changed.y - plain.y).max() > 1e-4
    assert all(np.all(np.isfinite(values)) for values in changed)


@pytest.mark.parametrize("effect", SENSORS, ids=named)
def test_every_effect_on_sensors_changes_readings_and_not_the_motion(effect: Effect) -> None:
    motion = driven(with_effects(ROBOT, typical(effect)))
    for values, reference in zip(motion, driven(ROBOT), strict=True):
        assert np.array_equal(values, reference)
    time = np.arange(len(motion.x)) * DT
    neutral = {parameter.name: parameter.neutral for parameter in effect.parameters}
    true, off, on = (
        read_sensors(time, motion, parameters, time, time, time)
        for parameters in (ROBOT, with_effects(ROBOT, neutral), with_effects(ROBOT, typical(effect)))
    )
    assert all(np.array_equal(a, b) for a, b in zip(true, off, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(true, on, strict=True))


def test_candidates_without_effects_among_others_drive_the_papers_path_bit_for_bit() -> None:
    mixed = driven(with_effects(ROBOT, {"coulomb_friction": np.array([0.0, 4.0, 0.0])}))
    for values, reference in zip(mixed, driven(ROBOT), strict=True):
        assert np.array_equal(values[:, 0], reference)
        assert np.array_equal(values[:, 2], reference)
    assert not np.array_equal(mixed.x[:, 1], mixed.x[:, 0])


def test_the_extended_model_without_effects_is_the_papers() -> None:
    left, right = wild_duties(400)
    values = {name: np.array([value]) for name, value in ROBOT.values.items()}
    start = [np.zeros(1)] * 5
    recorded = drive_extended(left, right, np.full(400, DT), values, start, np.arange(401))[:, :, 0]
    for extended, paper in zip(recorded, driven(ROBOT), strict=True):
        # Both schemes are of fourth order; at 10 ms they are a nanometre a step apart where duties jump.
        assert extended == pytest.approx(paper, abs=1e-7)


COMPARE_WITHOUT = """
import sys
import numpy as np
from cmr.model.catalogue import CATALOGUE, typical
from cmr.model.extended.model import ExtendedModel, drive
motion = [effect for effect in CATALOGUE.values() if not effect.is_sensor]
values = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
for effect in motion:
    values |= typical(effect)
values |= {"payload_change_time": 0.1, "surface_change_time": 0.2, "surface_patch_x": 0.0, "surface_patch_y": 0.0}
t = np.arange(25) * 0.01
left, right = 0.9 * np.sign(np.sin(17.0 * t + 0.1)), 0.8 * np.sin(20.0 * t + 0.5)
def path(model, values):
    values = {name: np.array([value]) for name, value in values.items()}
    return drive(left, right, np.full(25, 0.01), values, [np.zeros(1)] * 5, np.arange(26), model=model)
everything = ExtendedModel(motion)
for name in sys.argv[1:]:
    gone = CATALOGUE[name]
    kept = {key: value for key, value in values.items() if key not in {p.name for p in gone.parameters}}
    neutral = {parameter.name: parameter.neutral for parameter in gone.parameters}
    without = path(ExtendedModel([effect for effect in motion if effect is not gone]), kept)
    assert np.array_equal(path(everything, {**kept, **neutral}), without), name
"""


@pytest.mark.slow
def test_a_neutral_effect_equals_a_catalogue_without_it_bit_for_bit_while_all_others_are_on(tmp_path: Path) -> None:
    # Without Numba, which would compile each of these models; the source is the same.
    names = [effect.name for effect in MOTION]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "XDG_CACHE_HOME": str(tmp_path), "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        [sys.executable, "-c", COMPARE_WITHOUT, *names], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_derivatives_of_a_drive_tell_what_a_change_of_the_parameters_does() -> None:
    steps = 300
    spans = (*wild_duties(steps), np.full(steps, DT))
    names = ["k1", "base_width", "lateral_skid", "command_delay"]
    parameters = with_effects(ROBOT, {"lateral_skid": 0.05, "quadratic_drag": 0.01})
    result = sensitivities(*spans, parameters, RobotState.at_rest(), names)
    for k, (name, change) in enumerate(
        [("k1", 1e-5), ("base_width", 1e-5), ("lateral_skid", 1e-4), ("command_delay", 1e-4)]
    ):
        value = parameters.values.get(name, 0.0)
        moved = drive(*spans, with_effects(parameters, {name: value + change}), RobotState.at_rest())
        predicted = result.motion.x + change * result.derivatives.x[:, k]
        shift = np.abs(moved.x - result.motion.x).max()
        assert np.abs(moved.x - predicted).max() < 0.02 * shift
    assert result.derivatives.psi_left[:, 1] == pytest.approx(0.0, abs=1e-6)  # wheels know nothing of the base width


def test_derivatives_at_infinity_and_by_unknown_names_are_refused() -> None:
    spans = (*wild_duties(5), np.full(5, DT))
    with pytest.raises(ValueError, match="current_limit is infinite"):
        sensitivities(*spans, ROBOT, RobotState.at_rest(), ["current_limit"])
    with pytest.raises(KeyError, match="wheel_wobbel"):
        sensitivities(*spans, ROBOT, RobotState.at_rest(), ["wheel_wobbel"])


def test_long_spans_are_integrated_as_finely_as_short_ones() -> None:
    parameters = with_effects(ROBOT, {"coulomb_friction": 4.0, "turn_slip": 0.03})
    coarse = drive([0.5, 0.2], [0.3, 0.6], [1.0, 0.7], parameters, RobotState.at_rest())
    duties = (np.repeat([0.5, 0.2], [100, 70]), np.repeat([0.3, 0.6], [100, 70]))
    fine = drive(*duties, np.full(170, DT), parameters, RobotState.at_rest(), at=[0, 100, 170])
    assert coarse.x == pytest.approx(fine.x, abs=1e-7)  # steps of 11.9 ms and of 10 ms


def test_effects_at_a_time_count_from_the_time_at_which_the_drive_begins() -> None:
    change = with_effects(ROBOT, {"payload_change_share": 0.5, "payload_change_time": 10.0})
    assert (
        np.array_equal(driven(change, time=0.0).x, driven(with_effects(ROBOT, {"motor_heating": 0.0}), time=0.0).x)
        is False
    )
    late = driven(change, time=20.0)
    always = driven(with_effects(ROBOT, {"payload_change_share": 0.5}))
    assert late.x == pytest.approx(always.x, abs=1e-12)


def test_parked_with_a_duty_below_break_away_a_robot_stays_where_it_is() -> None:
    parked = with_effects(ROBOT, {"coulomb_friction": 4.0, "static_friction": 14.0})
    duty = 0.99 * (4.0 + 14.0) / ROBOT.k2_over_k3
    path = drive(np.full(300, duty), np.full(300, duty), np.full(300, DT), parked, RobotState.at_rest())
    assert np.all(path.psi_left == 0.0)
    assert np.all(path.x == 0.0)
    free = drive(np.full(300, 1.1 * duty), np.full(300, 1.1 * duty), np.full(300, DT), parked, RobotState.at_rest())
    assert free.x[-1] > 0.1


def test_names_used_twice_are_refused() -> None:
    with pytest.raises(ValueError, match="battery_sag"):
        catalogue_of((CATALOGUE["battery_sag"], CATALOGUE["battery_sag"]))


def test_an_entry_with_an_unknown_stage_or_a_foreign_parameter_is_refused() -> None:
    shared = {"group": "sensors", "cause": "It is.", "needs": "-", "shows_in": "-"}
    with pytest.raises(ValueError, match="unknown stages warp"):
        Effect(name="a", equations={"warp": "x = 1.0"}, parameters=(), **shared)  # type: ignore[arg-type]
    foreign = ParameterDefinition("b", "-", "-", 0.0, 1.0, 0.0, 0.5)
    with pytest.raises(ValueError, match="must be called a_"):
        Effect(name="a", equations={}, parameters=(foreign,), **shared)  # type: ignore[arg-type]


def test_only_effects_that_are_switched_on_count_as_on() -> None:
    on = effects_on({"slope_x": 0.0, "slope_y": 0.4, "backlash": 0.0, "surface_patch_radius": 2.0})
    assert [effect.name for effect in on] == ["slope"]
    with pytest.raises(KeyError, match="slop; known: wheel_radius"):
        effects_on({"slop": 1.0})


OWN_EFFECT_IN_USE = """
import numpy as np
from cmr.model.catalogue import CATALOGUE, typical, with_effects
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import RobotParameters
robot = RobotParameters(0.04, 118.0, 0.054, 0.161)
push = with_effects(robot, {"side_brush_push": 0.02})
left = right = np.full(200, 0.4)
path = drive(left, right, np.full(200, 0.01), push, RobotState.at_rest())
assert abs(path.y[-1] - 0.02 * 2.0) < 1e-12  # 2 s straight ahead, pushed to the left all the time
fleet = Fleet(0.01)
fleet.add(RobotState.at_rest(), with_effects(robot, typical(CATALOGUE["side_brush"])))
fleet.command(0, 0.01, 0.01)  # below the brush's friction of 2 rad/s^2: 118 * 0.01 = 1.2
fleet.advance(100)
assert fleet.states(0).psi_left == 0.0
print(CATALOGUE["side_brush"].sentence({"side_brush_push": -0.02, "side_brush_friction": 2.0}))
"""


@pytest.mark.slow
def test_an_effect_of_your_own_lands_in_the_model_from_a_package_with_an_entry_point(tmp_path: Path) -> None:
    (tmp_path / "my_effects.py").write_text(OWN_EFFECT.read_text("utf-8"), "utf-8")
    package = tmp_path / "my_effects-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: my_effects\nVersion: 1.0\n", "utf-8")
    (package / "entry_points.txt").write_text("[cmr.effects]\nside_brush = my_effects:SIDE_BRUSH\n", "utf-8")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(PROJECT)]),
        "NUMBA_DISABLE_JIT": "1",
        "XDG_CACHE_HOME": str(tmp_path),
        "PYTHONWARNINGS": "ignore",
    }
    *_, shown = [block.text for block in blocks_of(DOCS / "how_to" / "add_an_effect.md") if block.language == "python"]
    done = subprocess.run(
        [sys.executable, "-c", OWN_EFFECT_IN_USE + shown], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    expected = "The brush pushes the robot to the right with 0.020 m/s and slows the wheels by 2.0 rad/s^2.\n"
    assert done.stdout == expected


@pytest.mark.slow
def test_the_model_knows_nobody_and_starts_cheaply() -> None:
    code = "import sys, cmr.model.motion, cmr.model.catalogue; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    for source in (PROJECT / "cmr" / "model").rglob("*.py"):
        for imported in re.findall(r"^from (cmr\.\w+)", source.read_text("utf-8"), re.MULTILINE):
            assert imported in ("cmr.model", "cmr.litter")  # which takes away what killed processes left


@pytest.mark.slow
def test_every_definition_is_found_by_its_name() -> None:
    assert all(name == definition.name for name, definition in DEFINITIONS.items())


@pytest.mark.slow
def test_a_statement_that_reads_an_unknown_name_is_refused_before_anything_is_compiled() -> None:
    misspelt = Effect(
        name="draught",
        group="wheels and ground",
        cause="There is a draught of {draught:.1f} m/s.",
        equations={"body": "sideways = sideways + draft"},
        parameters=(ParameterDefinition("draught", "m/s", "speed", 0.0, 1.0, 0.0, 0.1),),
        needs="-",
        shows_in="-",
    )
    with pytest.raises(ValueError, match="effect draught, stage body: nothing gives draft"):
        compose((misspelt,), definitions_of({"draught": misspelt}))


@pytest.mark.slow
def test_a_span_without_duration_changes_nothing() -> None:
    everything = {name: size for effect in MOTION for name, size in typical(effect).items()}
    for parameters in (ROBOT, with_effects(ROBOT, everything)):
        path = drive([0.5, 0.9, 0.5], [0.5, 0.1, 0.5], [0.2, 0.0, 0.1], parameters, RobotState.at_rest())
        whole = drive([0.5, 0.5], [0.5, 0.5], [0.2, 0.1], parameters, RobotState.at_rest())
        for values, reference in zip(path, whole, strict=True):
            assert values[1] == values[2] == reference[1]
            assert values[3] == pytest.approx(reference[2], abs=1e-12)
