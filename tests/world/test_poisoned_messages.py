"""No message, whatever stands in it, keeps a robot from being where it is two seconds after the last one like it."""

import copy
import importlib
import math
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from cmr.bus.fields import fields_of
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Process
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, POSE, WAYPOINTS, WORLD_STATE, Stream
from cmr.msg import motor_command_t, process_status_t, waypoints_t, world_state_t
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import make_behaviour
from cmr.world.behaviours.behaviour import Commanded
from cmr.world.estimator import POSE_STD
from cmr.world.view import REAL, TWIN, VIRTUAL
from cmr.world.world import VirtualRobot, World
from tests.support.emulated_drive import DEFAULT, EPOCH, messages
from tests.support.lanes import further
from tests.world.test_world import TRUE

pytestmark = pytest.mark.slow

SIM = importlib.import_module("cmr.commands.sim")  # the package has a function of this name
BAD_FROM, BAD_UNTIL = EPOCH + 2_500_000, EPOCH + 3_000_000  # us; the drive goes on from 1.5 s to 7.5 s
END = BAD_UNTIL + 2_000_000
HOUR = 3_600_000_000
COMMANDED, SENT, OTHER = 10, 11, 20  # a virtual robot of MOTOR_COMMAND, one of WAYPOINTS, one of another simulator
PATH = ([1.0, 2.0, 3.0], [-2.0, -2.0, -1.0])  # m

KINDS: dict[str, Callable[[float], float]] = {
    "no number": lambda _value: math.nan,
    "infinite": lambda _value: -math.inf,
    "1e300": lambda _value: 1e300,
    "thousandfold": lambda value: 1_000.0 * (value or 1.0),
}
STAMPS = {"an hour ahead": HOUR, "an hour back": -HOUR}
WHOLE = {"2^62": 2**62, "-2^62": -(2**62)}  # of counts, and of stamps beside that of the message
WHOLE_NUMBERS = [
    *((MOTOR_FEEDBACK, name) for name in ("ticks_left", "ticks_right", "received_utime", "applied_utime")),
    (GYRO, "received_utime"),
]
ROBOT_OF: dict[Stream[Any], int | None] = {
    POSE: 0,
    GYRO: 0,
    MOTOR_FEEDBACK: 0,
    MOTOR_COMMAND: COMMANDED,
    WAYPOINTS: SENT,
    WORLD_STATE: None,
}
SENSORS = (POSE, GYRO, MOTOR_FEEDBACK)
FRACTIONS = ("double", "float")  # wire types of fields that can be no number


class Outcome(NamedTuple):
    """Where everybody is at the end, by id and origin, and what cmr-sim reported right after the bad messages."""

    states: dict[tuple[int, int], tuple[float, ...]]
    report: str
    state: int
    state_at_end: int


Spoil = Callable[[Any], Message | None]  # of a good message the bad one


def fields(stream: Stream[Any]) -> list[str]:
    kind: Any = stream.message_type
    return [field.name for field in fields_of(kind) if field.wire_type in FRACTIONS]


CASES = [(stream, name, kind) for stream in ROBOT_OF for name in fields(stream) for kind in KINDS]
LIKE_OTHERS = ("infinite", "1e300")  # kinds that are refused as the others are: further tests
# A sensor that an emulated robot has not, and a rate and a drive that are still possible when they are so much larger.
HARMLESS = {(MOTOR_FEEDBACK, name, "thousandfold") for name in ("current_left", "current_right", "temperature")}


def in_two_lanes(cases: list[tuple[Stream[Any], str, str]]) -> list[Any]:
    """Return cases, of which CI leaves out the kinds of LIKE_OTHERS."""
    left_out = [case for case in cases if case[2] in LIKE_OTHERS]
    return [*(case for case in cases if case not in left_out), *further(*left_out)]


def spoiled(name: str, kind: str) -> Spoil:
    def spoil(message: Any) -> Any:
        bad, value = copy.copy(message), getattr(message, name)
        worse = KINDS[kind]
        setattr(bad, name, [worse(one) for one in value] if isinstance(value, list) else worse(value))
        return bad

    return spoil


def replaced(name: str, value: int) -> Spoil:
    def spoil(message: Any) -> Any:
        bad = copy.copy(message)
        setattr(bad, name, value)
        return bad

    return spoil


def shifted(offset: int) -> Spoil:
    def spoil(message: Any) -> Any:
        bad = copy.copy(message)
        bad.utime += offset
        return bad

    return spoil


def frozen() -> Spoil:
    """Return what sends the same message again and again."""
    first: list[Message] = []

    def spoil(message: Any) -> Any:
        first.append(message)
        return first[0]

    return spoil


@cache
def good_messages() -> list[tuple[str, Any]]:
    """Return what comes from a real robot, a controller and a planner of virtual ones, and another simulator."""
    everything: list[tuple[str, Any]] = []
    for channel, message in messages(DEFAULT, seconds=6.0):
        everything.append((channel, message))
        if isinstance(message, motor_command_t):
            duties = {"left": 0.3, "right": 0.4}
            command = make(motor_command_t, utime=message.utime, robot_id=COMMANDED, **duties)
            everything.append((MOTOR_COMMAND.channel(COMMANDED), command))
            everything.append((WORLD_STATE.name, others_world(message.utime)))
    return everything


def others_world(utime: int) -> Any:
    x = 0.1 + (utime - EPOCH) * 1e-7
    one = {"x": [x], "y": [4.0], "theta": [0.1], "psi_left": [2.5], "psi_right": [2.6]}
    return make(
        world_state_t, utime=utime, robot_id=[OTHER], origin=[VIRTUAL], **one, domega_left=[0.1], domega_right=[0.1]
    )


def path_message(utime: int) -> Any:
    return make(waypoints_t, utime=utime, robot_id=SENT, x=list(PATH[0]), y=list(PATH[1]))


def run(
    folder: Path, stream: Stream[Any] | None = None, spoil: Spoil | None = None, *, instead: bool = False
) -> Outcome:
    """Let a world live through it all, for half a second with bad messages after good ones of a stream, or instead."""
    file = folder / "robot_0.yaml"
    TRUE.save(file)
    virtual = [
        VirtualRobot(COMMANDED, Commanded(), parameters_of=0, x=-3.0),
        VirtualRobot(SENT, make_behaviour("waypoints", {}), parameters_of=0, y=-2.0),
    ]
    world = World(virtual, lambda robot_id: ParameterFollower(robot_id, file if robot_id == 0 else None))
    channel = stream.channel(ROBOT_OF[stream]) if stream is not None else ""
    report, state = "", process_status_t.RUNNING
    now = EPOCH
    world.advance(now)
    world.handle(now, WAYPOINTS.channel(SENT), path_message(now))
    for name, message in good_messages():
        if message.utime > now:
            world.advance(now)
            assert np.isfinite([robot.state for robot in world.robots()]).all()
            now = message.utime
            if channel.startswith(WAYPOINTS.name) and BAD_FROM <= now <= BAD_UNTIL and spoil is not None:
                hand_over(world, channel, spoil(path_message(now)))
        if now == BAD_UNTIL + 10_000 and not report:
            report, state = reported(world)
        if now > END:
            break
        is_bad_time = name == channel and BAD_FROM <= now <= BAD_UNTIL and spoil is not None
        if not (is_bad_time and instead):
            world.handle(message.utime, name, message)
        if is_bad_time:
            assert spoil is not None
            hand_over(world, name, spoil(message))
    states = dict(everybody(world))
    world.advance(END + 3_010_000)
    return Outcome(states, report, state, reported(world)[1])


def hand_over(world: World, channel: str, message: Message | None) -> None:
    if message is not None:
        world.handle(message.utime, channel, message)


def everybody(world: World) -> Iterator[tuple[tuple[int, int], tuple[float, ...]]]:
    for robot in world.robots():
        yield (robot.robot_id, robot.origin), tuple(robot.state)
    other = world.view.robot(OTHER)
    if other is not None:
        yield (OTHER, VIRTUAL), tuple(other.state)


def reported(world: World) -> tuple[str, int]:
    """Return what cmr-sim says on PROCESS_STATUS, and its state."""
    with Process("cmr-sim", "memq://") as process:
        SIM._announce(world, SIM.Loader([]), process, SIM.Lateness(), SIM.Owners(()))
        return process._full_message(), process.state


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("clean"))


def assert_unharmed(outcome: Outcome, clean: Outcome) -> None:
    """Check that the real robot is as near to where it would have been as one pose says, and others exactly there."""
    assert outcome.states.keys() == clean.states.keys()
    for key, state in outcome.states.items():
        if key[1] != REAL:
            assert state == pytest.approx(clean.states[key], abs=1e-9), key
            continue
        there = clean.states[key]
        for k in range(3):
            assert abs(math.remainder(state[k] - there[k], math.tau)) <= POSE_STD[k], (k, state[k], there[k])
    assert outcome.state_at_end == clean.state_at_end


def test_nothing_is_refused_of_what_is_good(clean: Outcome) -> None:
    assert clean.states.keys() == {(0, REAL), (0, TWIN), (COMMANDED, VIRTUAL), (SENT, VIRTUAL), (OTHER, VIRTUAL)}
    assert clean.report == ""
    assert clean.state == clean.state_at_end == process_status_t.RUNNING


@pytest.mark.parametrize(("stream", "name", "kind"), in_two_lanes(CASES), ids=lambda one: getattr(one, "name", one))
def test_a_number_that_cannot_be_is_refused_and_reported(
    stream: Stream[Any], name: str, kind: str, tmp_path: Path, clean: Outcome
) -> None:
    outcome = run(tmp_path, stream, spoiled(name, kind))
    assert_unharmed(outcome, clean)
    passes_unnoticed = kind == "no number" and fields_unknown(stream, name)
    if (
        not passes_unnoticed
        and (stream, name, kind) not in HARMLESS
        and (stream, kind) != (WORLD_STATE, "thousandfold")
    ):
        assert stream.channel(ROBOT_OF[stream]) in outcome.report
        assert outcome.state == process_status_t.DEGRADED


@pytest.mark.parametrize("value", ["2^62", *further("-2^62")])
@pytest.mark.parametrize(("stream", "name"), WHOLE_NUMBERS, ids=lambda one: getattr(one, "name", one))
def test_a_count_or_a_second_stamp_that_cannot_be_is_refused_and_reported(
    stream: Stream[Any], name: str, value: str, tmp_path: Path, clean: Outcome
) -> None:
    for instead in (False, True):
        outcome = run(tmp_path, stream, replaced(name, WHOLE[value]), instead=instead)
        assert_unharmed(outcome, clean)
        assert f"{stream.channel(0)} {name} impossible" in outcome.report
        assert outcome.state == process_status_t.DEGRADED


def fields_unknown(stream: Stream[Any], name: str) -> bool:
    """Return whether no number is what a field holds that a robot has no sensor for."""
    return stream is MOTOR_FEEDBACK and not name.startswith("psi")


@pytest.mark.parametrize(
    ("stream", "name", "kind"),
    in_two_lanes([case for case in CASES if case[0] in SENSORS]),
    ids=lambda one: getattr(one, "name", one),
)
def test_a_sensor_that_sends_nothing_else_for_half_a_second_harms_nobody_for_longer(
    stream: Stream[Any], name: str, kind: str, tmp_path: Path, clean: Outcome
) -> None:
    assert_unharmed(run(tmp_path, stream, spoiled(name, kind), instead=True), clean)


@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("stream", ROBOT_OF, ids=lambda one: one.name)
def test_a_stamp_of_another_hour_is_refused_and_reported(
    stream: Stream[Any], kind: str, tmp_path: Path, clean: Outcome
) -> None:
    outcome = run(tmp_path, stream, shifted(STAMPS[kind]))
    assert_unharmed(outcome, clean)
    assert outcome.state == process_status_t.DEGRADED
    if stream is WORLD_STATE:
        assert "Robots of another cmr-sim are not shown" in outcome.report
    else:
        assert stream.channel(ROBOT_OF[stream]) in outcome.report


@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("stream", SENSORS, ids=lambda one: one.name)
def test_a_sensor_whose_clock_is_another_hours_for_half_a_second_is_used_again_after_it(
    stream: Stream[Any], kind: str, tmp_path: Path, clean: Outcome
) -> None:
    assert_unharmed(run(tmp_path, stream, shifted(STAMPS[kind]), instead=True), clean)


@pytest.mark.parametrize("stream", [s for s in ROBOT_OF if s is not WAYPOINTS], ids=lambda one: one.name)
def test_a_message_that_comes_again_and_again_changes_nothing(
    stream: Stream[Any], tmp_path: Path, clean: Outcome
) -> None:
    outcome = run(tmp_path, stream, frozen())
    assert_unharmed(outcome, clean)
    if stream in SENSORS:
        assert stream.channel(ROBOT_OF[stream]) in outcome.report
