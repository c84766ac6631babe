"""The model's 10 ms step against the reference plant, which shares nothing with it and takes steps of 10 us."""

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmr.model.catalogue import CATALOGUE, LAWS
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters
from cmr.model.sensors import read_sensors
from cmr.recordings.signal import Floats
from tests.reference_plant import NEUTRAL, TYPICAL, Commands, packets
from tests.reference_plant import drive as drive_plant
from tests.reference_plant.drives import NOMINAL_TICKS, true_motion
from tests.reference_plant.manoeuvres import figure_eight, in_turn, multisine, reversals
from tests.support.lanes import further

pytestmark = pytest.mark.slow

SPAN = 0.01  # s
PAPER = {name: float(getattr(NEUTRAL, name)) for name in ("wheel_radius", "k2_over_k3", "k1", "base_width")}
# What effects do by chance differs from the plant's chance: another test compares what many drives have in common.
RANDOM = ("command_jitter", "command_loss")
OF_MOTION = [name for name, effect in CATALOGUE.items() if not effect.is_sensor and name not in RANDOM]
TOGETHER = [
    ("command_delay", "slew_limit", "electrical_lag"),
    ("deadband", "turn_rate_limit"),
    ("battery_sag", "coulomb_friction", "static_friction"),
    ("battery_drift", "motor_heating", "back_emf_asymmetry"),
    ("battery_sag", "saturation", "motor_gain_asymmetry"),
    ("current_limit", "motor_coupling", "payload_change"),
    ("motor_coupling", "coulomb_friction"),
    ("quadratic_drag", "slope", "surface_patch"),
    ("backlash", "longitudinal_slip", "wheel_wobble"),
    ("wheel_radius_scale", "wheel_radius_asymmetry", "surface_change"),
    ("turn_slip", "turn_asymmetry", "lateral_skid"),
]

# Pairs that the model means otherwise than the plant, and how far [m] that leads on the reversals. It decides whether a
# wheel sticks before it adds what the other side's acceleration does to that wheel; and it counts the angle of the
# wobble at the shaft, not at the wheel, which the backlash lets lag.
APART = {
    frozenset({"motor_coupling", "static_friction"}): 1e-3,
    frozenset({"motor_coupling", "coulomb_friction"}): 1e-3,
    frozenset({"motor_coupling", "surface_patch"}): 2e-4,
    frozenset({"backlash", "wheel_wobble"}): 2e-3,
}


class Course(NamedTuple):
    """Commands to compare on, by how much the path may be off [m], and the moment of effects that set in [s]."""

    commands: Commands
    seconds: float
    tolerance: float
    moment: float


# A step of 10 ms meets a kink (a start, a reversal, a limit reached) inside it: the wheel is then off by the change of
# its acceleration over the step, some 600 rad/s^3, times h^2 / 8, so 8e-3 rad/s. It forgets that in 0.16 s, 1.3e-3 rad
# or 5e-5 m later, with a heading off by 3e-4 rad. The reversals have 14 kinks on each side, with any sign, on 0.9 m:
# 3e-4 sqrt(28) 0.9 m = 1.4 mm.
COURSES = {
    "figure eight": Course(packets(figure_eight(120.0, 6), 120.0), 120.0, 1e-3, 60.0037),
    "short figure eight": Course(packets(figure_eight(40.0, 2), 40.0), 40.0, 1e-3, 20.0037),
    "reversals": Course(packets(reversals(0.8, (1.0, 0.6)), 13.2), 13.2, 2e-3, 5.0037),
}
BRIEF = packets(in_turn([(1.0, reversals(0.7, (0.15,))), (1.0, multisine(1.0, -0.5, 0.6))]), 2.0)


def sizes(effects: tuple[str, ...], course: Course) -> dict[str, float]:
    """Typical sizes of effects; what sets in does so within a step of this course."""
    values = {name: value for effect in effects for name, value in TYPICAL[effect].items()}
    return {name: course.moment if name.endswith("_time") else value for name, value in values.items()}


def borders(seconds: float, span: float = SPAN) -> Floats:
    """Times between the spans of a drive [s]."""
    return np.arange(round(seconds / span) + 1, dtype=np.float64) * span


def duties(commands: Commands, seconds: float, span: float = SPAN) -> tuple[Floats, Floats]:
    """The duties in force during each span."""
    index = np.searchsorted(commands.time, borders(seconds, span)[:-1] + 0.5 * span) - 1
    return commands.left[index], commands.right[index]


def modelled(
    commands: Commands, seconds: float, effects: Mapping[str, object], seed: int = 0, span: float = SPAN
) -> Trajectory:
    """What the model drives in steps of one span."""
    left, right = duties(commands, seconds, span)
    spans = np.full(len(left), span)
    return drive(left, right, spans, RobotParameters.of({**PAPER, **effects}), RobotState.at_rest(), seed=seed)


def error(model: Trajectory, truth: Mapping[str, Floats]) -> float:
    """The largest distance [m] between the paths, or between the ways of the wheels' shafts."""
    path = np.hypot(model.x - truth["x"], model.y - truth["y"]).max()
    shafts = [np.abs(model.angle_left - truth["phi_left"]).max(), np.abs(model.angle_right - truth["phi_right"]).max()]
    return float(max(path, *(PAPER["wheel_radius"] * shaft for shaft in shafts)))


def check(effects: tuple[str, ...], name: str) -> None:
    course = COURSES[name]
    values = sizes(effects, course)
    # Steps of the plant that are ten times shorter move the path by 2e-8 m at most.
    truth = true_motion(course.commands, values, borders(course.seconds), step=1e-4)
    assert error(modelled(course.commands, course.seconds, values), truth) < course.tolerance


@cache
def plain(name: str) -> Trajectory:
    return modelled(COURSES[name].commands, COURSES[name].seconds, {})


def shift(effect: str, name: str) -> float:
    """How far an effect moves the path of a course [m]."""
    course = COURSES[name]
    moved = modelled(course.commands, course.seconds, sizes((effect,), course))
    return float(np.hypot(moved.x - plain(name).x, moved.y - plain(name).y).max())


def test_the_papers_model_is_within_1e7_m_of_the_truth_after_a_minute_of_figure_eights() -> None:
    commands = packets(figure_eight(60.0, 3), 60.0)
    assert error(modelled(commands, 60.0, {}), true_motion(commands, {}, borders(60.0))) < 1e-7


def test_the_plant_knows_every_effect_of_the_catalogue_by_the_same_names_of_parameters() -> None:
    effects = {name: effect for name, effect in CATALOGUE.items() if name not in LAWS}  # other tests learn some
    assert set(TYPICAL) == set(effects)
    for effect in effects.values():
        assert set(TYPICAL[effect.name]) == {parameter.name for parameter in effect.parameters}
        for parameter in effect.parameters:
            if parameter.switches:
                neutral = getattr(NEUTRAL, parameter.name)
                assert neutral == parameter.neutral, parameter.name


@pytest.mark.parametrize("course", [*further("figure eight"), "reversals"])
@pytest.mark.parametrize("effect", OF_MOTION)
def test_the_model_stays_with_the_truth_with_each_effect_switched_on(effect: str, course: str) -> None:
    check((effect,), course)


@pytest.mark.parametrize("course", ["short figure eight", "reversals"])
@pytest.mark.parametrize("effects", TOGETHER, ids="+".join)
def test_the_model_stays_with_the_truth_with_several_effects_at_once(effects: tuple[str, ...], course: str) -> None:
    check(effects, course)


@pytest.mark.parametrize("effect", [*OF_MOTION[1::2], *further(*OF_MOTION[2::2])])
def test_with_short_steps_model_and_plant_mean_the_same_by_every_pair_of_effects(effect: str) -> None:
    course = COURSES["reversals"]
    # A tenth of the step leaves a hundredth of the errors at kinks: 1.4e-5 m, for two effects some times that.
    short = 1e-3
    others = OF_MOTION[: OF_MOTION.index(effect)]
    pairs = [sizes((effect, other), course) for other in others]
    # The model drives all pairs at once: to each robot the effects of the others are neutral.
    names = {name for values in pairs for name in values}
    each = {name: np.array([values.get(name, getattr(NEUTRAL, name)) for values in pairs]) for name in names}
    moved = modelled(course.commands, course.seconds, each, span=short)
    for k, (other, values) in enumerate(zip(others, pairs, strict=True)):
        truth = true_motion(course.commands, values, borders(course.seconds, short), step=2e-4)
        difference = error(Trajectory(*(column[:, k] for column in moved)), truth)
        assert difference < APART.get(frozenset({effect, other}), 6e-5), other


@pytest.mark.parametrize("effect", OF_MOTION)
def test_each_effect_moves_the_path_further_than_the_model_may_be_off(effect: str) -> None:
    assert any(shift(effect, name) > 1.5 * course.tolerance for name, course in COURSES.items())


@pytest.mark.parametrize("effect", RANDOM)
def test_effects_of_chance_move_the_wheels_as_the_plants_do_on_average_and_in_spread(effect: str) -> None:
    seconds, draws = 6.0, 150
    commands = packets(multisine(1.0, 1.0, 0.6), seconds, rate=1.0 / SPAN)
    ours = [modelled(commands, seconds, TYPICAL[effect], seed).psi_left for seed in range(draws)]
    theirs = [
        true_motion(commands, TYPICAL[effect], borders(seconds), step=1e-3, seed=seed)["psi_left"]
        for seed in range(draws)
    ]
    spread = np.sqrt(np.var(ours, axis=0) + np.var(theirs, axis=0))
    # Standard errors; wheels also differ by what a 1 ms step of the plant leaves, some 1e-6 rad/s.
    assert np.all(np.abs(np.mean(ours, axis=0) - np.mean(theirs, axis=0)) < 5.0 * spread / np.sqrt(draws) + 1e-4)
    # Some 40 independent moments (0.16 s each) of 150 drives: their mean variance is known to 2 %, twice.
    assert np.mean(np.var(ours, axis=0)) == pytest.approx(np.mean(np.var(theirs, axis=0)), rel=0.1)


def test_a_fleet_drives_each_robot_as_a_drive_with_its_parameters() -> None:
    course = COURSES["reversals"]
    robots: list[dict[str, float]] = [{}, *(sizes((effect,), course) for effect in OF_MOTION)]
    fleet = Fleet(SPAN)
    for values in robots:
        fleet.add(RobotState.at_rest(), RobotParameters.of({**PAPER, **values}))
    left, right = duties(course.commands, course.seconds)
    for k in range(len(left)):
        fleet.command(slice(0, len(robots)), left[k], right[k])
        fleet.advance()
    together = fleet.states()
    for index, values in enumerate(robots):
        alone = modelled(course.commands, course.seconds, values)
        distance = np.hypot(together.x[index] - alone.x[-1], together.y[index] - alone.y[-1])
        assert distance < 1e-9, values


@pytest.mark.parametrize("effect", OF_MOTION)
def test_an_effect_that_is_next_to_nothing_leaves_the_papers_path(effect: str) -> None:
    barely = {
        p.name: TYPICAL[effect][p.name] if not p.switches or p.neutral is None else next_to(p.neutral)
        for p in CATALOGUE[effect].parameters
    }
    ours, papers = modelled(BRIEF, 2.0, barely), modelled(BRIEF, 2.0, {})
    # A share of 1e-9 of what is some metres, rad/s or rad at most.
    assert np.hypot(ours.x - papers.x, ours.y - papers.y).max() < 1e-7


def next_to(neutral: float) -> float:
    """A value that has hardly an effect."""
    return 1e9 if np.isinf(neutral) else neutral - 1e-9 if neutral == 1.0 else 1e-9


def readings(effects: Mapping[str, float]) -> tuple[Floats, Floats]:
    """What the plant's sensors say, and the model's: columns angle_left, angle_right, yaw_rate, x, y, theta."""
    course = COURSES["short figure eight"]
    recorded = drive_plant(course.commands, effects, course.seconds, step=1e-4).recording
    wheels, gyro, poses = recorded.wheels, recorded.gyro, recorded.poses
    theirs = [wheels[f"ticks_{side}"] * (2.0 * np.pi / NOMINAL_TICKS) for side in ("left", "right")]
    theirs += [gyro["yaw_rate"], poses["x"], poses["y"], poses["theta"]]
    parameters = RobotParameters.of({**PAPER, **effects})
    motion = modelled(course.commands, course.seconds, effects)
    ours = read_sensors(borders(course.seconds), motion, parameters, wheels.seconds, gyro.seconds, poses.seconds)
    # Poses come at 25 Hz, the others at 100 Hz: brought to one length, each value repeated.
    shape = len(wheels)
    columns = [np.repeat(column, -(-shape // len(column)))[:shape] for column in (*theirs, *ours)]
    return np.column_stack(columns[:6]), np.column_stack(columns[6:])


# Model and plant differ by 2e-7 rad (plant's steps of 0.1 ms). The model knows the motion every 10 ms: the yaw rate
# between is off by a fourth of that times the jump of the yaw acceleration with a command, 0.04 rad/s^2; poses are
# interpolated, off by an eighth of its square times the acceleration, 0.5 m/s^2 and 0.5 rad/s^2.
READING_TOLERANCE = np.array([1e-6, 1e-6, 1.1e-4, 1e-5, 1e-5, 1e-5])
# The plant filters straight lines between its poses, which are 0.04 s apart: off by a twelfth of its square times the
# acceleration in the mean.
FILTER_TOLERANCE = np.array([0.0, 0.0, 0.0, *[0.04**2 / 12.0 * 0.5] * 3])


@pytest.mark.parametrize("effect", [name for name, effect in CATALOGUE.items() if effect.is_sensor])
def test_the_models_sensors_say_what_the_plants_sensors_say(effect: str) -> None:
    # Not whole steps of the model where the effect is a time.
    values = {name: 0.83 * value if "latency" in name else value for name, value in TYPICAL[effect].items()}
    theirs, ours = readings(values)
    differences = ours - theirs
    without, _ = readings({})
    changes = theirs - without
    for one in (differences, changes):
        one[:, 5] = np.remainder(one[:, 5] + np.pi, 2.0 * np.pi) - np.pi
    tolerance = READING_TOLERANCE + (FILTER_TOLERANCE if effect == "pose_smoothing" else 0.0)
    assert np.max(np.abs(changes).max(axis=0) / tolerance) > 30.0
    assert np.all(np.abs(differences).max(axis=0) < tolerance)


names = st.sampled_from([name for name, effect in CATALOGUE.items() if not effect.is_sensor])


def switched_off(effect: str) -> dict[str, float]:
    """The effect at its neutral value; a time, a place or a phase means nothing then."""
    parameters = CATALOGUE[effect].parameters
    return {p.name: TYPICAL[effect][p.name] if p.neutral is None or not p.switches else p.neutral for p in parameters}


@settings(max_examples=60, deadline=None)
@given(st.sets(names, max_size=4), st.sets(names))
def test_effects_at_their_neutral_values_leave_every_bit_of_the_path(on: set[str], off: set[str]) -> None:
    values = {name: value for effect in sorted(on) for name, value in TYPICAL[effect].items()}
    neutral = {name: value for effect in sorted(off - on) for name, value in switched_off(effect).items()}
    without, with_neutral = modelled(BRIEF, 2.0, values), modelled(BRIEF, 2.0, {**neutral, **values})
    for before, after in zip(without, with_neutral, strict=True):
        assert np.array_equal(before, after)


@settings(max_examples=30, deadline=None)
@given(st.sets(names, min_size=1, max_size=3))
def test_a_robot_without_effects_drives_the_papers_path_beside_robots_that_have_them(on: set[str]) -> None:
    values = {
        name: np.array([switched_off(effect)[name], value])
        for effect in sorted(on)
        for name, value in TYPICAL[effect].items()
    }
    beside, alone = modelled(BRIEF, 2.0, values), modelled(BRIEF, 2.0, {})
    for one, other in zip(beside, alone, strict=True):
        assert np.array_equal(one[:, 0], other)
