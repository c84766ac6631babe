"""No message, whatever stands in it, moves or stops a robot that its pilot knows enough to drive."""

import copy
import math
from pathlib import Path
from typing import Any

import pytest

from cmr.bus.gate import AHEAD, BEHIND
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.possible import OUT_OF_REACH
from cmr.bus.streams import MOTOR_FEEDBACK, POSE, WAYPOINTS, WORLD_STATE, Stream
from cmr.geometry.obstacles import Geofence
from cmr.model.motion import RobotState
from cmr.msg import motor_command_t, motor_feedback_t, pose_xyt_t, waypoints_t
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import make_behaviour
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, Robot, world_messages
from tests.support.emulated_drive import EPOCH
from tests.support.typed_messages import as_a
from tests.world.test_poisoned_messages import KINDS, fields
from tests.world.test_world import TRUE

pytestmark = pytest.mark.slow

PERIOD = 20_000  # us
HOUR = 3_600_000_000
ROOM = Geofence([(-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0)])
HEARD: tuple[Stream[Any], ...] = (POSE, MOTOR_FEEDBACK, WAYPOINTS, WORLD_STATE)
CASES = [(stream, name, kind) for stream in HEARD for name in fields(stream) for kind in KINDS]


class Bench:
    """A pilot of a robot that stands at (1, 1) and is to drive to (3, 1), and the messages that it gets."""

    def __init__(self, folder: Path) -> None:
        file = folder / "robot_0.yaml"
        TRUE.save(file)
        self.pilot = Pilot(0, make_behaviour("waypoints", {}), ParameterFollower(0, file), geofence=ROOM)
        self.pilot.prepare()
        self.utime = EPOCH
        self.pilot.turn(self.utime)
        for message in world_messages(self.utime, [self.robot()]):
            self.pilot.handle(self.utime, WORLD_STATE.name, message)
        self.hand(WAYPOINTS, self.good(WAYPOINTS))

    def robot(self) -> Robot:
        return Robot(self.utime, 0, REAL, RobotState(1.0, 1.0, 0.1, 0.2, 0.2, 0.1, 0.1))

    def good(self, stream: Stream[Any]) -> Any:
        """Return a message that is right at the moment."""
        if stream is WORLD_STATE:
            (world,) = world_messages(self.utime, [self.robot()])
            for name in fields(WORLD_STATE):
                setattr(world, name, list(getattr(world, name)))
            return world
        if stream is POSE:
            return make(pose_xyt_t, utime=self.utime, robot_id=0, x=1.0, y=1.0, theta=0.1)
        if stream is WAYPOINTS:
            return make(waypoints_t, utime=self.utime, robot_id=0, x=[2.0, 3.0], y=[1.0, 1.0])
        feedback = motor_feedback_t()
        feedback.utime, feedback.psi_left, feedback.psi_right, feedback.battery_voltage = self.utime, 0.2, 0.2, 12.0
        return feedback

    def hand(self, stream: Stream[Any], message: Message) -> None:
        self.pilot.handle(message.utime, WORLD_STATE.name if stream is WORLD_STATE else stream.channel(0), message)

    def turns(self, count: int, bad: Any = None, stream: Stream[Any] | None = None) -> list[float]:
        """Return what the right wheel was commanded in turns of 20 ms; with bad messages after the good ones."""
        duties = []
        for _ in range(count):
            self.utime += PERIOD
            self.pilot.turn(self.utime)
            for good in (WORLD_STATE, POSE, MOTOR_FEEDBACK):
                self.hand(good, self.good(good))
            if stream is not None:
                self.hand(stream, bad(self.good(stream)))
            duties.append(as_a(motor_command_t, self.pilot.command(self.utime)).right)
        return duties


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    ready = Bench(tmp_path)
    assert ready.turns(20)[-1] > 0.1
    return ready


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> list[float]:
    """What is commanded in the 25 turns after the first 20 where all messages are good."""
    return Bench(tmp_path_factory.mktemp("clean")).turns(45)[20:]


def spoiled(name: str, kind: str, message: Any) -> Any:
    bad, value = copy.copy(message), getattr(message, name)
    setattr(bad, name, [KINDS[kind](one) for one in value] if isinstance(value, list) else KINDS[kind](value))
    return bad


# A pose outside of the geofence stops a robot for half a second (test_pilot_guards.py); speeds, headings may be so.
POSSIBLE = {POSE: ("x", "y", "theta"), WORLD_STATE: fields(WORLD_STATE), MOTOR_FEEDBACK: fields(MOTOR_FEEDBACK)}
REFUSED = [c for c in CASES if not (c[2] == "thousandfold" and c[1] in POSSIBLE.get(c[0], ()))]


@pytest.mark.parametrize(("stream", "name", "kind"), REFUSED, ids=lambda one: getattr(one, "name", one))
def test_a_number_that_cannot_be_changes_nothing(
    bench: Bench, clean: list[float], stream: Stream[Any], name: str, kind: str
) -> None:
    assert bench.turns(25, lambda message: spoiled(name, kind, message), stream) == clean
    unknown = stream is MOTOR_FEEDBACK and not name.startswith("psi")
    if not (unknown and kind == "no number"):
        assert stream.name in bench.pilot.gate.problem()


@pytest.mark.parametrize("name", ["theta", "domega_left", "domega_right"])
def test_a_number_that_may_be_is_forgotten_at_the_next_message(bench: Bench, clean: list[float], name: str) -> None:
    bench.turns(24, lambda message: spoiled(name, "thousandfold", message), WORLD_STATE)
    assert bench.turns(1)[0] == pytest.approx(clean[-1], abs=0.15)
    assert bench.pilot.waiting_for == bench.pilot.left_fence == ""


@pytest.mark.parametrize(("offset", "said"), [(HOUR, AHEAD), (-HOUR, BEHIND)])
@pytest.mark.parametrize("stream", HEARD, ids=lambda one: one.name)
def test_a_stamp_of_another_hour_changes_nothing(
    bench: Bench, clean: list[float], stream: Stream[Any], offset: int, said: str
) -> None:
    def shifted(message: Any) -> Any:
        message.utime += offset
        return message

    assert bench.turns(25, shifted, stream) == clean
    if stream is not POSE:  # whose stamps are waited for, and spoken of, where no others come
        assert said in bench.pilot.gate.problem()


def test_a_world_of_an_hour_ahead_is_not_driven_by_when_the_simulator_is_gone(bench: Bench) -> None:
    ahead = bench.good(WORLD_STATE)
    ahead.utime += HOUR
    bench.hand(WORLD_STATE, ahead)
    bench.utime += 600_000
    bench.pilot.turn(bench.utime)
    bench.hand(POSE, bench.good(POSE))
    assert as_a(motor_command_t, bench.pilot.command(bench.utime)).right == 0.0
    assert "WORLD_STATE" in bench.pilot.waiting_for


def test_a_path_too_far_away_is_refused(bench: Bench) -> None:
    far = make(waypoints_t, utime=bench.utime, robot_id=0, x=[1_000.0], y=[1.0])
    bench.hand(WAYPOINTS, far)
    assert OUT_OF_REACH in bench.pilot.gate.problem()
    assert math.isfinite(bench.turns(1)[0])
