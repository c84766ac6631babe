"""Numbers that cannot be are found in messages of every type that robots live by."""

import math
from typing import Any

import numpy as np
import pytest

from cmr.bus.fields import fields_of
from cmr.bus.gate import AHEAD, BEHIND, LIVES_FOR, MEASURED_WITHIN, SPOKEN_OF, Gate
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.possible import BOUNDS, LONGEST_LEG, STAMPED_WITHIN, is_out_of_reach, screened
from cmr.bus.process import Process
from cmr.bus.streams import (
    COMMAND_LIFETIME,
    GYRO,
    MOTOR_COMMAND,
    MOTOR_DUTY,
    MOTOR_FEEDBACK,
    POSE,
    ROBOT_STATE,
    VELOCITY_COMMAND,
    WAYPOINTS,
    WHEEL_SPEED_COMMAND,
    WORLD_STATE,
    Stream,
)
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t, pose_xyt_t, waypoints_t, world_state_t

EPOCH = 1_800_000_000_000_000  # us
HOUR = 3_600_000_000  # us
HELD: list[Stream[Any]] = [
    POSE,
    GYRO,
    MOTOR_FEEDBACK,
    MOTOR_DUTY,
    ROBOT_STATE,
    WORLD_STATE,
    WAYPOINTS,
    MOTOR_COMMAND,
    WHEEL_SPEED_COMMAND,
    VELOCITY_COMMAND,
]
TYPES: dict[Stream[Any], Any] = {stream: stream.message_type for stream in HELD}
NUMBERS = [
    (stream, field.name)
    for stream, kind in TYPES.items()
    for field in fields_of(kind)
    if field.wire_type in ("double", "float")
]
IMPOSSIBLE = [math.nan, math.inf, -math.inf, 1e300, -1e300]


def message_of(stream: Stream[Any]) -> Any:
    """Return a message with zeros, of two robots or points where there are several, and of a gyro that is sure."""
    message = stream.message_type()
    for name, dimensions in zip(message.__slots__, message.__dimensions__, strict=True):
        if dimensions is not None:
            setattr(message, name, [0, 0])
            message.n = 2
    message.utime = EPOCH
    if isinstance(message, gyro_t):
        message.valid = 1
    return message


@pytest.mark.parametrize(("stream", "name"), NUMBERS, ids=lambda one: getattr(one, "name", one))
def test_every_number_has_bounds(stream: Stream[Any], name: str) -> None:
    good = message_of(stream)
    assert screened(good).message is good
    bound = BOUNDS[stream.message_type][name]
    for value in IMPOSSIBLE:
        message = message_of(stream)
        setattr(message, name, [0.0, value] if isinstance(getattr(message, name), list) else value)
        left, reasons = screened(message)
        if bound.dispensable and math.isnan(value):
            assert left is message
            continue
        assert [reason.split()[0] for reason in reasons] == [name]
        if bound.dispensable:
            assert left is not None
            assert math.isnan(getattr(left, name))
        elif stream is WORLD_STATE:
            assert as_world(left).n == 1
        else:
            assert left is None


@pytest.mark.parametrize("count", [2**53 + 1, -(2**63), 2**63 - 1])
@pytest.mark.parametrize("name", ["ticks_left", "ticks_right"])
def test_more_counts_than_a_wheel_can_have_turned_are_refused(name: str, count: int) -> None:
    message = message_of(MOTOR_FEEDBACK)
    setattr(message, name, count)
    assert screened(message) == (None, (f"{name} impossible",))


@pytest.mark.parametrize("offset", [HOUR, -HOUR, 2**62, -(2**62)])
@pytest.mark.parametrize(
    ("stream", "name", "instead"),
    [(MOTOR_FEEDBACK, "received_utime", EPOCH), (MOTOR_FEEDBACK, "applied_utime", 0), (GYRO, "received_utime", EPOCH)],
    ids=lambda one: getattr(one, "name", one),
)
def test_a_stamp_far_from_that_of_its_message_is_not_known(
    stream: Stream[Any], name: str, instead: int, offset: int
) -> None:
    message = message_of(stream)
    setattr(message, name, EPOCH + offset)
    left, reasons = screened(message)
    assert getattr(left, name) == instead
    assert reasons == (f"{name} impossible",)
    assert getattr(message, name) == EPOCH + offset, "it is another one's"
    setattr(message, name, EPOCH - STAMPED_WITHIN)
    assert screened(message) == (message, ())


def test_a_message_may_be_wrong_in_a_number_and_a_stamp() -> None:
    message = message_of(MOTOR_FEEDBACK)
    message.temperature, message.applied_utime = math.inf, 1
    left, reasons = screened(message)
    assert isinstance(left, motor_feedback_t)
    assert math.isnan(left.temperature)
    assert left.applied_utime == 0
    assert reasons == ("temperature not finite", "applied_utime impossible")


def as_world(message: Message | None) -> world_state_t:
    assert isinstance(message, world_state_t)
    return message


def test_of_a_world_the_other_robots_are_left_in_their_order() -> None:
    columns = {name: [0.0, 1.0, 2.0] for name in BOUNDS[world_state_t]} | {"x": [0.0, math.nan, 2.0]}
    world = make(world_state_t, utime=EPOCH, robot_id=[4, 5, 6], origin=[0, 1, 2], **columns)
    left = as_world(screened(world).message)
    assert world_state_t.decode(left.encode()).robot_id == (4, 6)
    assert np.array_equal(left.theta, [0.0, 2.0])
    assert world.n == 3


def test_the_rate_of_a_gyro_that_is_not_sure_is_no_matter() -> None:
    message = message_of(GYRO)
    message.valid, message.yaw_rate = 0, math.nan
    assert screened(message).message is message


def path_of(x: list[float], y: list[float]) -> Any:
    return make(waypoints_t, utime=EPOCH, robot_id=0, x=x, y=y)


def test_a_path_has_no_leg_that_nobody_drives() -> None:
    x = [0.0, LONGEST_LEG, 2.0 * LONGEST_LEG]
    path = path_of(x, [0.0] * 3)
    assert screened(path) == (path, ())
    assert not is_out_of_reach(path, 0.0, LONGEST_LEG)
    assert is_out_of_reach(path, 0.0, LONGEST_LEG + 1.0)
    path.y[1] = 1.0
    assert screened(path).message is None
    empty = path_of([], [])
    assert screened(empty) == (empty, ())
    assert not is_out_of_reach(empty, 1e6, 0.0)


def pose(utime: int) -> Any:
    return make(pose_xyt_t, utime=utime, robot_id=0, x=0.0, y=0.0, theta=0.0)


def test_stamps_are_near_the_clock_at_some_time_since_the_last_turn() -> None:
    gate = Gate()
    gate.turn(EPOCH)
    gate.turn(EPOCH + 5_000_000)  # held up for so long: what came meanwhile is as old as that
    for offset in (-MEASURED_WITHIN, 0, 5_000_000 + MEASURED_WITHIN):
        assert gate.let_in("POSE_0", pose(EPOCH + offset)) is not None
    for offset in (-MEASURED_WITHIN - 1, 5_000_001 + MEASURED_WITHIN):
        assert gate.let_in("POSE_0", pose(EPOCH + offset)) is None
    assert gate.refused == {("POSE_0", BEHIND): 1, ("POSE_0", AHEAD): 1}


def test_a_clock_that_was_set_is_followed_at_the_next_turn() -> None:
    gate = Gate()
    for now in (EPOCH, EPOCH - HOUR, EPOCH - 3_599_990_000):
        gate.turn(now)
        assert gate.let_in("POSE_0", pose(now)) is not None
    assert gate.let_in("POSE_0", pose(EPOCH)) is None


def test_commands_are_as_near_as_drivers_want_them() -> None:
    gate = Gate()
    gate.turn(EPOCH)
    for offset, comes_in in ((COMMAND_LIFETIME, True), (COMMAND_LIFETIME + 1, False)):
        command: Any = make(motor_command_t, utime=EPOCH - offset, robot_id=0, left=0.1, right=0.1)
        assert (gate.let_in("MOTOR_COMMAND_0", command) is not None) == comes_in


def test_what_was_refused_is_spoken_of_for_a_while() -> None:
    gate = Gate()
    gate.turn(EPOCH)
    for _ in range(3):
        gate.let_in("POSE_0", pose(EPOCH + HOUR))
    assert gate.problem() == "Messages were refused: POSE_0 ahead of this host's clock (3)."
    gate.turn(EPOCH + SPOKEN_OF + 1)
    assert gate.problem() == ""


@pytest.mark.parametrize("lives_now", [False, True])
@pytest.mark.parametrize("is_replayed", [False, True])
def test_a_process_takes_numbers_that_can_be_and_a_log_that_is_played_again(lives_now: bool, is_replayed: bool) -> None:
    taken: list[int] = []
    with Process("test", "memq://", lives_now=lives_now) as process:
        process.subscribe(POSE, every=True)
        for turn, utime in zip(range(4), process.loop(rate_hz=50.0), strict=False):
            process.dispatch(lambda utime, _channel, _message: taken.append(utime))
            if turn < 3:
                now = pose(utime - HOUR if is_replayed else utime)
                wrong, of_another_hour = pose(now.utime), pose(now.utime - HOUR)
                wrong.x = math.nan
                process.publish_all((POSE, 0, message) for message in (now, wrong, of_another_hour))
        said = process._full_message()
    expected = {(False, False): 3, (False, True): 3, (True, False): 6, (True, True): 0}
    assert len(taken) == expected[is_replayed, lives_now]
    assert ("POSE_0 x not finite 3" in said) == (not is_replayed or not lives_now)
    assert (f"POSE_0 {BEHIND}" in said) == (not is_replayed or lives_now)


def test_a_robot_lives_until_no_stamp_is_near_the_clock_any_more() -> None:
    gate = Gate(replays=True)
    for now, comes_in in ((EPOCH, False), (EPOCH + LIVES_FOR, False), (EPOCH + LIVES_FOR + 1, True)):
        gate.turn(now)
        if now == EPOCH:
            assert gate.let_in("POSE_0", pose(now)) is not None
        assert (gate.let_in("POSE_0", pose(EPOCH - HOUR)) is not None) == comes_in
        assert gate.let_in("POSE_1", pose(EPOCH - HOUR)) is not None


@pytest.mark.parametrize("stamp", [-1, -(2**63), 2**62, 2**63 - 1])
@pytest.mark.parametrize("stream", [POSE, MOTOR_FEEDBACK, MOTOR_DUTY], ids=lambda one: one.name)
def test_no_log_has_a_time_that_no_clock_shows(stream: Stream[Any], stamp: int) -> None:
    gate, message = Gate(replays=True), message_of(stream)
    gate.turn(EPOCH)
    message.utime = stamp
    assert gate.let_in(stream.channel(0), message) is None
    assert gate.problem()
