"""Manoeuvres excite what they say, in the time and space they say."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from cmr.geometry.manoeuvres import MANOEUVRES, TYPICAL, help_text, in_sequence
from cmr.geometry.manoeuvres.pieces import FREQUENCIES, PERIOD, SIGNS
from cmr.model.body import forward, turn
from cmr.model.motion import Trajectory
from cmr.model.parameters import RobotParameters
from tests.geometry.driven_manoeuvres import DT, LARGE, SMALL, duties_of, motion_of

NAMES = pytest.mark.parametrize("name", MANOEUVRES)


def furthest(motion: Trajectory) -> float:
    return float(np.hypot(motion.x, motion.y).max())


def levels(values: Any, around: float = 0.05) -> list[float]:
    """Return the values [any unit] at which a signal stays, ascending: local plateaus, told apart by `around`."""
    flat = values[1:][np.abs(np.diff(values)) < 1e-4 * np.abs(values).max()]
    found: list[float] = []
    for value in np.sort(flat):
        if not found or value - found[-1] > around * np.abs(values).max():
            found.append(float(value))
    return found


@NAMES
def test_every_manoeuvre_starts_and_ends_at_rest_and_leaves_the_motors_something(name: str) -> None:
    time, left, right = duties_of(name)
    for duty in (left, right):
        assert np.abs(duty).max() <= 0.9
        assert np.all(duty[time < 1.0] == 0.0)
        assert np.all(duty[time > time[-1] - 1.0] == 0.0)
    motion = motion_of(name)
    assert max(abs(motion.psi_left[-1]), abs(motion.psi_right[-1])) < 0.01


@NAMES
@pytest.mark.parametrize("robot", [TYPICAL, SMALL, LARGE], ids=["typical", "small", "large"])
def test_every_manoeuvre_stays_in_its_space_and_comes_back(name: str, robot: RobotParameters) -> None:
    motion, space = motion_of(name, robot), MANOEUVRES[name].space_for(robot)
    assert furthest(motion) < 0.9 * space
    assert math.hypot(motion.x[-1], motion.y[-1]) < 0.1 * max(space, 1.0)


@NAMES
@pytest.mark.parametrize(
    ("believed", "gains"),
    [
        (TYPICAL._replace(k1=1.3 * TYPICAL.k1, base_width=1.3 * TYPICAL.base_width), (1.0, 1.0)),
        (TYPICAL._replace(k1=0.7 * TYPICAL.k1, base_width=0.7 * TYPICAL.base_width), (1.0, 1.0)),
        (TYPICAL, (1.03, 0.97)),
    ],
    ids=["slower", "faster", "crooked"],
)
def test_a_robot_that_is_not_as_believed_stays_there_too(
    name: str, believed: RobotParameters, gains: tuple[float, float]
) -> None:
    motion = motion_of(name, TYPICAL, believed=believed, gains=gains)
    assert furthest(motion) < MANOEUVRES[name].space_for(believed)


def test_the_space_is_used() -> None:
    """A space far larger than needed would keep people from driving."""
    for name, manoeuvre in MANOEUVRES.items():
        assert furthest(motion_of(name)) > 0.4 * manoeuvre.space or manoeuvre.space <= 0.3


def test_durations_are_as_the_help_says() -> None:
    lines = {line.split()[0]: line for line in help_text().splitlines() if line[2] != " "}
    assert lines.keys() == MANOEUVRES.keys()
    for name, line in lines.items():
        assert float(line.split()[1]) == pytest.approx(duties_of(name)[0][-1], abs=0.5)
    assert 110.0 < duties_of("rich_drive")[0][-1] < 130.0
    assert duties_of("repeat_loop")[0][-1] > 180.0


@NAMES
def test_only_steps_jump_and_they_take_a_twentieth_of_a_second(name: str) -> None:
    duties = MANOEUVRES[name].duties()
    steepest = max(np.abs(np.diff(side) / np.diff(duties.time)).max() for side in (duties.left, duties.right))
    fastest = {"steps": 36.0, "one_sided_steps": 32.0, "rich_drive": 36.0, "multisine": 20.0, "chirp": 16.0}  # duty/s
    fastest["short_drive"] = 36.0
    assert steepest <= fastest.get(name, 6.0) * (1.0 + 1e-9)


def test_a_chirp_has_all_frequencies_of_its_words_one_after_the_other() -> None:
    duties = MANOEUVRES["chirp"].duties()
    first = (duties.time > 1.0) & (duties.time < 11.0)  # the first of four, after the rest at the beginning
    assert np.array_equal(duties.left[first], duties.right[first])
    wave = duties.left[first]
    crossings = np.append(1.0, duties.time[first][1:][np.diff(np.sign(wave)) != 0.0])
    halves = np.diff(crossings[crossings < 10.9])  # s; at the end the wave fades out
    assert np.all(np.diff(halves) < 0.011)  # ever shorter, but for knots of 5 ms
    assert 0.5 / halves[[0, -1]] == pytest.approx([0.31, 3.8], rel=0.1)
    last = duties.time > duties.duration - 12.0
    assert np.array_equal(duties.left[last], -duties.right[last])


def test_straight_runs_go_both_ways_at_three_speeds_and_never_turn() -> None:
    motion = motion_of("straight_runs")
    speeds = levels(forward(motion.psi_left, motion.psi_right, TYPICAL))
    top = TYPICAL.wheel_radius / TYPICAL.k1
    assert speeds == pytest.approx(
        [duty * top for duty in (-0.85, -0.45, -0.2, 0.0, 0.2, 0.45, 0.85)], rel=0.02, abs=0.01
    )
    assert np.abs(motion.theta).max() < 1e-9


def test_spins_turn_both_ways_at_three_rates_and_hardly_move() -> None:
    motion = motion_of("spins")
    rates = levels(turn(motion.psi_left, motion.psi_right, TYPICAL))
    assert len(rates) == 7
    assert rates == pytest.approx([-rate for rate in reversed(rates)], abs=0.05)
    assert min(np.diff(rates)) > 1.0  # rad/s
    assert furthest(motion) < 0.01


def test_ramps_go_slowly_through_zero_with_both_sides_together_and_against_each_other() -> None:
    _time, left, right = duties_of("ramps")
    near_zero = (np.abs(left[:-1]) < 0.1) & (np.diff(left) != 0.0)
    slopes = np.diff(left)[near_zero] / DT
    assert np.abs(slopes).max() < 0.16  # duty/s
    for sides in (left == right, left == -right):
        moving = sides & (left != 0.0)
        assert (left[moving].min(), left[moving].max()) == (pytest.approx(-0.3, abs=0.01), pytest.approx(0.3, abs=0.01))


def test_multisine_holds_all_its_frequencies_together_and_against_each_other() -> None:
    time, left, right = duties_of("multisine")
    assert (FREQUENCIES.min(), FREQUENCIES.max()) == (0.2, 7.5)
    for mode, silent, begin in ((left + right, left - right, 1.0), (left - right, left + right, 11.8)):
        part = slice(round(begin / DT), round((begin + PERIOD) / DT))
        spectrum = np.abs(np.fft.rfft(mode[part]))
        lines = spectrum[np.rint(FREQUENCIES * PERIOD).astype(int)]
        assert lines.min() > 0.5 * lines.max()
        assert np.sum(lines**2) > 0.9 * np.sum(spectrum**2)
        assert np.abs(silent[part]).max() == 0.0
    assert time[-1] > 21.8


def test_circles_have_two_radii_at_two_speeds_each_both_ways() -> None:
    motion = motion_of("circles")
    speed = forward(motion.psi_left, motion.psi_right, TYPICAL)
    rate = turn(motion.psi_left, motion.psi_right, TYPICAL)
    steady = np.append(np.abs(np.diff(rate)) < 1e-4, False) & (np.abs(rate) > 0.3)
    found = {
        tuple(np.round((v, v / w / TYPICAL.base_width), 1)) for v, w in zip(speed[steady], rate[steady], strict=True)
    }
    radii = {radius for _speed, radius in found}
    assert radii == {-2.5, -1.5, 1.5, 2.5}
    for radius in radii:
        speeds = {abs(v) for v, other in found if other == radius}
        assert max(speeds) > 1.5 * min(speeds)
    assert motion.theta.max() > 0.9 * 2.0 * math.pi
    assert motion.theta.min() < -0.9 * 2.0 * math.pi


def test_a_slower_drive_makes_the_same_circles() -> None:
    fast, slow = motion_of("circles"), motion_of("circles", speed=0.5)
    assert slow.psi_left.max() == pytest.approx(0.5 * fast.psi_left.max(), rel=0.02)
    for name in ("x", "y", "theta"):
        assert getattr(slow, name).max() == pytest.approx(getattr(fast, name).max(), rel=0.06)


def test_figure_eights_are_half_slow_and_half_fast_without_a_rest_between() -> None:
    motion = motion_of("figure_eight")
    speed = np.abs(forward(motion.psi_left, motion.psi_right, TYPICAL))
    for expected in (0.2, 0.5):  # m/s
        assert DT * np.sum(np.abs(speed / expected - 1.0) < 0.1) == pytest.approx(30.0, abs=4.0)
    driving = np.flatnonzero(speed > 0.02)
    stands = np.diff(driving).max() * DT  # s; where it turns back
    assert stands < 0.2
    assert motion.theta.max() > 0.9 * 2.0 * math.pi
    assert (motion.y.max(), motion.y.min()) == (pytest.approx(0.65, abs=0.05), pytest.approx(-0.65, abs=0.05))


def test_steps_reverse_at_once_at_three_sizes_together_and_against_each_other() -> None:
    _time, left, right = duties_of("steps")
    ahead = round(0.05 / DT)
    jumps = {
        (round(a, 3), round(b, 3))
        for a, b in zip(left[ahead:] - left[:-ahead], right[ahead:] - right[:-ahead], strict=True)
    }
    for size in (0.3, 0.6, 0.9):
        assert {(size, size), (-2 * size, -2 * size), (-size, size), (2 * size, -2 * size)} <= jumps


def test_one_sided_steps_leave_the_other_side_alone_at_rest_and_rolling() -> None:
    _time, left, right = duties_of("one_sided_steps")
    for stepping, other in ((left, right), (right, left)):
        for held in (0.0, 0.4, -0.4):
            alone = (other[1:] == held) & (other[:-1] == held)
            assert np.sum(np.abs(np.diff(stepping)[alone]) > 0.05) >= 10


def test_a_rest_is_half_a_minute_without_motion() -> None:
    motion = motion_of("rest")
    assert len(motion.x) * DT >= 30.0
    assert not np.any(motion.psi_left)


def test_the_loop_is_repeated_for_minutes_between_pauses() -> None:
    _time, left, _right = duties_of("repeat_loop")
    driven = np.flatnonzero(left)
    pauses = np.flatnonzero(np.diff(driven) > 19.0 / DT)
    efforts = [left[part[0] : part[-1]] for part in np.split(driven, pauses + 1)]
    assert len(efforts) == 3
    loop = round(19.8 / DT)
    for effort in efforts:
        assert len(effort) > 2.9 * loop
        assert effort[loop:] == pytest.approx(effort[:-loop], abs=0.05)


def test_the_star_crosses_one_place_in_six_directions() -> None:
    motion = motion_of("star")
    away = np.hypot(motion.x, motion.y)
    tips = np.flatnonzero((away[1:-1] > away[:-2]) & (away[1:-1] >= away[2:]) & (away[1:-1] > 1.0)) + 1
    directions = np.sort(np.degrees(np.arctan2(motion.y[tips], motion.x[tips])) % 360.0)
    assert len(directions) == 6
    assert np.diff(directions) == pytest.approx([60.0] * 5, abs=2.0)
    assert all(away[a:b].min() < 0.05 for a, b in pairwise(tips))


def test_the_rich_drive_has_something_of_everything() -> None:
    motion = motion_of("rich_drive")
    _time, left, right = duties_of("rich_drive")
    straight, spinning = (left == right) & (left != 0.0), (left == -right) & (left != 0.0)
    assert {0.25, 0.5, 0.85, -0.25, -0.5, -0.85} <= {round(value, 3) for value in left[straight]}
    assert {0.2, 0.35, 0.5, -0.2, -0.35, -0.5} <= {round(value, 3) for value in left[spinning]}
    assert np.any((left == 0.0) & (right > 0.7))
    assert np.any((right == 0.0) & (left < -0.7))
    assert np.ptp(motion.theta) > 2.0 * math.pi


def test_the_short_drive_takes_a_minute_at_most_within_two_metres() -> None:
    duties = MANOEUVRES["short_drive"].duties()
    assert duties.duration <= 60.0
    assert furthest(motion_of("short_drive")) < 0.86  # m: half of 2 m, less the margin of an investigation


def test_a_telegraph_has_runs_of_each_length_as_often_as_a_sequence_of_maximum_length() -> None:
    """Of 15 signs there are 8 runs: half of them of one sign, a quarter of two, one each of three and of four."""
    changes = [index for index in range(len(SIGNS)) if SIGNS[index] != SIGNS[index - 1]]
    runs = sorted((after - before) % len(SIGNS) for before, after in pairwise([*changes, changes[0]]))
    assert runs == [1, 1, 1, 1, 2, 2, 3, 4]


def test_a_sequence_drives_one_manoeuvre_after_the_other_from_rest_to_rest() -> None:
    both, spins, steps = (in_sequence(name).duties() for name in ("spins+steps", "spins", "steps"))
    assert both.duration == pytest.approx(spins.duration + steps.duration)
    later = np.linspace(0.0, steps.duration, 500)
    assert both.at(spins.duration + later)[0] == pytest.approx(steps.at(later)[0], abs=1e-9)
    assert in_sequence("spins+steps").space == MANOEUVRES["steps"].space
