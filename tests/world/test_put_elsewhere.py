"""A robot that is put elsewhere is followed, and that is said; glitches of its poses are not."""

import copy
import math
import random
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from cmr.model.body import wrap
from cmr.model.parameters import RobotParameters
from cmr.parameters.following import ParameterFollower
from cmr.world.estimator import FAR, POSE_STD, Estimator
from cmr.world.refusals import SPOKEN_OF, refusals
from cmr.world.view import REAL
from cmr.world.world import World
from tests.support.emulated_drive import DEFAULT, EPOCH, NOMINAL, Message, figure_eight, messages
from tests.world.test_world import MODEL, TRUE

SENSORS = ("MOTOR_FEEDBACK", "GYRO", "POSE")
ELSEWHERE = (3.0, -2.0, 1.0)  # m, m, rad that a robot is moved and turned
MOMENT = EPOCH + 4_000_000  # us; when it is
Change = Callable[[Any], Any]  # of a pose what comes in its place, None for nothing


def standing(_share: float) -> tuple[float, float]:
    return 0.0, 0.0


def moved(pose: Any, by: tuple[float, float, float]) -> Any:
    """Return a pose as it is when the world is turned about its origin and then moved."""
    there, (dx, dy, angle) = copy.copy(pose), by
    there.x = dx + math.cos(angle) * pose.x - math.sin(angle) * pose.y
    there.y = dy + math.sin(angle) * pose.x + math.cos(angle) * pose.y
    there.theta = wrap(pose.theta + angle)
    return there


def drive(
    change: Change, duties: Any = figure_eight, seconds: float = 7.0, every: int = 1, channels: Iterable[str] = SENSORS
) -> list[Message]:
    """Return the messages of a drive whose poses are changed; of poses, which come at 50 Hz, every so many."""
    changed, count = [], 0
    for channel, message in messages(DEFAULT, seconds=seconds, rest=0.5, duties=duties, channels=channels):
        if not channel.startswith("POSE"):
            changed.append((channel, message))
            continue
        count += 1
        pose = change(message) if count % every == 0 else None
        if pose is not None:
            changed.append((channel, pose))
    return changed


def estimate(drive: list[Message], until: int = 2**62, parameters: RobotParameters = MODEL) -> tuple[Estimator, int]:
    """Return an estimator after a drive until some time [us], and how many poses it found too far away."""
    estimator, far = Estimator(0), 0
    estimator.parameters = parameters
    for channel, message in drive:
        if message.utime <= until:
            far += estimator.handle(message.utime, channel, message) == FAR
    return estimator, far


def assert_at(estimator: Estimator, pose: Any, times: float = 3.0) -> None:
    """Check that an estimate is at a pose, as near as poses are: their noise and that of the estimate."""
    state = estimator.state
    assert math.hypot(state.x - pose.x, state.y - pose.y) < times * POSE_STD[0]
    assert abs(wrap(state.theta - pose.theta)) < times * POSE_STD[2]


def last_pose(drive: list[Message], until: int) -> Any:
    return [message for channel, message in drive if channel.startswith("POSE") and message.utime <= until][-1]


@pytest.mark.parametrize("every", [1, 5, 10], ids=["50 Hz", "10 Hz", "5 Hz"])
@pytest.mark.parametrize("duties", [figure_eight, standing])
def test_a_robot_that_was_put_elsewhere_is_there_two_seconds_later(duties: Any, every: int) -> None:
    kidnapped = drive(lambda pose: moved(pose, ELSEWHERE) if pose.utime >= MOMENT else pose, duties, every=every)
    there = MOMENT + 2_000_000
    estimator, _ = estimate(kidnapped, there)
    assert_at(estimator, last_pose(kidnapped, there))
    assert estimator.reset is not None
    assert 1_000_000 <= estimator.reset.utime - MOMENT <= 1_600_000
    here = last_pose(drive(lambda pose: pose, duties, every=every), estimator.reset.utime)
    away = math.hypot(moved(here, ELSEWHERE).x - here.x, moved(here, ELSEWHERE).y - here.y)
    assert estimator.reset.distance == pytest.approx(away, abs=0.1)


@pytest.mark.parametrize("duties", [figure_eight, standing])
@pytest.mark.parametrize("far", [3.0, 1_000.0])
def test_glitches_among_poses_move_nothing(duties: Any, far: float) -> None:
    glitches = iter(range(50))

    def glitch(pose: Any) -> Any:
        k = (pose.utime - EPOCH) // 20_000
        return (
            moved(pose, (far, 0.0, 0.0)) if k % 2 and pose.utime > MOMENT and next(glitches, None) is not None else pose
        )

    spoiled = drive(glitch, duties)
    estimator, count = estimate(spoiled)
    assert count == 50
    assert estimator.reset is None
    clean, _ = estimate(drive(lambda pose: pose, duties))
    assert math.dist(estimator.state[:2], clean.state[:2]) < POSE_STD[0]


@pytest.mark.parametrize("duties", [figure_eight, standing])
def test_two_seconds_after_glitches_that_came_alone_it_is_where_it_is(duties: Any) -> None:
    """For 2.5 s nothing else came: it was believed to be put elsewhere, and then back."""
    spoiled = drive(
        lambda pose: moved(pose, (3.0, 0.0, 0.0)) if 0 <= pose.utime - EPOCH - 1_500_000 < 2_500_000 else pose, duties
    )
    after = MOMENT + 2_000_000
    estimator, _ = estimate(spoiled, after)
    assert_at(estimator, last_pose(spoiled, after))


def test_a_robot_that_is_carried_is_there_when_it_was_set_down() -> None:
    """For 3 s somebody carries it at 1 m/s, while its wheels stand."""

    def carried(pose: Any) -> Any:
        return moved(pose, (min(max(pose.utime - EPOCH - 1_000_000, 0) * 1e-6, 3.0), 0.0, 0.0))

    carry = drive(carried, standing)
    estimator, _ = estimate(carry, MOMENT + 2_000_000)
    assert_at(estimator, last_pose(carry, MOMENT + 2_000_000))
    assert estimator.reset is not None


def test_a_robot_of_which_only_poses_come_is_followed() -> None:
    poses = drive(lambda pose: pose, every=10, channels=["POSE"])
    estimator, far = estimate(poses)
    assert_at(estimator, last_pose(poses, 2**62))
    assert far == 0


@pytest.mark.parametrize("every", [1, 10], ids=["50 Hz", "5 Hz"])
def test_poses_correct_an_estimate_by_parameters_that_are_wrong(every: int) -> None:
    """With 68 % of the gain, 19 % more back-EMF and a base too wide by a quarter, without a gyro."""
    estimator, far = estimate(
        drive(lambda pose: pose, every=every, channels=["MOTOR_FEEDBACK", "POSE"]), parameters=NOMINAL.robot_parameters
    )
    assert far == 0
    assert estimator.reset is None


def test_poses_of_a_tracker_that_is_noisier_than_thought_are_used() -> None:
    noise = random.Random(1)
    noisy = lambda pose: moved(pose, (noise.gauss(0.0, 0.03), noise.gauss(0.0, 0.03), 0.0))  # noqa: E731
    estimator, far = estimate(drive(noisy, seconds=20.0))
    assert far <= 2
    assert estimator.reset is None


def test_a_wrong_first_pose_is_mended() -> None:
    wrong_first = drive(lambda pose: moved(pose, ELSEWHERE) if pose.utime < EPOCH + 20_000 else pose)
    estimator, _ = estimate(wrong_first, EPOCH + 2_000_000)
    assert_at(estimator, last_pose(wrong_first, EPOCH + 2_000_000))


def test_the_world_says_that_a_robot_was_put_elsewhere(tmp_path: Path) -> None:
    file = tmp_path / "robot_0.yaml"
    TRUE.save(file)
    world = World([], lambda robot_id: ParameterFollower(robot_id, file))
    said: dict[int, list[str]] = {}
    for channel, message in drive(lambda pose: moved(pose, ELSEWHERE) if pose.utime >= MOMENT else pose):
        world.handle(message.utime, channel, message)
        world.advance(message.utime)
        said[message.utime] = refusals(world, message.utime)
    assert said[MOMENT - 10_000] == []
    assert "POSE_0 far from where the robot can be" in said[MOMENT + 500_000][0]
    first = next(utime for utime, sentences in said.items() if any("put elsewhere" in one for one in sentences))
    assert first < MOMENT + 1_100_000
    assert "Robot 0 was put elsewhere: its poses agree on a place" in said[first][-1]
    assert said[first + SPOKEN_OF + 20_000] == []
    assert {robot.origin for robot in world.real()} == {REAL}
