"""Robots with a range sensor are told what they would see: virtual ones all of it, real ones what is only virtual."""

import math
import subprocess
import time
from collections import Counter
from pathlib import Path
from typing import Any

import lcm
import numpy as np
import pytest

from cmr.bus.bus import Bus
from cmr.bus.messages import make
from cmr.bus.streams import MOTOR_COMMAND, POSE, RANGE_SCAN, WORLD_STATE
from cmr.commands import sim_options
from cmr.commands.scenarios import parse
from cmr.commands.sim import _scanner, _scenario, main
from cmr.experiments.scenario.writing import to_yaml
from cmr.geometry.obstacles import Obstacles
from cmr.model.motion import RobotState
from cmr.msg import motor_command_t, motor_feedback_t, pose_xyt_t, range_scan_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.recordings.batch import read_robots
from cmr.world.behaviours.behaviour import Commanded
from cmr.world.fleet import STEP
from cmr.world.interaction.range_sensor import RangeSensor
from cmr.world.scanning import PERIOD, Scanner
from cmr.world.view import REAL, TWIN, VIRTUAL, Robot, world_messages
from cmr.world.world import VirtualRobot, World
from tests.support.bus_bench import PATIENCE, our_command
from tests.support.typed_messages import all_of

EPOCH = 1_700_000_000_000_000  # us
PAPER = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
RADIUS = 0.65 * 0.161  # m
AHEAD, LEFT, BEHIND, RIGHT = 180, 270, 0, 90  # rays of the usual sensor


class Bench:
    """A world in made-up time, and what its robots' range sensors told."""

    def __init__(
        self, *robots: VirtualRobot, real: dict[int, tuple[float, float, float]] | None = None, **obstacles: Any
    ) -> None:
        self.world = World(list(robots), ParameterFollower, obstacles=Obstacles(**obstacles))
        self.utime, self.real = EPOCH, real or {}
        for robot_id in {0, *self.real}:
            file = ParameterFile(robot_id, {name: Value(value) for name, value in PAPER.items()})
            self.world.handle(EPOCH, f"PARAMETERS_{robot_id}", file.announcement(1))

    def run(self, scanner: Scanner, steps: int = PERIOD // STEP) -> list[Any]:
        """Let so many steps pass; return the messages."""
        messages = []
        for _ in range(steps):
            self.utime += STEP
            for robot_id, (x, y, theta) in self.real.items():
                pose = make(pose_xyt_t, utime=self.utime, robot_id=robot_id, x=x, y=y, theta=theta)
                self.world.handle(self.utime, POSE.channel(robot_id), pose)
            self.world.advance(self.utime)
            messages += scanner.scans(self.world)
        return messages

    def seen_by(self, robot_id: int, sensor: RangeSensor | None = None) -> Any:
        """Return the ranges that one robot is told."""
        self.run(Scanner(), 3)  # real robots are located
        (message,) = self.run(Scanner([robot_id], sensor=sensor))
        assert message.robot_id == robot_id
        return np.array(message.ranges)


def standing(robot_id: int, x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> VirtualRobot:
    return VirtualRobot(robot_id, Commanded(), 0, x, y, theta)


def only(ranges: Any, expected: dict[int, float]) -> bool:
    """Tell whether among the four rays along the axes those are met at these distances, and no other."""
    wanted = [expected.get(ray, math.inf) for ray in (AHEAD, LEFT, BEHIND, RIGHT)]
    return bool(np.allclose(ranges[[AHEAD, LEFT, BEHIND, RIGHT]], wanted, rtol=0.0, atol=1e-6))


@pytest.mark.slow
def test_a_virtual_robot_sees_a_disc_ahead_at_its_distance_less_its_radius() -> None:
    ranges = Bench(standing(10), discs=[(2.0, 0.0, 0.5)]).seen_by(10)
    assert ranges[AHEAD] == pytest.approx(2.0 - 0.5, abs=1e-12)
    assert np.count_nonzero(np.isfinite(ranges)) == 2 * math.floor(math.degrees(math.asin(0.5 / 2.0))) + 1


def test_a_virtual_robot_sees_a_wall_at_an_angle_where_each_ray_meets_it() -> None:
    """The wall is part of the line x + y = 2, the robot looks to the left of the world's x."""
    ranges = Bench(standing(10, theta=0.3), walls=[(3.0, -1.0, -1.0, 3.0)]).seen_by(10)
    angles = -math.pi + np.radians(np.arange(360)) + 0.3
    met = (np.cos(angles) + np.sin(angles) > 0.0) & (np.abs(angles - math.pi / 4.0) <= math.atan(2.0))
    expected = np.where(met, 2.0 / (np.cos(angles) + np.sin(angles)), np.inf)
    assert ranges == pytest.approx(expected, rel=1e-9)


def test_a_virtual_robot_sees_all_robots_but_itself_and_twins() -> None:
    bench = Bench(standing(10), standing(11, 2.0), real={0: (0.0, 3.0, 0.0)})
    for _ in range(10):
        drive = make(motor_command_t, utime=bench.utime + STEP, robot_id=0, left=0.1, right=0.1)
        bench.world.handle(bench.utime + STEP, MOTOR_COMMAND.channel(0), drive)  # the twin leaves its robot
        bench.run(Scanner(), 1)
    (twin,) = [robot for robot in bench.world.robots() if robot.origin == TWIN]
    assert twin.state.x > 0.0
    assert only(bench.seen_by(10), {AHEAD: 2.0 - RADIUS, LEFT: 3.0 - RADIUS})
    assert only(bench.seen_by(11), {BEHIND: 2.0 - RADIUS})


def test_a_real_robot_is_told_virtual_robots_and_obstacles_and_nothing_that_its_own_laser_sees() -> None:
    bench = Bench(
        standing(10, 2.0),
        real={0: (0.0, 0.0, 0.0), 1: (-1.0, 0.0, 0.0), 2: (1.0, 0.0, 0.0)},
        discs=[(0.0, 3.0, 0.25)],
        walls=[(-9.0, -4.0, 9.0, -4.0)],
    )
    assert only(bench.seen_by(0), {AHEAD: 2.0 - RADIUS, LEFT: 2.75, RIGHT: 4.0})


def test_what_others_simulate_is_seen_and_does_not_scan_here() -> None:
    bench = Bench(standing(10))
    others = [Robot(EPOCH, 20, VIRTUAL, RobotState.at_rest(3.0)), Robot(EPOCH, 21, REAL, RobotState.at_rest(0.0, 2.0))]
    bench.run(Scanner(), 1)
    (message,) = world_messages(bench.utime, others)
    bench.world.handle(bench.utime, WORLD_STATE.name, message)
    (scan,) = bench.run(Scanner(origins=[REAL, VIRTUAL]))
    assert scan.robot_id == 10
    assert only(np.array(scan.ranges), {AHEAD: 3.0 - 0.65 * 0.16, LEFT: 2.0 - 0.65 * 0.16})


def test_virtual_or_all_robots_scan_ten_times_a_second_each_at_a_step_of_its_own() -> None:
    robots = [standing(robot_id, robot_id) for robot_id in range(10, 30)]
    bench = Bench(*robots, real={0: (0.0, 0.0, 0.0)})
    bench.run(Scanner(), 3)
    scans = bench.run(Scanner(origins=[VIRTUAL]), 30)
    assert Counter(scan.robot_id for scan in scans) == dict.fromkeys(range(10, 30), 3)
    assert set(Counter(scan.utime for scan in scans).values()) == {2}
    assert Counter(scan.robot_id for scan in bench.run(Scanner(origins=[REAL, VIRTUAL]))) == dict.fromkeys(
        [0, *range(10, 30)], 1
    )
    scanner = Scanner([10])
    bench.run(scanner)
    bench.utime += 8 * STEP  # held up: what is missed within a period is made up once
    assert len(bench.run(scanner, 12)) == 2
    bench.utime += 3600 * 1_000_000  # the clock is set
    assert len(bench.run(scanner, 10)) == 1


def test_the_rays_are_those_that_were_asked_for() -> None:
    sensor = RangeSensor(3, -0.5, 0.5, 1.0)
    bench = Bench(standing(10), discs=[(1.2, 0.0, 0.3)])
    (scan,) = bench.run(Scanner([10], sensor=sensor))
    assert (scan.angle_first, scan.angle_step, scan.range_max, scan.n) == (-0.5, 0.5, 1.0, 3)
    assert scan.ranges == pytest.approx([math.inf, 0.9, math.inf])


def test_a_scan_encodes_to_the_bytes_of_the_generated_encoder() -> None:
    (scan,) = Bench(standing(10), discs=[(1.2, 0.0, 0.3)]).run(Scanner([10]))
    fields = {name: getattr(scan, name) for name in range_scan_t.__slots__ if name != "n"}
    assert scan.encode() == make(range_scan_t, **fields).encode()
    decoded = range_scan_t.decode(scan.encode())
    assert decoded.ranges == pytest.approx(scan.ranges, rel=1e-6)


def test_a_robot_that_is_nowhere_yet_is_told_nothing() -> None:
    bench = Bench(standing(10), standing(11, math.nan))
    assert [scan.robot_id for scan in bench.run(Scanner(origins=[VIRTUAL]))] == [10]


@pytest.mark.parametrize("kind", ["virtual", "emulated"])
def test_a_scenario_gives_robots_a_range_sensor(kind: str, tmp_path: Path) -> None:
    file = ParameterFile(0, {name: Value(value) for name, value in PAPER.items()})
    file.save(tmp_path / "robot_0.yaml")
    text = f"""
        duration: 1
        parameters: robot_0.yaml
        robots:
          - {{id: 3, kind: {kind}, start: [0, 0, 0], range_sensor: true}}
          - {{id: 4, kind: {kind}, start: [1, 0, 0]}}
        """
    scenario = parse(text, folder=tmp_path)
    assert [robot.range_sensor for robot in scenario.robots] == [True, False]
    (tmp_path / "sim.yaml").write_text(to_yaml(scenario))
    options = sim_options.parse(["--scenario", str(tmp_path / "sim.yaml")])
    scanner = _scanner(options, _scenario(options))
    assert scanner is not None
    assert scanner._robot_ids == [3]


@pytest.mark.parametrize("text", ["0,0.1,5", "0,0.1,5.5,3", "0,0,5,3", "0,0.1,100,3", "0,0.1,5,nan", "a,b,c,d"])
def test_rays_that_cannot_be_are_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--range-sensor", "all", f"--range-sensor-rays={text}"])
    assert f"{text!r} is not FIRST,STEP,COUNT,REACH: " in capsys.readouterr().err


def test_a_log_with_scans_reads_as_one_without(tmp_path: Path) -> None:
    path = tmp_path / "run.lcm"
    feedback = motor_feedback_t()
    feedback.utime, feedback.robot_id = EPOCH, 10
    log = lcm.EventLog(str(path), "w", overwrite=True)
    (scan,) = Bench(standing(10)).run(Scanner([10]))
    log.write_event(EPOCH, RANGE_SCAN.channel(10), scan.encode())
    log.write_event(EPOCH, "MOTOR_FEEDBACK_10", feedback.encode())
    log.close()
    assert not read_robots(path)[10].rejected


@pytest.mark.waits
def test_cmr_sim_tells_what_robots_see(url: str, tmp_path: Path) -> None:
    file = ParameterFile(0, {name: Value(value) for name, value in PAPER.items()})
    file.save(tmp_path / "robot_0.yaml")
    bus = Bus(url)
    bus.subscribe(RANGE_SCAN, every=True)
    process = subprocess.Popen(
        [
            *(our_command("cmr-sim"), "--lcm-url", url, "--parameters", str(tmp_path)),
            *("--virtual", "10=commanded,x=0", "11=commanded,x=2", "--obstacle", "0,3,0.5"),
            *("--range-sensor", "0,10", "--range-sensor-rays=-1.57079632679,1.57079632679,4,5"),
        ]
    )
    try:
        seen: dict[int, tuple[float, ...]] = {0: (math.inf,) * 4, 10: (math.inf,) * 4}
        deadline = time.monotonic() + PATIENCE
        while math.inf in (seen[0][0], seen[10][3]):  # each sees the other
            assert process.poll() is None
            assert time.monotonic() < deadline, seen
            utime = time.time_ns() // 1000
            bus.publish(POSE, make(pose_xyt_t, utime=utime, robot_id=0, x=-1.0, y=0.0, theta=math.pi / 2.0), 0)
            for scan in all_of(RANGE_SCAN, bus.receive(0.05)):
                seen[scan.robot_id] = tuple(scan.ranges)
    finally:
        process.terminate()
        assert process.wait(PATIENCE) == 130
    assert not bus.rejected
    # Until the model is loaded, robots are taken to be as large as robots usually are.
    assert seen[10] == pytest.approx([math.inf, 2.0 - RADIUS, 2.5, 1.0 - RADIUS], abs=1e-3)
    assert seen[0] == pytest.approx([1.0 - RADIUS, math.inf, math.inf, math.inf], abs=1e-3)
