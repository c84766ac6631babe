"""Manoeuvres excite what they say, in the time and space they say, on a leader and on a real robot."""

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.bus.streams import WORLD_STATE
from cmr.commands.command_line import CommandError
from cmr.commands.pilot import main as run_pilot
from cmr.commands.robots import behaviour_of, numbered, virtual_robots
from cmr.manoeuvres import MANOEUVRES, TYPICAL, help_text, in_sequence
from cmr.manoeuvres.pieces import FREQUENCIES, PERIOD
from cmr.model.body import forward, turn
from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour, BehaviourError, make_behaviour
from cmr.world.behaviours.manoeuvring import DriveManoeuvre
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, Robot, WorldView, world_messages
from cmr.world.world import World

DT = 0.01  # s
EPOCH = 1_800_000_000_000_000  # us
SMALL = RobotParameters(wheel_radius=0.042, k2_over_k3=60.0, k1=0.05, base_width=0.17)
LARGE = RobotParameters(wheel_radius=0.165, k2_over_k3=20.0, k1=0.165, base_width=1.0)
NAMES = pytest.mark.parametrize("name", MANOEUVRES)


def duties_of(name: str, robot: RobotParameters = TYPICAL, speed: float = 1.0) -> tuple[Any, Any, Any]:
    """Return the times [s] of 10 ms steps from beginning to end, and the duties of both sides."""
    duties = in_sequence(name).duties(robot, speed)
    time = np.arange(round(duties.duration / DT) + 1) * DT
    return time, *duties.at(time)


def motion_of(
    name: str,
    robot: RobotParameters = TYPICAL,
    *,
    believed: RobotParameters | None = None,
    gains: tuple[float, float] = (1.0, 1.0),
    speed: float = 1.0,
) -> Trajectory:
    """Return how a robot moves that is believed to have other parameters, and whose motors differ by `gains`."""
    time, left, right = duties_of(name, believed or robot, speed)
    spans = np.full(len(time), DT)
    return drive(gains[0] * left, gains[1] * right, spans, robot, RobotState.at_rest())


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


def test_a_sequence_drives_one_manoeuvre_after_the_other_from_rest_to_rest() -> None:
    both, spins, steps = (in_sequence(name).duties() for name in ("spins+steps", "spins", "steps"))
    assert both.duration == pytest.approx(spins.duration + steps.duration)
    later = np.linspace(0.0, steps.duration, 500)
    assert both.at(spins.duration + later)[0] == pytest.approx(steps.at(later)[0], abs=1e-9)
    assert in_sequence("spins+steps").space == MANOEUVRES["steps"].space


# A leader, and a real robot


PARAMETERS = ParameterFile(0, {name: Value(value) for name, value in TYPICAL.values.items()})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot_0.yaml"
    PARAMETERS.save(path)
    return path


def test_a_virtual_leader_drives_a_manoeuvre(file: Path) -> None:
    [leader] = virtual_robots([numbered("10=manoeuvre,name=spins,start=0,x=0.5")], parameters_of=0)
    world = World([leader], lambda robot_id: ParameterFollower(robot_id, file))
    headings, places = [], []
    for k in range(round(duties_of("spins")[0][-1] / DT)):
        world.advance(EPOCH + k * 10_000)
        for robot in world.robots():
            headings.append(robot.state.theta)
            places.append((robot.state.x, robot.state.y))
    expected = motion_of("spins").theta
    assert np.unwrap(headings).max() == pytest.approx(expected.max(), rel=1e-3)
    assert np.unwrap(headings).min() == pytest.approx(expected.min(), abs=0.01)
    assert np.abs(np.array(places) - (0.5, 0.0)).max() < 1e-6


class TestPilot:
    """A real robot is driven by the same behaviour, and stopped for good where driving blindly is not safe."""

    @pytest.fixture
    def behaviour(self) -> DriveManoeuvre:
        return DriveManoeuvre("steps", start=0.5)

    @pytest.fixture
    def pilot(self, behaviour: DriveManoeuvre, file: Path) -> Pilot:
        return Pilot(0, behaviour, ParameterFollower(0, file))

    @staticmethod
    def command(pilot: Pilot, seconds: float, x: float = 0.0) -> tuple[float, float]:
        """Return what the pilot commands with the robot at `x` [m]."""
        utime = EPOCH + round(seconds * 1e6)
        [message] = world_messages(utime, [Robot(utime, 0, REAL, RobotState.at_rest(x))])
        pilot.handle(utime, WORLD_STATE.name, message)
        command = pilot.command(utime)
        return command.left, command.right

    def test_drives_the_manoeuvre_to_its_end(self, pilot: Pilot, behaviour: DriveManoeuvre) -> None:
        steps = in_sequence("steps").duties()
        for time in np.arange(0.0, steps.duration + 0.5, 0.02):
            assert not behaviour.finished
            assert self.command(pilot, time) == pytest.approx(steps.at(time - 0.5), abs=1e-6)
        assert self.command(pilot, steps.duration + 0.52) == (0.0, 0.0)
        assert (behaviour.finished, behaviour.problem) == (True, "")

    def test_stops_for_good_outside_its_space(self, pilot: Pilot, behaviour: DriveManoeuvre) -> None:
        assert self.command(pilot, 0.0, x=5.0) == (0.0, 0.0)
        for time in np.arange(0.05, 2.0, 0.1):
            assert any(self.command(pilot, time, x=5.0)) == (time > 1.5)
        assert self.command(pilot, 2.1, x=5.9) == (0.0, 0.0)
        assert self.command(pilot, 2.2, x=5.0) == (0.0, 0.0)
        assert behaviour.finished
        assert "0.90 m from where it began; 0.80 m are allowed" in behaviour.problem

    def test_stops_for_good_when_it_was_interrupted(self, pilot: Pilot, behaviour: DriveManoeuvre) -> None:
        self.command(pilot, 0.0)
        for time in (2.0, 2.02):
            assert self.command(pilot, time) == (0.0, 0.0)
        assert behaviour.finished
        assert behaviour.problem == "steps was interrupted for 2.0 s. Start it again."

    def test_a_larger_robot_gets_more_space_and_people_may_allow_other(self) -> None:
        for given, allowed in ((None, 0.8 * 1.0 / 0.161), (0.4, 0.4)):
            behaviour = DriveManoeuvre("steps", space=given)
            me = Robot(EPOCH, 0, REAL, RobotState.at_rest())
            behaviour.command(EPOCH, me, WorldView(), LARGE)
            assert behaviour.space == pytest.approx(allowed)


class Brief(Behaviour):
    """A behaviour that is over at once."""

    def __init__(self, trouble: int = 0) -> None:
        self.finished = True
        self.problem = "The floor is wet. Wait." if trouble else ""

    def command(self, _utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        return 0.0, 0.0


def test_the_pilot_ends_with_its_behaviour(url: str, file: Path) -> None:
    options = ["--lcm-url", url, "--parameters", str(file)]
    assert run_pilot([*options, "--behaviour", "tests.test_manoeuvres:Brief"]) == 0
    with pytest.raises(CommandError, match="The floor is wet"):
        run_pilot([*options, "--behaviour", "tests.test_manoeuvres:Brief,trouble=1"])


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"name": "waltz"}, "no manoeuvre 'waltz'; there are straight_runs, spins"),
        ({"name": "spins+"}, "no manoeuvre ''"),
        ({"speed": "0"}, "speed must be above 0"),
        ({"speed": "2"}, "up to 1.1"),
        ({"repeats": "0"}, "repeats 1 to 100"),
        ({"space": "-1"}, "space above 0"),
        ({"start": "soon"}, "start=soon is not a number"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_allowed(settings: dict[str, str], said: str) -> None:
    with pytest.raises(BehaviourError, match=said):
        make_behaviour("manoeuvre", settings)


def test_a_description_on_the_command_line_is_a_manoeuvre() -> None:
    behaviour, pose = behaviour_of("manoeuvre,name=rest+spins,repeats=2,speed=0.5,theta=1")
    assert isinstance(behaviour, DriveManoeuvre)
    assert behaviour.manoeuvre.name == "rest+spins+rest+spins"
    assert pose == {"theta": 1.0}
