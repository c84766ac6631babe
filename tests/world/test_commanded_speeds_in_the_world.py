"""Robots that are told how fast to go: twins and virtual robots take the same commands, and pilots send them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.bus.streams import ESTOP, MOTOR_FEEDBACK, WORLD_STATE
from cmr.model.body import forward, turn
from cmr.model.motion import RobotState
from cmr.msg import estop_t, motor_feedback_t, velocity_command_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.recordings.arrivals import COMMANDS_OF
from cmr.recordings.commanding import asked_by
from cmr.world.behaviours import Follow
from cmr.world.behaviours.commanded import Commanded
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, TWIN, VIRTUAL, Robot, world_messages
from cmr.world.world import VirtualRobot, World
from tests.support.emulated_drive import EPOCH, TRUTH

RADIUS, WIDTH, COMMAND_WIDTH, TOP = 0.1, 0.5, 0.4, 10.0
V, OMEGA = 0.3, 0.5
WHEELS = ((V - OMEGA * COMMAND_WIDTH / 2.0) / RADIUS, (V + OMEGA * COMMAND_WIDTH / 2.0) / RADIUS)
ASKED: Mapping[str, dict[str, float]] = {  # the same motion in each kind of command
    "velocity": {"v": V, "omega": OMEGA},
    "wheel_speed": {"psi_left": WHEELS[0], "psi_right": WHEELS[1]},
    "duty": {"left": WHEELS[0] / TOP, "right": WHEELS[1] / TOP},
}
CONTROLLED = ParameterFile(
    0,
    {
        "wheel_radius": Value(RADIUS),
        "base_width": Value(WIDTH),
        "response_time": Value(0.2),
        "top_wheel_speed": Value(TOP),
        "command_base_width": Value(COMMAND_WIDTH),
    },
)
MOTORS = ParameterFile(0, {"wheel_radius": Value(0.04)} | {name: Value(value) for name, value in TRUTH.items()})
TICK = 10_000  # us


def world_of(folder: Path, *virtual: VirtualRobot) -> World:
    CONTROLLED.save(folder / "robot_0.yaml")
    return World(list(virtual), lambda robot_id: ParameterFollower(robot_id, folder / "robot_0.yaml"))


def command(kind: str, utime: int, robot_id: int) -> tuple[str, Any]:
    stream = COMMANDS_OF[kind]
    return stream.channel(robot_id), make(stream.message_type, utime=utime, robot_id=robot_id, **ASKED[kind])


def feedback(utime: int) -> Any:
    unknown = ("applied_left", "applied_right", "current_left", "current_right", "battery_voltage", "temperature")
    counts = dict.fromkeys(("ticks_left", "ticks_right", "psi_left", "psi_right", "status", "applied_utime"), 0)
    return make(
        motor_feedback_t,
        utime=utime,
        received_utime=utime,
        robot_id=0,
        **counts,
        **dict.fromkeys(unknown, float("nan")),
    )


def speeds_of(world: World, key: tuple[int, int]) -> tuple[float, float]:
    """Return forward speed and turn rate of a robot."""
    state = next(robot.state for robot in world.robots() if (robot.robot_id, robot.origin) == key)
    parameters = CONTROLLED.robot_parameters
    return (
        float(forward(state.psi_left, state.psi_right, parameters)),
        float(turn(state.psi_left, state.psi_right, parameters)),
    )


def run(world: World, kind: str, robot_id: int, seconds: float, first: int = EPOCH, *, driven: bool = True) -> int:
    for number in range(round(seconds * 1e6) // TICK):
        utime = first + number * TICK
        world.handle(utime, MOTOR_FEEDBACK.channel(0), feedback(utime))
        if driven:
            world.handle(utime, *command(kind, utime, robot_id))
        world.advance(utime)
    return utime + TICK


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["velocity", "wheel_speed"])
def test_the_twin_takes_the_same_commands_as_its_robot(kind: str, tmp_path: Path) -> None:
    world = world_of(tmp_path)
    run(world, kind, 0, 3.0)
    # The ground turns it by its own width.
    assert speeds_of(world, (0, TWIN)) == pytest.approx((V, OMEGA * COMMAND_WIDTH / WIDTH), rel=1e-3)


@pytest.mark.parametrize("kind", COMMANDS_OF)
def test_a_virtual_robot_takes_every_kind_of_command_for_half_a_second(kind: str, tmp_path: Path) -> None:
    world = world_of(tmp_path, VirtualRobot(7, Commanded(), parameters_of=0))
    utime = run(world, kind, 7, 3.0)
    assert speeds_of(world, (7, VIRTUAL)) == pytest.approx((V, OMEGA * COMMAND_WIDTH / WIDTH), rel=1e-3)
    utime = run(world, kind, 7, 0.4, utime, driven=False)
    assert speeds_of(world, (7, VIRTUAL))[0] == pytest.approx(V, rel=1e-3)
    run(world, kind, 7, 2.0, utime, driven=False)
    assert speeds_of(world, (7, VIRTUAL))[0] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("kind", COMMANDS_OF)
def test_an_emergency_stop_holds_for_twins_whatever_they_are_commanded(kind: str, tmp_path: Path) -> None:
    world = world_of(tmp_path)
    utime = run(world, kind, 0, 1.0)
    stop = make(estop_t, utime=utime, engaged=True, source="test", reason="test")
    world.handle(utime, ESTOP.name, stop)
    run(world, kind, 0, 2.0, utime)
    assert speeds_of(world, (0, TWIN))[0] == pytest.approx(0.0, abs=0.01)


def pilot_of(folder: Path, parameters: ParameterFile, kind: str | None = None) -> Pilot:
    parameters.save(folder / "robot_0.yaml")
    return Pilot(0, Follow(leader=10, gap=0.5), ParameterFollower(0, folder / "robot_0.yaml"), kind=kind)


def piloted(pilot: Pilot, utime: int) -> Any:
    far = RobotState(3.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for now in range(utime, utime + 400_000, 20_000):
        robots = [Robot(now, 0, REAL, RobotState.at_rest()), Robot(now, 10, VIRTUAL, far)]
        (message,) = world_messages(now, robots)
        pilot.handle(now, WORLD_STATE.name, message)
        last = pilot.command(now)
    return last


def test_a_pilot_commands_what_the_robots_parameters_ask_for(tmp_path: Path) -> None:
    pilot = pilot_of(tmp_path, CONTROLLED)
    told = piloted(pilot, EPOCH)
    assert isinstance(told, velocity_command_t)
    assert 0.0 < told.v <= TOP * RADIUS
    assert told.omega > 0.0
    assert pilot.kind == "velocity"
    assert asked_by(pilot.stop()) == (0.0, 0.0)
    assert isinstance(piloted(pilot_of(tmp_path, MOTORS), EPOCH), COMMANDS_OF["duty"].message_type)


def test_wheel_speeds_and_velocities_of_a_pilot_ask_for_the_same(tmp_path: Path) -> None:
    body = piloted(pilot_of(tmp_path, CONTROLLED), EPOCH)
    wheels = piloted(pilot_of(tmp_path, CONTROLLED, "wheel_speed"), EPOCH)
    asked = CONTROLLED.velocity_controller
    assert asked is not None
    assert np.allclose(asked.wheels_of_body(body.v, body.omega), (wheels.psi_left, wheels.psi_right))


@pytest.mark.parametrize(("parameters", "kind"), [(MOTORS, "velocity"), (CONTROLLED, "duty")])
def test_a_pilot_does_not_drive_by_commands_that_the_robot_does_not_take(
    parameters: ParameterFile, kind: str, tmp_path: Path
) -> None:
    pilot = pilot_of(tmp_path, parameters, kind)
    told = piloted(pilot, EPOCH)
    assert {getattr(told, name) for name in ASKED[kind]} == {0.0}
    assert "--command" in pilot.waiting_for


@pytest.mark.parametrize("kind", ["velocity", "wheel_speed"])
def test_a_pilot_commands_zero_during_an_emergency_stop_and_first_after_it(kind: str, tmp_path: Path) -> None:
    pilot = pilot_of(tmp_path, CONTROLLED, kind)
    piloted(pilot, EPOCH)
    for engaged in (True, False):
        pilot.handle(EPOCH, ESTOP.name, make(estop_t, utime=EPOCH, engaged=engaged, source="hand", reason="a child"))
        told = pilot.command(EPOCH + 400_000)
        assert {getattr(told, name) for name in ASKED[kind]} == {0.0}
    told = piloted(pilot, EPOCH + 420_000)
    assert {getattr(told, name) for name in ASKED[kind]} != {0.0}
