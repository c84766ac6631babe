"""A real robot of a scenario may be one that speaks ROS 2: cmr-run starts its bridge, or says why that cannot be."""

from pathlib import Path

import pytest

from cmr.commands.scenarios import load, parse
from cmr.experiments.live.jobs import jobs_of
from cmr.experiments.live.preparing import prepare
from cmr.experiments.scenario import Scenario, ScenarioError
from cmr.experiments.scenario.writing import to_yaml
from cmr.processes.job import DRIVER, PILOT, RECORDER, SIM
from robot_driver.ros2.command import command_parser as ros2_parser
from robot_driver.ros2.profile import shipped
from tests.experiments.scenario.test_scenario import DRIVER as OF_DUTIES
from tests.experiments.scenario.test_scenario import TEXT, VELOCITY_CONTROLLER

PROFILE = shipped()["example"]
BRIDGED = "    ros2: {profile: my_robot.yaml, namespace: /turtle, domain_id: 7}\n"


def robot_with_ros2(folder: Path, ros2: str = BRIDGED) -> Scenario:
    """A scenario whose robot 0 speaks ROS 2; its parameters and its profile lie in `folder`."""
    (folder / "turtle.yaml").write_text(VELOCITY_CONTROLLER)
    (folder / "my_robot.yaml").write_text(PROFILE.read_text(encoding="utf-8"))
    text = TEXT.replace(OF_DUTIES, f"    parameters: turtle.yaml\n{ros2}")
    return parse(text, "lab.yaml", folder)


def test_a_robot_with_ros2_is_bridged_before_its_pilot_starts(tmp_path: Path) -> None:
    scenario = prepare(robot_with_ros2(tmp_path), tmp_path / "run")
    jobs = jobs_of(scenario, tmp_path / "run", "udpm://239.255.76.67:7667?ttl=0")
    assert [job.role for job in jobs] == [RECORDER, DRIVER, SIM, PILOT]
    bridge = jobs[1]
    assert bridge.name == "driver 0"
    assert Path(bridge.command[0]).name == "cmr-ros2"
    options = ros2_parser().parse_args(bridge.command[1:])
    assert options.robot == [(0, str(tmp_path / "run" / "profile_0.yaml"), "/turtle")]
    assert (options.domain_id, options.range, options.no_base_timeout) == (7, "localhost", False)
    assert (tmp_path / "run" / "profile_0.yaml").read_text() == PROFILE.read_text()
    assert parse(to_yaml(scenario), "again.yaml") == scenario


def test_what_cmr_sim_reads_of_a_robot_with_ros2_names_no_profile(tmp_path: Path) -> None:
    scenario = prepare(robot_with_ros2(tmp_path), tmp_path / "run")
    (tmp_path / "run" / "profile_0.yaml").unlink()  # as on another computer
    of_sim = load(tmp_path / "run" / "sim.yaml")
    assert [robot.robot_id for robot in of_sim.robots] == [robot.robot_id for robot in scenario.robots]


@pytest.mark.parametrize(
    ("ros2", "why"),
    [
        (BRIDGED.replace("my_robot.yaml", "nobody.yaml"), r"robots\[1\].ros2: profile: There is no profile"),
        (BRIDGED.replace("/turtle", "turtle"), r"robots\[1\].ros2: namespace 'turtle' is not like /turtle"),
        (BRIDGED.replace("7", "233"), r"robots\[1\].ros2.domain_id: must be .*232"),
        (BRIDGED.replace("my_robot.yaml", "turtlebot3"), "has no command timeout of its own"),
        (BRIDGED + OF_DUTIES, r"robots\[1\]: driver and ros2 exclude each other"),
        (BRIDGED + "    host: robot-pi\n", r"robots\[1\]: host is not for robots with ros2"),
    ],
)
def test_a_bridge_that_cannot_be_is_refused(tmp_path: Path, ros2: str, why: str) -> None:
    with pytest.raises(ScenarioError, match=why):
        robot_with_ros2(tmp_path, ros2)


def test_a_shipped_profile_keeps_its_name_and_needs_leave_for_a_base_without_timeout(tmp_path: Path) -> None:
    allowed = "    ros2: {profile: turtlebot3, no_base_timeout: true}\n"
    scenario = prepare(robot_with_ros2(tmp_path, allowed), tmp_path / "run")
    command = jobs_of(scenario, tmp_path / "run", "udpm://239.255.76.67:7667?ttl=0")[1].command
    assert command[1:6] == ["--robot", "0=turtlebot3", "--range", "localhost", "--no-base-timeout"]


def test_a_robot_that_takes_duties_has_no_bridge_to_ros2() -> None:
    with pytest.raises(ScenarioError, match=r"robots\[1\]: ros2: a robot that speaks ROS 2 takes speeds"):
        parse(TEXT.replace(OF_DUTIES, "    ros2: {profile: example}\n"))
