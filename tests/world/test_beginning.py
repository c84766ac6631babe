"""Robots of a run begin together: those that are ready first stand until all are."""

import math
from pathlib import Path

import pytest

from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.model.motion import RobotState
from cmr.msg import process_status_t
from cmr.parameters.following import ParameterFollower
from cmr.recordings.commanding import asked_by
from cmr.world.beginning import Beginning
from cmr.world.behaviours import FigureEight, Follow
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, VIRTUAL, Robot, world_messages
from cmr.world.world import VirtualRobot
from tests.support.emulated_drive import EPOCH
from tests.support.small_log import process_status
from tests.world.test_world import TRUE, robots, run, world_of

SPEED = 0.3  # m/s
FAR = RobotState(3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("process", "state", "begins"),
    [
        ("cmr-run", process_status_t.STARTING, False),
        ("cmr-run", process_status_t.STOPPING, False),
        ("cmr-sim", process_status_t.RUNNING, False),
        ("cmr-run", process_status_t.RUNNING, True),
        ("cmr-run", process_status_t.DEGRADED, True),
    ],
)
def test_it_begins_when_the_program_that_leads_is_ready_and_not_before(process: str, state: int, begins: bool) -> None:
    beginning = Beginning("cmr-run")
    beginning.handle(EPOCH, PROCESS_STATUS.name, process_status(EPOCH, process=process, state=state))
    assert beginning.begun is begins


def test_it_stays_begun_and_begins_at_once_where_nobody_leads() -> None:
    beginning = Beginning("cmr-run")
    for state in (process_status_t.RUNNING, process_status_t.STOPPING):
        beginning.handle(EPOCH, PROCESS_STATUS.name, process_status(EPOCH, process="cmr-run", state=state))
    assert beginning.begun
    assert Beginning("").begun


def test_a_virtual_leader_stands_until_then_and_its_drive_is_not_shorter_for_it(tmp_path: Path) -> None:
    TRUE.save(tmp_path / "robot_0.yaml")
    worlds = [
        world_of(tmp_path / "robot_0.yaml", VirtualRobot(10, FigureEight(start=0.0, speed=SPEED), parameters_of=0))
        for _ in range(2)
    ]
    waiting, other = worlds
    waiting.begun = False
    end = run(waiting, 5.0)
    stands = robots(waiting)[10, VIRTUAL].state
    assert (stands.x, stands.y, stands.psi_left, stands.psi_right) == (0.0, 0.0, 0.0, 0.0)
    waiting.begun = True
    run(waiting, 3.0, end + 10_000)
    run(other, 3.0)
    late, prompt = (robots(world)[10, VIRTUAL].state for world in worlds)
    assert math.hypot(late.x - prompt.x, late.y - prompt.y) < 2.0 * 0.01 * SPEED  # two steps of it
    assert math.hypot(late.x, late.y) > 0.3


def test_a_pilot_whose_run_has_not_begun_stands_and_waits_for_nothing_else(tmp_path: Path) -> None:
    TRUE.save(tmp_path / "robot_0.yaml")
    pilot = Pilot(0, Follow(leader=10, gap=0.5), ParameterFollower(0, tmp_path / "robot_0.yaml"))
    pilot.begun = False
    everybody = [Robot(EPOCH, 0, REAL, RobotState.at_rest()), Robot(EPOCH, 10, VIRTUAL, FAR)]
    (message,) = world_messages(EPOCH, everybody)
    for begun in (False, True):
        pilot.begun = begun
        for _ in range(20):
            pilot.handle(EPOCH, WORLD_STATE.name, message)
            last = asked_by(pilot.command(EPOCH))
        assert (last != (0.0, 0.0)) is begun
        assert pilot.waiting_for == ""
