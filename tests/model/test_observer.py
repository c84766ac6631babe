"""The observer predicts what sensors say, and is drawn towards them."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from cmr.model.commands import Commands
from cmr.model.motion import RobotState, drive
from cmr.model.observer import loops
from cmr.model.observer import observer as observing
from cmr.model.observer.observer import MOTION, RESTART, Gains, Observations, Observer, observe
from cmr.model.observer.structures import Innovations
from cmr.model.parameters import Quantity, RobotParameters
from cmr.recordings.signal import Floats
from tests.support.silent_drive import silent_drive

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
FREE = Gains(0.0, 0.0, 0.0, 0.0)
FOLLOWING = Gains(0.2, 1.0, 0.15, 0.15)
STEPS, STEP = 1500, 0.01
BACK = 120  # steps of STEP that the observer looks back


def observed_finely(what: Observations, values: dict[str, float]) -> Innovations:
    """Observe with steps that nobody takes elsewhere: as many of them back as of STEP, for which it is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observing, "LONGEST_LATENCY", BACK * what.dt)
        return observe(what, values, FREE)


def test_one_observer_is_compiled_for_all_recordings_however_long_their_steps_are() -> None:
    what = observations()
    for dt in (STEP, 0.012, 0.05):
        observe(replace(what, dt=dt), ROBOT, FREE)
    assert len(cast(Any, loops.observe).signatures) == 1


def observations(**parameters: float) -> Observations:
    """Return the commands and readings of a robot with these parameters beside the paper's, without any noise."""
    time = np.asarray(np.arange(STEPS) * STEP, np.float64)
    left, right = 0.4 + 0.2 * np.sin(time), 0.4 - 0.2 * np.sin(0.7 * time)
    silent = silent_drive(Commands(time, np.stack([left, right], axis=1)), STEP, STEPS, pose_every=4)
    said = observe(silent, {**ROBOT, **parameters}, FREE)
    # Headings are told within half a turn; those of this drive stay there.
    wheel, gyro, pose = (np.ascontiguousarray(-error[..., 0]) for error in said[:3])
    return replace(silent, wheel=wheel, gyro=gyro, pose=pose)


def test_without_gains_the_observer_drives_as_the_simulation_does() -> None:
    """Motions of observer and simulation are the same to the last bit, effects included."""
    parameters = {**ROBOT, "coulomb_friction": 4.0, "turn_slip": 0.03}
    what = observations()
    moved = observe(what, parameters, FREE).motion
    left, right = what.commands.duty.T
    free = drive(left, right, np.full(STEPS, STEP), RobotParameters.of(parameters), RobotState.at_rest())
    for name in ("x", "y", "theta", "psi_left", "psi_right", "angle_left", "angle_right"):
        assert np.array_equal(moved[:, MOTION.index(name)], getattr(free, name)), name


@pytest.mark.parametrize(
    "effect",
    [
        {},
        {"pose_offset": 0.05, "pose_offset_lateral": -0.03},
        {"pose_latency": 0.04},
        {"pose_smoothing": 0.02},
        {"gyro_latency": 0.02},
        {"encoder_scale": 0.02},
    ],
    ids=lambda effect: "".join(effect) or "none",
)
def test_the_true_parameters_leave_no_prediction_error(effect: dict[str, float]) -> None:
    """With what is true, corrections find nothing to correct: errors are rounding."""
    said = observe(observations(**effect), {**ROBOT, **effect}, FOLLOWING)
    assert np.max(np.abs(said.wheel)) < 1e-9
    assert np.max(np.abs(said.gyro)) < 1e-9
    # The first pose may be told from before the drive began.
    assert np.max(np.abs(said.pose[5:])) < 1e-9


def test_wheels_go_on_turning_from_where_they_were_before_a_gap() -> None:
    """A wheel that is out of round shows where it stands: readings count from the gap, its turns do not."""
    wobble = {"wheel_wobble_share": 0.04, "wheel_wobble_phase": 0.3}
    whole = observations(**wobble)
    moved = observe(whole, {**ROBOT, **wobble}, FREE).motion
    gap, time = STEPS // 2, STEPS // 2 * STEP
    x, y, theta, psi_left, psi_right, *turned = (
        float(moved[gap, MOTION.index(name)])
        for name in ("x", "y", "theta", "psi_left", "psi_right", "angle_left", "angle_right")
    )
    readings, poses = whole.wheel_time > time, whole.pose_time > time
    after = replace(
        whole,
        steps=STEPS - gap,
        commands=replace(whole.commands, time=whole.commands.time - time),
        start=(x, y, theta, psi_left, psi_right),
        turned=(turned[0], turned[1]),
        wheel_time=whole.wheel_time[readings] - time,
        wheel=whole.wheel[readings] - turned,
        wheel_use=whole.wheel_use[readings],
        gyro_time=whole.gyro_time[readings] - time,
        gyro=whole.gyro[readings],
        pose_time=whole.pose_time[poses] - time,
        pose=whole.pose[poses],
        pose_use=whole.pose_use[poses],
    )
    said = observe(after, {**ROBOT, **wobble}, FOLLOWING)
    assert np.max(np.abs(said.wheel)) < 1e-9
    assert np.max(np.abs(said.gyro)) < 1e-9
    assert np.max(np.abs(said.pose)) < 1e-9


def test_a_gyro_reads_the_yaw_rate_of_its_moment_also_where_a_command_jumps() -> None:
    """Beside a jump of the yaw acceleration the reading is that of the moment, not a mean over two steps."""
    what = observations()
    duty = what.commands.duty.copy()
    duty[STEPS // 2 :, 0] -= 0.6
    said = observe(replace(what, commands=replace(what.commands, duty=duty)), ROBOT, FREE)
    psi_left, psi_right = (said.motion[1:-1, MOTION.index(name)] for name in ("psi_left", "psi_right"))
    yaw_rate = (psi_right - psi_left) * ROBOT["wheel_radius"] / ROBOT["base_width"]
    jump = 0.6 * ROBOT["k2_over_k3"] * ROBOT["wheel_radius"] / ROBOT["base_width"]  # rad/s^2
    reading = what.gyro - said.gyro[:, 0]
    assert np.max(np.abs(np.diff(yaw_rate))) > 0.9 * jump * STEP
    assert np.max(np.abs(reading - yaw_rate)[1:-1]) < 0.01 * jump * STEP  # the mean of two steps is a quarter off


@pytest.mark.parametrize("slip", [0.0, 0.02])
def test_within_a_step_that_takes_a_mean_command_the_gyro_reads_what_finer_steps_say(slip: float) -> None:
    """Small commands come in the middle of steps; on steps half as long they come on borders, which is exact."""
    sent = np.asarray(np.arange(0.5, STEPS, 2.0) * STEP, np.float64)
    duty = 0.4 + 0.009 * np.stack([np.sin(17.0 * sent), np.cos(19.0 * sent)], axis=1)
    assert np.max(np.abs(np.diff(duty, axis=0))) < 0.02  # what the observer calls small
    read = np.asarray(np.arange(0.3, STEPS - 1.0, 0.7) * STEP, np.float64)
    read = read[np.min(np.abs(read[:, None] - sent), axis=1) > 0.01 * STEP]  # at a jump either side is right
    coarse = replace(
        observations(),
        commands=Commands(sent, duty),
        gyro_time=read,
        gyro=np.zeros(len(read)),
    )
    robot = {**ROBOT, "longitudinal_slip": slip}
    fine = observed_finely(replace(coarse, dt=0.5 * STEP, steps=2 * STEPS), robot)
    mean = observe(coarse, robot, FREE)
    bend = 0.018 * ROBOT["k2_over_k3"] * ROBOT["wheel_radius"] / ROBOT["base_width"]  # rad/s^2, the largest
    # Before the first command duties are not known. Without the bend a quarter of `bend * STEP` would be missing.
    known = read > 2.0 * STEP
    assert np.max(np.abs(mean.gyro - fine.gyro)[known]) < 0.03 * bend * STEP
    assert np.max(np.abs(mean.wheel - fine.wheel)) < 1e-4


def test_a_reading_at_the_moment_of_a_command_is_the_same_whatever_rounding_makes_of_that_moment() -> None:
    """A command in the middle of a step, at a reading, makes the yaw rate of a robot that slips jump."""
    what = observations()
    sent = np.asarray(np.arange(0.5, STEPS, 5.0) * STEP, np.float64)
    duty = 0.4 + 0.3 * np.stack([np.sin(3.0 * sent), np.cos(4.0 * sent)], axis=1)
    given = replace(what, commands=Commands(sent, duty), gyro_time=sent, gyro=np.zeros(len(sent)))
    robot = {**ROBOT, "longitudinal_slip": 0.02}
    readings = [observe(given, {**robot, "gyro_latency": late}, FREE).gyro[1:] for late in (0.0, 1e-12)]
    assert np.max(np.abs(readings[0] - readings[1])) < 1e-9


def test_encoders_that_are_read_at_a_border_read_the_same_whatever_rounding_makes_of_that_moment() -> None:
    """Some multiples of a step are by rounding later than the border where they lie, and so belong to the next step."""
    what = observations()
    wheel_time = np.asarray([np.nextafter(number * STEP, np.inf) for number in range(1, STEPS - 1)], np.float64)
    given = replace(
        what, wheel_time=wheel_time, wheel=what.wheel[: len(wheel_time)], wheel_use=what.wheel_use[: len(wheel_time)]
    )
    exact = replace(given, wheel_time=what.wheel_time[: len(wheel_time)])
    late, on_time = (observe(one, ROBOT, FREE).wheel for one in (given, exact))
    assert np.max(np.abs(late - on_time)) < 1e-9  # rad; at 15 rad/s, rounding is worth 1e-13


@pytest.mark.parametrize("given", [np.empty((0, 2)), np.tile([3.0, 5.0], (STEPS, 1))], ids=["driven", "rolling"])
def test_the_first_reading_of_a_robot_in_motion_is_its_yaw_rate(given: Floats) -> None:
    start = (0.0, 0.0, 0.0, 3.0, 5.0)
    moving = replace(observations(), start=start, given=given, gyro_time=np.zeros(1), gyro=np.zeros(1))
    yaw_rate = (5.0 - 3.0) * ROBOT["wheel_radius"] / ROBOT["base_width"]
    said = observe(moving, ROBOT, FREE)
    assert said.gyro[0, 0] == pytest.approx(-yaw_rate, rel=1e-3)


@pytest.mark.parametrize("gyro_latency", [0.0, 0.017])
def test_readings_between_borders_are_those_of_finer_steps(gyro_latency: float) -> None:
    """Sensors at 20 Hz are read in the middle of every other step of 0.02 s; nothing within it is a straight line."""
    read = np.asarray(np.arange(1.0, 100.0) * 0.05, np.float64)
    sent = np.asarray(np.arange(100) * 0.05, np.float64)
    duty = 0.5 * np.stack([np.sign(np.sin(3.0 * sent)), np.sign(np.cos(4.0 * sent))], axis=1)
    silent = replace(
        observations(),
        dt=0.02,
        steps=300,
        commands=Commands(sent, duty),
        wheel_time=read,
        wheel=np.zeros((len(read), 2)),
        wheel_use=np.ones((len(read), 2), np.uint8),
        gyro_time=read,
        gyro=np.zeros(len(read)),
        pose_time=read,
        pose=np.zeros((len(read), 3)),
        pose_use=np.ones(len(read), np.uint8),
    )
    robot = {**ROBOT, "k2_over_k3": 200.0, "gyro_latency": gyro_latency, "pose_latency": 0.007}
    coarse = observe(silent, robot, FREE)
    fine = observed_finely(replace(silent, dt=0.0025, steps=2400), robot)
    later = read > 0.1
    assert np.max(np.abs(coarse.wheel - fine.wheel)[later]) < 3e-4  # rad; 6e-3 on straight lines
    assert np.max(np.abs(coarse.gyro - fine.gyro)[later]) < 1e-3  # rad/s; 7e-3 and 12e-3 on straight lines
    heading = coarse.pose[:, 2] - fine.pose[:, 2]
    assert np.max(np.abs(heading)[later]) < 1e-4  # rad; 1.5e-3 on straight lines


def test_poses_from_before_the_beginning_leave_no_error_behind() -> None:
    """Nobody knows what a robot did before a recording: each late pose of that time is a new beginning of the path."""
    what = observations(pose_latency=0.3)
    early = np.flatnonzero(what.pose_time < 0.3)
    pose = what.pose.copy()
    pose[early[:-1], :2] += 0.5
    robot = {**ROBOT, "pose_latency": 0.3}
    said, other = (observe(one, robot, FOLLOWING).pose[early[-1] + 1 :] for one in (what, replace(what, pose=pose)))
    assert np.max(np.abs(said - other)) < 1e-9


def test_an_effect_left_out_shows_in_its_own_signal_only() -> None:
    """A gyro's bias is an error of its size in the gyro, and none in wheels and poses."""
    said = observe(observations(gyro_bias=0.01), ROBOT, FOLLOWING)
    assert np.allclose(said.gyro, 0.01, atol=1e-9)
    assert np.max(np.abs(said.wheel)) < 1e-9
    assert np.max(np.abs(said.pose)) < 1e-9


def test_errors_do_not_pile_up() -> None:
    """With a base width 3 % off, free headings stray further and further; predicted ones stay near."""
    wrong = {**ROBOT, "base_width": 0.165}
    what = observations()
    free, predicted = (np.abs(observe(what, wrong, gains).pose[:, 2, 0]) for gains in (FREE, FOLLOWING))
    assert np.max(free) > 5.0 * np.max(predicted)


def test_where_encoders_draw_the_wheels_the_robot_goes_with_them() -> None:
    """The heading predicted is what the drawn wheels have turned."""
    what = observations()
    moved = observe(what, {**ROBOT, "k2_over_k3": 124.0}, Gains(0.2, 1.0, 0.0, 0.0)).motion
    angle_left, angle_right, theta = (moved[:, MOTION.index(name)] for name in ("angle_left", "angle_right", "theta"))
    rolled = (angle_right - angle_left) * ROBOT["wheel_radius"] / ROBOT["base_width"]
    assert np.max(np.abs(rolled)) > 1.0
    assert np.max(np.abs(theta - rolled)) < 1e-9


@pytest.mark.parametrize("share", [-0.05, 0.02])
def test_larger_wheels_and_encoders_that_count_less_are_the_same_mathematics(share: float) -> None:
    """The errors are the same, also where the observer corrects a robot that is not as believed."""
    what = observations(turn_slip=0.05)
    seen = {**ROBOT, "k2_over_k3": ROBOT["k2_over_k3"] * (1.0 + share), "k1": ROBOT["k1"] / (1.0 + share)}
    counted = observe(what, {**ROBOT, "encoder_scale": share}, FOLLOWING)
    rolled = observe(what, {**seen, "wheel_radius_scale": 1.0 / (1.0 + share) - 1.0}, FOLLOWING)
    assert np.max(np.abs(counted.gyro)) > 1e-3
    for one, other in zip(counted[:3], rolled[:3], strict=True):
        # Nothing but rounding, of headings of some radians.
        assert np.max(np.abs(one - other)) < 1e-9


def test_a_restart_forgets_where_the_robot_was_believed_to_be() -> None:
    """After a pose that restarts it, the observer predicts the jumped path as well as the path before."""
    what = observations()
    jump = len(what.pose_time) // 2
    pose, use = what.pose.copy(), what.pose_use.copy()
    pose[jump:, 0] += 1.0
    use[jump] = RESTART
    said = observe(replace(what, pose=pose, pose_use=use), ROBOT, FOLLOWING)
    assert abs(said.pose[jump, 0, 0]) == pytest.approx(1.0)
    assert np.max(np.abs(said.pose[jump + 1 :])) < 1e-9


def test_where_poses_fold_space_the_observer_still_finds_the_way() -> None:
    """Beyond 1.3 m from the origin, poses of this sensor come back towards it: their errors point the wrong way."""
    what, values = observations(pose_distortion=-0.2), {**ROBOT, "pose_distortion": -0.2}
    true = observe(what, values, FREE).motion
    found = observe(replace(what, start=(0.05, 0.05, 0.0, 0.0, 0.0)), values, FOLLOWING).motion
    places = [MOTION.index("x"), MOTION.index("y")]
    distance = np.hypot(*true[:, places].T)
    beyond = distance > 1.5
    assert beyond.sum() > 200
    assert np.abs(found[beyond][-100:] - true[beyond][-100:])[:, places].max() < 0.01


def test_candidates_are_observed_side_by_side_as_one_by_one() -> None:
    """A candidate's errors do not depend on the others, of which there are more than one thread observes at once."""
    what = observations()
    widths = np.linspace(0.155, 0.17, 40)
    together = observe(what, {**ROBOT, "base_width": widths}, FOLLOWING)
    for lane in (0, 1, 17, 39):
        alone = observe(what, {**ROBOT, "base_width": widths[lane]}, FOLLOWING)
        assert np.array_equal(together.pose[:, :, lane], alone.pose[:, :, 0])


def test_an_unknown_parameter_is_named() -> None:
    """A misspelt name is an error that shows it."""
    with pytest.raises(KeyError, match="base_with"):
        observe(observations(), {**ROBOT, "base_with": 0.16}, FREE)


@pytest.mark.parametrize(
    ("effect", "after_50_s"),
    [
        ({"gyro_drift": 0.012}, {"gyro_bias": 0.006}),
        ({"clock_skew": 1e-3}, {"pose_latency": 0.05 / 1.001}),
    ],
    ids=["gyro_drift", "clock_skew"],
)
def test_what_grows_with_time_goes_on_growing_after_a_gap(
    effect: dict[str, float], after_50_s: dict[str, float]
) -> None:
    """A segment that begins 50 s into the drive begins with what has come together by then."""
    at_once, later = observations(), replace(observations(), time=50.0)
    said = observe(later, {**ROBOT, **effect}, FREE)
    expected = observe(at_once, {**ROBOT, **effect, **after_50_s}, FREE)
    assert np.allclose(said.gyro, expected.gyro, atol=1e-9)
    assert np.allclose(said.pose, expected.pose, atol=1e-9)


def halves(what: Observations, motion: np.typing.NDArray[np.float64]) -> list[Observations]:
    """Return a drive in two, the second of which starts as the robot then moved."""
    half = STEPS // 2
    wheels, poses = slice(half, None), slice(int(np.sum(what.pose_time <= half * STEP)), None)
    first = replace(
        what,
        steps=half,
        wheel_time=what.wheel_time[:half],
        wheel=what.wheel[:half],
        wheel_use=what.wheel_use[:half],
        gyro_time=what.gyro_time[:half],
        gyro=what.gyro[:half],
        pose_time=what.pose_time[: poses.start],
        pose=what.pose[: poses.start],
        pose_use=what.pose_use[: poses.start],
    )
    x, y, theta, psi_left, psi_right = (float(motion[half, MOTION.index(name)]) for name in MOTION[:5])
    angles = motion[half, [MOTION.index("angle_left"), MOTION.index("angle_right")]]
    second = replace(
        what,
        steps=STEPS - half,
        commands=replace(what.commands, time=what.commands.time - half * STEP),
        start=(x, y, theta, psi_left, psi_right),
        time=half * STEP,
        wheel_time=what.wheel_time[wheels] - half * STEP,
        wheel=np.ascontiguousarray(what.wheel[wheels] - angles),
        wheel_use=what.wheel_use[wheels],
        gyro_time=what.gyro_time[wheels] - half * STEP,
        gyro=what.gyro[wheels],
        pose_time=what.pose_time[poses] - half * STEP,
        pose=np.ascontiguousarray(what.pose[poses]),
        pose_use=what.pose_use[poses],
    )
    return [first, second]


@pytest.mark.parametrize(
    "effect", [{"battery_drift": 0.5}, {"motor_heating": 0.5}], ids=lambda effect: next(iter(effect))
)
def test_what_lasts_is_as_it_was_after_a_gap(effect: dict[str, float]) -> None:
    """A battery is as empty in a drive that is continued as it would have been without the gap, and a motor as warm."""
    what, values = observations(**effect), {**ROBOT, **effect}
    parts = halves(what, observe(what, values, FREE).motion)
    observer = Observer(values, FREE)
    _, continued = observer.observe_each(parts, [False, True])
    _, alone = observer.observe_each(parts, [False, False])
    assert np.abs(continued.wheel).max() < 1e-9
    assert np.abs(alone.wheel).max() > 1e-2


def test_drives_are_observed_together_as_one_by_one() -> None:
    """With commands or by given wheel speeds: each drive's errors are those that it has alone."""
    what = observations()
    rolling = replace(what, given=np.full((STEPS, 2), 5.0), time=3.0)
    drives = [what, *halves(what, observe(what, ROBOT, FREE).motion), rolling, rolling]
    values: dict[str, Quantity] = {
        **ROBOT,
        "base_width": np.linspace(0.15, 0.17, 20),
        "command_delay": np.repeat([0.0, 0.013], 10),
    }
    together = Observer(values, FOLLOWING).observe_each(drives, [False] * len(drives))
    for one, said in zip(drives, together, strict=True):
        for found, alone in zip(said, observe(one, values, FOLLOWING), strict=True):
            np.testing.assert_array_equal(found, alone)
