"""Simulated robots together: each by its own parameters, effects included, thousands at once, without any pause."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.bus import Bus
from cmr.bus.messages import make
from cmr.bus.streams import PARAMETERS, WORLD_STATE
from cmr.model.fleet import Fleet as Model
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.msg import world_state_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour
from cmr.world.deciding import LARGEST_TURN
from cmr.world.fleet import STEP, Fleet
from cmr.world.loading import Loader
from cmr.world.view import REAL, TWIN, VIRTUAL, Robot, Robots, WorldView, world_messages
from cmr.world.world import VirtualRobot, World

pytestmark = pytest.mark.slow

EPOCH = 1_700_000_000_000_000  # us
PAPER = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
EFFECTS = {"electrical_lag": 0.05, "motor_heating": 0.06}
DUTIES = (0.3, 0.5)
PATIENCE = 300.0  # s for a compiler that nobody has run before, on a busy machine


class Steady(Behaviour):
    """Drives an arc, and counts how often it is asked."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def command(self, utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        self.asked.append(utime)
        return DUTIES


def file_of(effects: Mapping[str, float], robot_id: int = 0) -> ParameterFile:
    """Return a file with effects that have one parameter each, of the same name."""
    values = {name: Value(value) for name, value in {**PAPER, **effects}.items()}
    return ParameterFile(robot_id, values, tuple(effects))


def world_of(
    file: ParameterFile, virtual: list[VirtualRobot], ready: Callable[[RobotParameters], bool] = lambda _model: True
) -> World:
    world = World(virtual, ParameterFollower, ready)
    announce(world, file, 1)
    return world


def announce(world: World, file: ParameterFile, sequence: int) -> None:
    world.handle(EPOCH, PARAMETERS.channel(file.robot_id), file.announcement(sequence))


def step(world: World, steps: int, begin: int = EPOCH) -> int:
    """Let time pass step by step; return the time at which the next step is due."""
    for k in range(steps):
        world.advance(begin + k * STEP)
    return begin + steps * STEP


def simulated(parameters: RobotParameters, steps: int, fleet: Model | None = None) -> tuple[Model, RobotState]:
    """Return the model's own fleet, with one robot, and its state after steps at DUTIES."""
    if fleet is None:
        fleet = Model(STEP * 1e-6)
        fleet.add(RobotState.at_rest(np.zeros(1)), parameters)
        fleet.command(slice(0, 1), *DUTIES)
    fleet.advance(steps)
    return fleet, fleet.states()


# By its parameters


def test_a_robot_with_effects_moves_as_its_file_says() -> None:
    file = file_of(EFFECTS)
    world = world_of(file, [VirtualRobot(7, Steady(), 0)])
    step(world, 101)  # the first step comes before the first command
    (robot,) = world.robots()
    _, expected = simulated(file.robot_parameters, 100)
    assert robot.state == pytest.approx([values[0] for values in expected], rel=1e-12, abs=1e-15)
    _, without_effects = simulated(RobotParameters.of(PAPER), 100)
    assert abs(robot.state.x - without_effects.x[0]) > 1e-3


def test_effects_are_taken_over_while_driving_without_a_jump_and_with_their_memory() -> None:
    """Another robot gets effects, and the first one loses none of what it remembers, such as heat."""
    warm = file_of(EFFECTS)
    world = world_of(warm, [VirtualRobot(7, Steady(), 0), VirtualRobot(8, Steady(), 1, x=3.0)])
    announce(world, file_of({}, 1), 1)
    due = step(world, 101)
    before = world.robots()
    announce(world, file_of({"battery_sag": 0.2}, 1), 2)
    assert world.robots() == before
    step(world, 50, due)
    first, second = world.robots()
    _, expected = simulated(warm.robot_parameters, 150)
    assert first.state == pytest.approx([values[0] for values in expected], rel=1e-12, abs=1e-15)
    assert second.state.psi_left < before[1].state.psi_left


def test_a_file_that_lacks_parameters_leaves_those_in_use() -> None:
    behaviour = Steady()
    world = world_of(file_of({}), [VirtualRobot(7, behaviour, 0)])
    due = step(world, 10)
    announce(world, ParameterFile(0, {"wheel_radius": Value(0.1)}), 2)
    step(world, 90, due)
    assert len(behaviour.asked) == 100
    (robot,) = world.robots()
    _, expected = simulated(RobotParameters.of(PAPER), 99)
    assert robot.state.x == pytest.approx(expected.x[0], rel=1e-12)


# Without any pause


def test_robots_stand_where_they_start_until_their_model_is_ready() -> None:
    ready = threading.Event()
    behaviour = Steady()
    world = world_of(file_of({}), [VirtualRobot(7, behaviour, 0, 1.0, 2.0, 3.0)], lambda _model: ready.is_set())
    due = step(world, 50)
    (robot,) = world.robots()
    assert robot == Robot(due - STEP, 7, VIRTUAL, RobotState.at_rest(1.0, 2.0, 3.0))
    assert not behaviour.asked
    ready.set()
    step(world, 50, due)
    assert world.robots()[0].state.psi_left > 1.0


def test_robots_go_on_as_before_until_a_new_model_is_ready() -> None:
    world = world_of(file_of({}), [VirtualRobot(7, Steady(), 0)], lambda model: not model.effects)
    due = step(world, 50)
    announce(world, file_of(EFFECTS), 2)
    step(world, 51, due)
    (robot,) = world.robots()
    _, expected = simulated(RobotParameters.of(PAPER), 100)
    assert robot.state.x == pytest.approx(expected.x[0], rel=1e-12)


def test_what_takes_long_to_load_is_ready_in_the_end() -> None:
    loader = Loader()
    wait_until(lambda: loader.ready(RobotParameters.of({**PAPER, **EFFECTS})))
    assert loader.ready(RobotParameters.of({**EFFECTS, **PAPER}))
    wait_until(lambda: not loader.message)


def test_a_model_that_cannot_be_loaded_is_told_and_never_ready() -> None:
    loader = Loader()
    wrong = RobotParameters.of({**PAPER, "no_such_effect": 1.0})
    assert not loader.ready(wrong)
    wait_until(lambda: bool(loader.message))
    assert "no_such_effect" in loader.message
    assert not loader.ready(wrong)
    wait_until(lambda: loader.ready(RobotParameters.of(PAPER)))
    wait_until(lambda: not loader.message)


def wait_until(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("module", ["cmr.commands.sim", "cmr.commands.pilot", "robot_driver.main"])
def test_no_process_waits_for_a_compiler_or_for_what_it_does_not_use(module: str) -> None:
    script = f"import sys, {module}; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not set(result.stdout.split()) & {"numba", "scipy", "matplotlib", "importlib.metadata"}


@pytest.fixture
def sim(url: str, tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """A function that starts cmr-sim with a virtual robot that drives by a file."""
    running = []

    def start(file: ParameterFile, **environment: str) -> "subprocess.Popen[str]":
        file.save(tmp_path / "robot_0.yaml")
        program = str(Path(sys.executable).parent / "cmr-sim")
        command = [program, "--virtual", "10=figure_eight,start=0", "--parameters", str(tmp_path), "--lcm-url", url]
        environment = os.environ | environment
        running.append(subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True))
        return running[0]

    yield start
    for process in running:
        process.kill()
        process.communicate()


def listen(url: str, happened: Callable[[Any], bool]) -> Any:
    """Return the first world_state_t of which something is true."""
    bus = Bus(url)
    bus.subscribe(WORLD_STATE, every=True)
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        for received in bus.receive(0.1):
            if happened(received.message):
                return received.message
    raise AssertionError("it did not happen")


@pytest.mark.slow
def test_cmr_sim_runs_a_file_with_effects_as_it_is(sim: Callable[..., "subprocess.Popen[str]"], url: str) -> None:
    sim(file_of({**EFFECTS, "gyro_bias": 0.01}))
    message = listen(url, lambda message: message.psi_left[0] > 1.0)
    assert (message.robot_id, message.origin) == ((10,), (VIRTUAL,))


def test_a_world_is_there_and_can_be_stopped_while_its_model_is_compiled(
    sim: Callable[..., "subprocess.Popen[str]"], url: str, tmp_path: Path
) -> None:
    process = sim(file_of({}), NUMBA_CACHE_DIR=str(tmp_path / "empty"))
    message = listen(url, lambda _message: True)
    assert (message.robot_id, message.psi_left) == ((10,), (0.0,))
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert all(line.startswith("cmr-sim: ") for line in said.splitlines()), said
    assert not list((tmp_path / "empty").rglob("*.nbc")), "it was compiled by then, so nothing was tested"


# Thousands


def test_thousands_of_robots_each_take_their_turn() -> None:
    behaviours = [Steady() for _ in range(2 * LARGEST_TURN + 500)]
    robots = [VirtualRobot(index, behaviour, 0, x=float(index)) for index, behaviour in enumerate(behaviours)]
    world = world_of(file_of({}), robots)
    step(world, 61)
    turns = 3
    for behaviour in behaviours:
        assert len(behaviour.asked) >= 60 // turns
        assert set(np.diff(behaviour.asked)) == {turns * STEP}
    everybody = world.everybody()
    assert everybody.robot_id == tuple(range(len(robots)))
    assert np.all(np.asarray(everybody.state.psi_left) > 1.0)


def test_a_fleet_keeps_robots_and_their_order_apart() -> None:
    fleet = Fleet()
    parameters = RobotParameters.of(PAPER)
    fleet.place([(3, VIRTUAL), (1, VIRTUAL)], RobotState.at_rest(np.array([3.0, 1.0])), parameters)
    fleet.place([(1, TWIN)], RobotState.at_rest(np.array([-1.0])), parameters)
    fleet.command(1, [(0.5, 0.5), (2.0, -2.0)])
    assert fleet.advance(EPOCH)
    robots = fleet.robots()
    assert (robots.robot_id, robots.origin) == ((3, 1, 1), (VIRTUAL, VIRTUAL, TWIN))
    full_duty = 118.0 * -np.expm1(-0.054 * 118.0 * 0.01) / (0.054 * 118.0)  # rad/s after one step
    assert robots.state.psi_left == pytest.approx([0.0, 0.5 * full_duty, full_duty], rel=1e-12)
    assert robots.state.psi_right == pytest.approx([0.0, 0.5 * full_duty, -full_duty], rel=1e-12)
    fleet.place([(1, TWIN)], RobotState.at_rest(np.array([5.0])), parameters)
    assert fleet.robots().state.x[2] == 5.0


# On the wire

numbers = st.floats(-1e30, 1e30) | st.just(float("nan"))
states = st.builds(RobotState, *[numbers] * len(RobotState._fields))
single = st.builds(Robot, st.just(EPOCH), st.integers(0, 2**31 - 1), st.sampled_from([REAL, VIRTUAL, TWIN]), states)


@given(st.lists(single, min_size=1, max_size=20))
def test_messages_from_arrays_are_byte_for_byte_those_of_the_generated_class(robots: list[Robot]) -> None:
    columns = zip(*(robot.state for robot in robots), strict=True)
    generated = make(
        world_state_t,
        utime=EPOCH,
        robot_id=[robot.robot_id for robot in robots],
        origin=[robot.origin for robot in robots],
        **dict(zip(RobotState._fields, map(list, columns), strict=True)),
    )
    (message,) = world_messages(EPOCH, Robots.of(robots))
    assert message.encode() == generated.encode()


@given(st.lists(st.tuples(st.sets(st.integers(0, 6), min_size=1), st.booleans()), max_size=12))
def test_the_view_has_each_robots_newest_state_however_messages_are_divided(parts: list[tuple[set[int], bool]]) -> None:
    view, newest = WorldView(), dict[int, int]()
    for count, (ids, singly) in enumerate(parts):
        robots = [Robot(EPOCH + count, i, VIRTUAL, RobotState.at_rest(float(count), i)) for i in sorted(ids)]
        newest.update(dict.fromkeys(ids, count))
        for message in (m for r in robots for m in world_messages(EPOCH + count, [r])) if singly else ():
            view.handle(EPOCH + count, "WORLD_STATE", message)
        if not singly:
            view.take(EPOCH + count, Robots.of(robots))
    for robot_id, count in newest.items():
        expected: Any = Robot(EPOCH + count, robot_id, VIRTUAL, RobotState.at_rest(float(count), float(robot_id)))
        assert view.robot(robot_id) == expected
    assert view.robot(7) is None
