"""cmr-run starts the bridge of a real robot that speaks ROS 2, and the robot drives where the scenario says."""

import json
import subprocess
from pathlib import Path

import pytest

from robot_driver.ros2.profile import shipped
from tests.robot_driver.ros2.test_process import World
from tests.support.ros2_python import ros2_python

pytestmark = pytest.mark.waits
PATIENCE = 300.0  # s; the model may have to be compiled first, and this computer be busy
PARAMETERS = """\
schema: 1
robot_id: 0
written: 2026-11-27T12:00:00Z
parameters:
  wheel_radius: {value: 0.04, unit: m}
  base_width: {value: 0.161, unit: m}
  command_base_width: {value: 0.161, unit: m}
  response_time: {value: 0.15, unit: s}
  top_wheel_speed: {value: 18.5, unit: rad/s}
"""
SCENARIO = """\
duration: 60
ends_when: waypoints_reached
robots:
  - id: 0
    kind: real
    parameters: robot_0.yaml
    ros2: {{profile: my_robot.yaml, namespace: /turtle, domain_id: {domain}}}
    behaviour: waypoints
    waypoints: [[0.5, 0.0]]
  - {{id: 10, kind: virtual, start: [-0.6, 0.0], behaviour: "follow,leader=0,gap=0.5"}}
"""


def test_a_robot_that_speaks_ros2_drives_in_a_scenario(tmp_path: Path) -> None:
    world = World(tmp_path)
    (tmp_path / "robot_0.yaml").write_text(PARAMETERS)
    (tmp_path / "my_robot.yaml").write_text(shipped()["example"].read_text(encoding="utf-8"))
    (tmp_path / "lab.yaml").write_text(SCENARIO.format(domain=world.domain))
    try:
        world.start("robot_driver.ros2.emulated", "--namespace", "/turtle", "--ideal")
        run = Path(ros2_python()).parent / "cmr-run"
        command = [str(one) for one in (run, tmp_path / "lab.yaml", "--out", tmp_path / "out")]
        said = subprocess.run(
            command,
            env=world.environment,
            timeout=PATIENCE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
    finally:
        world.close()
    assert said.returncode == 0, said.stdout
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["ended_by"] == "all waypoints are reached"
    assert "zero sent" in (tmp_path / "out" / "driver_0.txt").read_text()
