"""What is recommended to be driven next can be driven, and shows what it is recommended for."""

import re
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.commands.robots import behaviour_of
from cmr.diagnosis.diagnose import _next
from cmr.diagnosis.next_experiment import (
    HOPELESS,
    PARTING,
    AnyDriver,
    Pilot,
    causes,
    drive_showing,
    experiment_to_explain,
    experiment_to_show,
    experiment_to_tell_apart,
    manoeuvres_giving,
    motions_in,
    telling_apart,
)
from cmr.diagnosis.words import REGRESSORS
from cmr.estimation.laws.result import Laws
from cmr.geometry.manoeuvres import MANOEUVRES, TYPICAL, in_sequence
from cmr.geometry.manoeuvres.in_words import WORDS, Pace
from cmr.model.catalogue import CATALOGUE, typical, with_effects
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import RobotParameters
from cmr.model.sensors import read_sensors
from cmr.world.behaviours.manoeuvring import DriveManoeuvre

pytestmark = pytest.mark.slow

PAIRS = [(effect.name, other, text) for effect in CATALOGUE.values() for other, text in effect.confused_with.items()]
# Advice that no drive can follow by itself: then both effects' needs are to be driven.
ADVICE = {
    "a finer encoder",
    "compare encoders with pose",
    "a gyro: it shows how late the readings of the wheels are",
    "compare wheels with commands",
    "compare wheels with commands: radii leave them in agreement",
    "look at the encoders",
}
SAME_MATHEMATICS = {"wheel_radius_scale", "encoder_scale"}
BESIDE_UNEQUAL_WHEELS = {"motor_gain_asymmetry", "encoder_asymmetry"}  # the same mathematics then
DT, COMMAND = 0.01, 0.02  # s
TICK_NOISE = 0.1  # rad/s over 50 ms, from 480 ticks per turn
GYRO_NOISE, POSITION_NOISE, HEADING_NOISE = 0.01, 0.007, 0.0074  # rad/s, m, rad
CLEARLY = 25.0  # squared standard deviations


def driven_by(sentence: str) -> DriveManoeuvre:
    """Return the behaviour of the command in a sentence."""
    [description] = re.findall(r"`cmr-pilot --robot \d+ --behaviour (\S+)`", sentence)
    behaviour, _pose = behaviour_of(description)
    assert isinstance(behaviour, DriveManoeuvre)
    return behaviour


@cache
def signals(manoeuvre: str, effect: str | None = None, moved: str | None = None) -> Any:
    """Return what all sensors say, in standard deviations, of a robot with an effect, or with one parameter moved.

    Wheel speeds and yaw rate 20 times a second, changes of the pose seen from the robot over 0.05 and 1 s.
    """
    robot = TYPICAL if moved is None else TYPICAL._replace(**{moved: 1.001 * getattr(TYPICAL, moved)})
    if effect is not None:
        robot = with_effects(robot, sizes(effect))
    duties = in_sequence(manoeuvre).duties()
    sent = np.arange(0.0, duties.duration, COMMAND)
    left, right = (np.repeat(duty, round(COMMAND / DT)) for duty in duties.at(sent))
    motion = drive(left, right, np.full(len(left), DT), robot, RobotState.at_rest())
    time = np.arange(len(motion.x)) * DT
    heard = time[::5]
    seen = read_sensors(time, motion, robot, heard, heard, heard)
    wheels = [np.diff(angle) / 0.05 / TICK_NOISE for angle in (seen.angle_left, seen.angle_right)]
    return np.concatenate([*wheels, seen.yaw_rate / GYRO_NOISE, *pose_changes(seen, 1), *pose_changes(seen, 20)])


def pose_changes(seen: Any, every: int) -> list[Any]:
    x, y, theta = (values[::every] for values in (seen.x, seen.y, seen.theta))
    dx, dy, cos, sin = np.diff(x), np.diff(y), np.cos(theta[:-1]), np.sin(theta[:-1])
    return [
        (dx * cos + dy * sin) / POSITION_NOISE,
        (dy * cos - dx * sin) / POSITION_NOISE,
        np.diff(theta) / HEADING_NOISE,
    ]


def sizes(effect: str) -> dict[str, float]:
    """Return an effect of typical size that happens early, or where the manoeuvres are driven."""
    values = typical(CATALOGUE[effect])
    here = {"surface_patch_x": 0.7, "surface_patch_y": 0.0}
    return {name: 12.0 if name.endswith("_time") else here.get(name, value) for name, value in values.items()}


def seen(manoeuvre: str, effect: str, *beside: str) -> float:
    """Return how much of an effect [squared standard deviations] neither the paper's parameters explain nor others."""
    plain = signals(manoeuvre)
    known = [signals(manoeuvre, moved=name) - plain for name in ("k2_over_k3", "k1", "base_width")]
    known += [signals(manoeuvre, other) - plain for other in beside]
    directions = np.array([direction for direction in known if np.any(direction)]).reshape(-1, len(plain)).T
    change = signals(manoeuvre, effect) - plain
    rest = change - directions @ np.linalg.lstsq(directions, change, rcond=1e-12)[0]
    return float(rest @ rest)


@pytest.mark.parametrize("name", CATALOGUE)
def test_what_an_effect_needs_is_a_manoeuvre(name: str) -> None:
    assert motions_in(CATALOGUE[name].needs)


@pytest.mark.parametrize(("name", "other", "text"), PAIRS, ids=[f"{a}-{b}" for a, b, _text in PAIRS])
def test_what_tells_two_effects_apart_is_a_manoeuvre_or_advice(name: str, other: str, text: str) -> None:
    hopeless = {name, other} in (SAME_MATHEMATICS, BESIDE_UNEQUAL_WHEELS) and text.startswith(HOPELESS)
    assert motions_in(text) or text in ADVICE or hopeless


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("spins on the spot", "spins"),
        ("circles at two speeds", "circles"),
        ("two speeds, both directions", "straight_runs"),
        ("reversals of different size", "steps"),
        ("big steps", "steps"),
        ("big steps on one side", "one_sided_steps"),
        ("multisine: a delay leaves no spread", "multisine"),
        ("slow ramps through zero", "ramps"),
        ("ramps, multisine", "ramps+multisine"),
        ("circles at two speeds, idle pauses", "circles+repeat_loop"),
        ("straight runs", "straight_runs"),
        ("a longer run", "repeat_loop"),
        ("repeat the loop", "repeat_loop"),
        ("cross it from several sides", "star"),
        ("a larger area", "star"),
        ("switch the brush off", "rich_drive"),
    ],
)
def test_the_shortest_manoeuvres_that_give_all_of_a_text_are_chosen(text: str, names: str) -> None:
    assert "+".join(manoeuvre.name for manoeuvre in manoeuvres_giving([text])) == names


# A scale of all distances shows in the length of a path, not in changes over a second.
@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - SAME_MATHEMATICS))
def test_an_effect_shows_in_what_is_recommended_to_show_it(name: str) -> None:
    assert seen(driven_by(experiment_to_show([name])).name, name) > CLEARLY


@pytest.mark.parametrize(
    ("name", "other"), [(a, b) for a, b, text in PAIRS if not text.startswith(HOPELESS)], ids=lambda name: name
)
def test_two_effects_differ_in_what_is_recommended_to_tell_them_apart(name: str, other: str) -> None:
    sentence = experiment_to_tell_apart(name, [other])
    assert sentence is not None
    assert seen(driven_by(sentence).name, name, other) > CLEARLY


@pytest.mark.parametrize("manoeuvre", ["figure_eight", "steps"])
def test_what_no_drive_distinguishes_is_the_same_in_what_would_be_recommended(manoeuvre: str) -> None:
    """Encoders that count apart, and wheels as far apart: the path and the readings of motors that are apart."""
    wheels = ("motor_gain_asymmetry", "wheel_radius_asymmetry")
    assert seen(manoeuvre, "encoder_asymmetry", *wheels) < CLEARLY < seen(manoeuvre, "encoder_asymmetry", wheels[0])
    said = str(experiment_to_tell_apart("motor_gain_asymmetry", ["encoder_asymmetry"]))
    assert said == (
        "No drive can distinguish motor gain asymmetry from encoder asymmetry: the same mathematics beside unequal "
        "wheels; turn both wheels by hand and compare their ticks. The simulation is the same with either."
    )


def test_what_is_the_same_as_what_was_named_is_not_said_to_be_visible_in_another_drive() -> None:
    """Beside unequal motors and wheels, as in the robot of cmr-demo, nothing shows encoders that count apart."""
    predictor = SimpleNamespace(segment=SimpleNamespace(observations=SimpleNamespace(pose=[0.0], gyro=[0.0])))
    unseen = ("backlash", "encoder_asymmetry")
    problem = SimpleNamespace(predictors=[predictor], effects=[CATALOGUE[name] for name in unseen])
    found = cast(Any, SimpleNamespace(problem=problem, unseen=unseen))
    unexplained = cast(Any, SimpleNamespace(signal=None))

    def said(*named: str) -> str:
        effects = cast(Any, [SimpleNamespace(name=name, next_experiment=None) for name in named])
        return str(_next(Pilot(), effects, found, unexplained, Laws()))

    assert said("motor_gain_asymmetry", "wheel_radius_asymmetry").startswith("Backlash would be visible in")
    assert said("gyro_bias").startswith("Backlash and encoder asymmetry would be visible in")


def test_limits_that_a_figure_eight_does_not_reach_are_shown_by_steps() -> None:
    assert experiment_to_show(["battery_sag", "saturation", "current_limit"]) == (
        "Battery sag, saturation and current limit would be visible in big steps and reversals near full duty. "
        "Record `cmr-pilot --robot 0 --behaviour manoeuvre,name=steps` (26 s, 0.8 m around the start), "
        "then diagnose both logs together."
    )


def test_one_drive_shows_most_of_many_effects_and_three_are_named() -> None:
    sentence = experiment_to_show([*CATALOGUE])
    assert driven_by(sentence).name == "short_drive"
    _, shown = drive_showing([*CATALOGUE])
    assert len(shown) > 0.8 * len(CATALOGUE)
    assert sentence.startswith(
        f"Command delay, coulomb friction, slope and {len(shown) - 3} other effects would be visible in"
    )
    assert (
        causes(["slope", "gyro_bias", "lateral_skid", "turn_slip"])
        == "slope, gyro bias, lateral skid and 1 other effect"
    )
    assert "Any effect would be visible in short movements of all kinds" in experiment_to_show([])
    assert "Any effect would be visible in a drive with something" in experiment_to_show([], AnyDriver(HUSKY))


def test_what_tells_apart_is_said_in_the_catalogues_words() -> None:
    assert experiment_to_tell_apart("command_delay", ["electrical_lag", "slew_limit"]) == (
        "To distinguish command delay from electrical lag: multisine, reversals; from slew limit: reversals of "
        "different size. Record `cmr-pilot --robot 0 --behaviour manoeuvre,name=multisine+steps` "
        "(49 s, 0.8 m around the start), then diagnose both logs together."
    )
    assert "from static friction and saturation: big steps." in str(
        experiment_to_tell_apart("battery_sag", ["static_friction", "saturation"])
    )


def test_what_nothing_explains_is_driven_again_and_by_itself_and_looked_at() -> None:
    assert experiment_to_explain("sideways", ["speed"]) == (
        "To find the cause of the errors of the sideways position, record the same drive again: errors that recur at "
        "the same time or place come from the robot, its commands or the floor, others from outside. "
        "Errors that depend on speed are clearest in straight runs forth and back at three speeds. "
        "Record `cmr-pilot --robot 0 --behaviour manoeuvre,name=straight_runs` (20 s, 1.3 m around the start), "
        "then diagnose both logs together. "
        "Look at the plot of the sideways position over speed in report.html: its shape is a clue to the cause."
    )
    assert "cmr-pilot" not in experiment_to_explain("yaw_rate", ["time"])
    both = experiment_to_explain("heading", ["x", "time", "yaw_rate", "y"], Pilot(3))
    assert driven_by(both).name == "spins+star"
    assert "Errors that depend on x position, yaw rate and y position are clearest" in both
    assert "over x position, time, yaw rate and y position" in both


def test_all_that_errors_may_go_with_stands_out_somewhere() -> None:
    assert set(PARTING) == set(REGRESSORS) - {"time"}
    assert set(PARTING.values()) <= set(MANOEUVRES)


def test_the_same_mathematics_is_said_and_nothing_is_recommended() -> None:
    said = experiment_to_tell_apart("wheel_radius_scale", ["encoder_scale"])
    assert said == (
        "No drive can distinguish wheel radius scale from encoder scale: the same mathematics, unless commands were "
        "recorded. The simulation is the same with either."
    )
    both = experiment_to_tell_apart("wheel_radius_scale", ["encoder_scale", "pose_distortion"])
    assert both is not None
    assert driven_by(both).name == "star"
    assert both.endswith(said)
    assert experiment_to_tell_apart("wheel_radius_scale", []) is None


def test_a_log_of_another_encoder_is_diagnosed_by_itself() -> None:
    said = experiment_to_tell_apart("deadband", ["encoder_quantisation"])
    assert said is not None
    assert "a finer encoder" in said
    assert driven_by(said).name == "ramps"
    assert said.endswith("then diagnose the new log.")


def test_effects_that_the_catalogue_does_not_pair_are_told_apart_by_what_both_need() -> None:
    assert telling_apart("slope", "gyro_bias") == "driving in all directions; rest"
    assert telling_apart("electrical_lag", "pose_latency") == CATALOGUE["pose_latency"].confused_with["electrical_lag"]
    assert driven_by(str(experiment_to_tell_apart("slope", ["gyro_bias"]))).name == "rest+star+rest"


def test_the_command_is_for_the_robot_at_hand() -> None:
    large = RobotParameters(wheel_radius=0.165, k2_over_k3=20.0, k1=0.165, base_width=1.0)
    said = experiment_to_show(["lateral_skid"], Pilot(7, large))
    circles = in_sequence("circles")
    assert "`cmr-pilot --robot 7 " in said
    assert f"({circles.duties(large).duration:.0f} s, {circles.space_for(large):.1f} m around the start)" in said


HUSKY = Pace(speed=1.0, turn_rate=1.3, width=0.54)
PACES = [HUSKY, Pace(), Pace.seen(0.15, 0.0, 0.084), Pace.seen(0.0, 2.0, 0.2), Pace.seen(3.1, 0.9, 1.7)]


def test_other_drivers_are_told_in_words_with_the_space_that_this_robot_needs() -> None:
    assert experiment_to_show(["lateral_skid"], AnyDriver(HUSKY)) == (
        "Lateral skid would be visible in circles of two radii both ways at two speeds. "
        "Drive two circles to the left and two to the right, 1 m radius: "
        "the first of each slowly (0.4 m/s), the second fast (1 m/s). "
        "This takes about 40 s and 2.5 m of free floor around the start. "
        "Record it like these drives, then diagnose it together with these recordings."
    )


@pytest.mark.slow
@pytest.mark.parametrize("pace", PACES)
def test_no_other_driver_is_told_of_a_command_or_to_drive_faster_farther_or_longer_than_it_can(pace: Pace) -> None:
    driver = AnyDriver(pace)
    apart = [experiment_to_tell_apart(a, [b], driver) for a, b, text in PAIRS if not text.startswith(HOPELESS)]
    shown = [experiment_to_show([name], driver) for name in CATALOGUE]
    explained = [experiment_to_explain("heading", [name], driver) for name in PARTING]
    for sentence in [experiment_to_show([*CATALOGUE], driver), *filter(None, apart), *shown, *explained]:
        assert "cmr-" not in sentence
        speeds = [float(speed) for speed in re.findall(r"([\d.]+) m/s", sentence)]
        assert all(0.0 < speed <= pace.speed for speed in speeds)
        (free,) = [float(number) for number in re.findall(r"([\d.]+) m of free floor", sentence)]
        lengths = re.findall(r"([\d.]+) m (?:straight|radius)", sentence)
        assert all(pace.width < free and float(length) < free for length in lengths)
        ((time, unit),) = re.findall(r"takes about (\d+) (s|minutes)", sentence)
        assert unit == "s" or int(time) <= 6


def test_every_manoeuvre_that_is_recommended_has_words() -> None:
    assert set(WORDS) == set(MANOEUVRES) - {"figure_eight", "chirp", "short_drive"}
    assert "figure_eight" not in {text for effect in CATALOGUE.values() for text in motions_in(effect.needs)}


def test_a_robot_that_never_turned_is_told_to_turn_all_the_same() -> None:
    pace = Pace.seen(speed=1.0, turn_rate=0.0, width=0.5)
    assert pace.fast_turn == 2.0  # wheels that turn against each other, half as fast as they were seen to


def test_of_many_rivals_three_are_told_apart() -> None:
    said = experiment_to_tell_apart("turn_slip", ["lateral_skid", "slope", "gyro_bias", "backlash"])
    assert said is not None
    assert "slope" in said
    assert "backlash" not in said


def test_an_unknown_effect_is_an_error() -> None:
    with pytest.raises(KeyError, match="witchcraft"):
        experiment_to_show(["witchcraft"])
    with pytest.raises(KeyError, match="witchcraft"):
        experiment_to_tell_apart("witchcraft", ["slope"])
