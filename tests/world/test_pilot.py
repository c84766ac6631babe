"""The pilot of a real robot drives only when it knows enough, and never during an emergency stop."""

from pathlib import Path
from typing import Any

import pytest

from cmr.bus.messages import make
from cmr.bus.streams import ESTOP, ESTOP_LATCH, WORLD_STATE
from cmr.model.motion import RobotState
from cmr.msg import estop_t, motor_feedback_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.recordings.commanding import asked_by
from cmr.world.behaviours import Follow
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, VIRTUAL, Robot, world_messages
from tests.support.emulated_drive import EPOCH, TRUTH, messages
from tests.support.latches import latch

TRUE = ParameterFile(0, {"wheel_radius": Value(0.04)} | {name: Value(value) for name, value in TRUTH.items()})


@pytest.fixture
def pilot(tmp_path: Path) -> Pilot:
    file = tmp_path / "robot_0.yaml"
    TRUE.save(file)
    return Pilot(0, Follow(leader=10, gap=0.5), ParameterFollower(0, file))


def world_at(utime: int) -> Any:
    far = RobotState(3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    (message,) = world_messages(utime, [Robot(utime, 0, REAL, RobotState.at_rest()), Robot(utime, 10, VIRTUAL, far)])
    return message


def drive(pilot: Pilot, utime: int) -> Any:
    for k in range(20):
        pilot.handle(utime + k * 20_000, WORLD_STATE.name, world_at(utime + k * 20_000))
        last = pilot.command(utime + k * 20_000)
    return last


def test_it_drives_after_its_leader(pilot: Pilot) -> None:
    last = drive(pilot, EPOCH)
    assert last.left > 0.05
    assert last.right > 0.05
    assert pilot.waiting_for == ""


def test_it_stands_still_without_a_world(pilot: Pilot) -> None:
    assert asked_by(pilot.command(EPOCH)) == (0.0, 0.0)
    assert "cmr-sim" in pilot.waiting_for


def test_it_stops_when_the_world_falls_silent(pilot: Pilot) -> None:
    drive(pilot, EPOCH)
    late = pilot.command(EPOCH + 400_000 + 600_000)
    assert asked_by(late) == (0.0, 0.0)


def test_it_stands_still_without_parameters(tmp_path: Path) -> None:
    pilot = Pilot(0, Follow(leader=10), ParameterFollower(0, tmp_path / "missing.yaml"))
    assert drive(pilot, EPOCH).left == 0.0
    assert "parameters" in pilot.waiting_for


def test_what_writes_missing_parameters_is_named_without_a_full_stop_at_its_path(tmp_path: Path) -> None:
    pilot = Pilot(0, Follow(leader=10), ParameterFollower(0, tmp_path / "robot_0.yaml"))
    drive(pilot, EPOCH)
    assert pilot.waiting_for.endswith(f" There is no {tmp_path}/robot_0.yaml; `cmr init --out {tmp_path}` writes one")


def test_it_stops_for_an_emergency_stop_until_its_release(pilot: Pilot) -> None:
    drive(pilot, EPOCH)
    for engaged in (True, False):
        message = make(estop_t, utime=EPOCH, engaged=engaged, source="hand", reason="a child in the lab")
        pilot.handle(EPOCH, ESTOP.name, message)
        last = drive(pilot, EPOCH + 1_000_000)
        assert (last.left == 0.0) == engaged
        assert ("a child in the lab" in pilot.waiting_for) == engaged


def test_a_pilot_that_starts_later_stands_while_the_driver_holds_its_robot(pilot: Pilot) -> None:
    for engaged in (True, False):
        for robot_id in (7, 0) if engaged else (7,):
            pilot.handle(EPOCH, ESTOP_LATCH.channel(robot_id), latch(robot_id, engaged))
        last = drive(pilot, EPOCH + 1_000_000)
        assert last.left == 0.0
        assert "release of the emergency stop (Ada: smoke (robot" in pilot.waiting_for
    pilot.handle(EPOCH, ESTOP_LATCH.channel(0), latch(0, False))
    assert drive(pilot, EPOCH + 2_000_000).left > 0.05


def test_it_commands_zero_first_when_an_emergency_stop_was_released(pilot: Pilot) -> None:
    drive(pilot, EPOCH)
    for engaged in (True, False):
        message = make(estop_t, utime=EPOCH, engaged=engaged, source="hand", reason="a child in the lab")
        pilot.handle(EPOCH, ESTOP.name, message)
        command = pilot.command(EPOCH + 400_000)
        assert asked_by(command) == (0.0, 0.0)
    assert "zero" in pilot.waiting_for


def test_it_commands_zero_first_when_the_driver_has_been_started_again(pilot: Pilot) -> None:
    drive(pilot, EPOCH)
    (channel, stale), *_ = messages(seconds=0.1, channels=("MOTOR_FEEDBACK",))
    stale.status = motor_feedback_t.STATUS_COMMAND_STALE
    pilot.handle(EPOCH + 400_000, channel, stale)
    command = pilot.command(EPOCH + 400_000)
    assert asked_by(command) == (0.0, 0.0)
    assert "zero" in pilot.waiting_for
    assert drive(pilot, EPOCH + 420_000).left > 0.05


def test_it_stops_when_the_leader_leaves_the_world(pilot: Pilot) -> None:
    drive(pilot, EPOCH)
    utime = EPOCH + 2_000_000
    (alone,) = world_messages(utime, [Robot(utime, 0, REAL, RobotState.at_rest())])
    pilot.handle(utime, WORLD_STATE.name, alone)
    assert asked_by(pilot.command(utime))[0] == 0.0
