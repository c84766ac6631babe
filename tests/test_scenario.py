"""A scenario says what it means, or is refused with file, line and key; nothing else ever comes out of it."""

import math
from pathlib import Path

import pytest

from cmr.scenario import Scenario, ScenarioError
from cmr.scenario.plan import arguments_of
from cmr.scenario.scenario import parse

SHIPPED = Path(__file__).resolve().parents[1] / "cmr/scenario/shipped"
PARAMETERS = SHIPPED / "parameters/robot_0.yaml"

TEXT = f"""\
duration: 60
parameters: {PARAMETERS}
robots:
  - id: 10
    kind: virtual
    behaviour: figure_eight,laps=2
  - id: 0
    kind: real
    driver: {{port: /dev/ttyUSB0, invert_left: true, battery_stop: 10.5}}
    behaviour: {{name: follow, leader: 10, gap: 0.6}}
  - count: 3
    first_id: 11
    kind: virtual
    start: {{rule: line, x: -1, spacing: 0.4}}
    behaviour: follow,leader=previous
"""


def test_a_scenario_says_what_its_file_says() -> None:
    scenario = parse(TEXT, "demo.yaml")
    assert (scenario.name, scenario.duration, scenario.seed) == ("demo", 60.0, 0)
    assert [robot.robot_id for robot in scenario.robots] == [10, 0, 11, 12, 13]
    real = scenario.robot(0)
    assert real is not None
    assert (real.kind, real.start, real.parameters) == ("real", None, PARAMETERS)
    assert str(real.behaviour) == "follow,leader=10,gap=0.6"
    assert real.driver is not None
    assert arguments_of(real.driver) == ["--port", "/dev/ttyUSB0", "--battery-stop", "10.5", "--invert-left"]
    assert [robot.parameters_of for robot in scenario.virtual] == [0, 0, 0, 0]


def test_robots_of_a_line_follow_each_the_one_before() -> None:
    scenario = parse(TEXT)
    assert [str(robot.behaviour) for robot in scenario.robots[2:]] == [
        f"follow,leader={leader}" for leader in (10, 11, 12)
    ]
    assert [robot.start for robot in scenario.robots[2:]] == [(-1.0, 0.0, 0.0), (-1.4, 0.0, 0.0), (-1.8, 0.0, 0.0)]


def team(start: str, count: int = 6) -> Scenario:
    robots = f"{{kind: virtual, count: {count}, first_id: 1, start: {start}}}"
    return parse(f"duration: 1\nparameters: {PARAMETERS}\nrobots: [{robots}]")


@pytest.mark.parametrize("count", [1, 2, 3, 6, 7, 37])
@pytest.mark.parametrize("rule", ["line", "grid", "circle"])
def test_robots_that_start_by_a_rule_keep_their_spacing(rule: str, count: int) -> None:
    starts = [robot.start for robot in team(f"{{rule: {rule}, spacing: 0.4, x: 2, y: 1, theta: 0.3}}", count).robots]
    places = [(start.x, start.y) for start in starts if start is not None]
    assert len(places) == count
    distances = [math.dist(one, other) for k, one in enumerate(places) for other in places[:k]]
    assert min(distances, default=0.4) == pytest.approx(0.4, abs=1e-9) or rule == "circle"
    assert min(distances, default=0.4) > 0.4 - 1e-9


def test_the_centre_of_a_grid_and_of_a_circle_stays_free() -> None:
    for rule in ("grid", "circle"):
        for robot in team(f"{{rule: {rule}, spacing: 0.4, x: 2, y: 1}}", 1000).robots:
            assert robot.start is not None
            assert math.dist(robot.start[:2], (2.0, 1.0)) > 0.28


WRONG = {
    "duration: 60": ("duration: -1", 1, "duration", "0.1"),
    "parameters: ": ("speed: 3\nparameters: ", 2, "speed", "Known are: name, about, duration"),
    "kind: real": ("kind: reel", 8, "robots[1].kind", "real, emulated, virtual"),
    "invert_left: true": ("invert_left: 7", 9, "robots[1].driver.invert_left", "true or false"),
    "port: /dev/ttyUSB0, ": ("", 9, "robots[1].driver", "port is missing"),
    "battery_stop: 10.5": ("battery: 10.5", 9, "robots[1].driver.battery", "battery_stop"),
    "leader: 10": ("leader: 99", 7, "robots[1]", "leader 99, which is not there"),
    "gap: 0.6": ("gap: -0.6", 10, "robots[1].behaviour", "above 0"),
    "gap: 0": ("distance: 0", 10, "robots[1].behaviour", "leader, gap, speed"),
    "name: follow": ("name: folow", 10, "robots[1].behaviour", "Shipped"),
    "first_id: 11": ("first_id: 10", 11, "robots[2]", "robot 10 is there twice: also in line 4"),
    "count: 3": ("count: 0", 11, "robots[2].count", "from 1 to"),
    "rule: line": ("rule: row", 14, "robots[2].start.rule", "line, grid, circle"),
    "spacing: 0.4": ("spacing: 0.1", 11, "robots[2]", "0.1 m apart"),
    "x: -1": ("x: 0.1", 11, "robots[2]", "robots 10 and 11 are 0.1 m apart"),
    "laps=2": ("laps", 6, "robots[0].behaviour", "key=value"),
    "id: 10": ("id: ten", 4, "robots[0].id", "whole number"),
    "robots:": ("geofence: [[0, 0], [1, 1]]\nrobots:", 3, "geofence", "3 points"),
    "robots:\n": ("metrics: [speed]\nrobots:\n", 3, "metrics[0]", "formation_error"),
    f"{PARAMETERS}": ("nothing.yaml", 2, "parameters", "there is no file"),
    "  - id: 0": ("  - id: 0\n    id: 1", 8, "robots[1].id", "is there twice"),
    "  - id: 10\n    kind: virtual": (
        "  - id: 10\n    host: a\n    kind: virtual",
        5,
        "robots[0].host",
        "not for virtual",
    ),
    "driver: {": ("parameters_of: 10\n    driver: {", 9, "robots[1].parameters_of", "not for real"),
}


@pytest.mark.parametrize("right", [right for right in WRONG if right in TEXT])
def test_what_is_wrong_is_refused_with_file_line_and_key(right: str) -> None:
    wrong, line, key, allowed = WRONG[right]
    with pytest.raises(ScenarioError) as refused:
        parse(TEXT.replace(right, wrong, 1), "lab.yaml")
    assert str(refused.value).startswith(f"lab.yaml: line {line}: {key}: "), refused.value
    assert allowed in str(refused.value)
