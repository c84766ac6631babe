"""A scenario says what it means, or is refused with file, line and key; nothing else ever comes out of it."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cmr.cli.options import arguments_of
from cmr.commands.scenarios import load, parse
from cmr.experiments.live.jobs import jobs_of
from cmr.experiments.scenario import Scenario, ScenarioError
from cmr.experiments.scenario.reading import KEYS, path_of
from cmr.experiments.scenario.robots import KEYS as ROBOT_KEYS
from cmr.experiments.scenario.writing import to_yaml
from cmr.parameters.file import load as load_parameters
from cmr.processes.job import PILOT, RECORDER, SIM
from tests.support.project import PROJECT

SHIPPED = PROJECT / "cmr/experiments/scenario/shipped"
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


VELOCITY_CONTROLLER = """\
schema: 1
robot_id: 0
written: 2026-01-31T12:00:00Z
parameters:
  wheel_radius: {value: 0.165, unit: m}
  base_width: {value: 0.9, unit: m}
  response_time: {value: 0.3, unit: s}
  top_wheel_speed: {value: 6.0, unit: rad/s}
"""
DRIVER = "    driver: {port: /dev/ttyUSB0, invert_left: true, battery_stop: 10.5}\n"


def test_a_real_robot_that_takes_duties_needs_a_driver() -> None:
    with pytest.raises(ScenarioError, match=r"robots\[1\]: driver is missing: a real robot needs the port"):
        parse(TEXT.replace(DRIVER, ""))


def test_a_real_robot_that_takes_speeds_comes_with_a_bridge_of_its_own(tmp_path: Path) -> None:
    husky = tmp_path / "husky.yaml"
    husky.write_text(VELOCITY_CONTROLLER)
    text = TEXT.replace("kind: real", f"kind: real\n    parameters: {husky}")
    with pytest.raises(ScenarioError, match="which cmr-driver does not drive"):
        parse(text)
    jobs = jobs_of(parse(text.replace(DRIVER, "")), tmp_path, "udpm://239.255.76.67:7667?ttl=0")
    assert [job.role for job in jobs] == [RECORDER, SIM, PILOT]


def test_a_leader_must_be_another_robot() -> None:
    with pytest.raises(ScenarioError, match="its own leader"):
        parse(TEXT.replace("leader: 10", "leader: 0"))


ROOM = {
    "obstacles: {discs: [[-1.0, 0.2, 0.15]]}": "robot 11 .* is in the obstacle",
    "obstacles: {walls: [[-3, 0.05, 3, 0.05]]}": "robot 10 .* is in the wall",
    "obstacles: {discs: [[3, 3, 0]]}": "obstacles: disc 0: the radius must be above 0",
    "obstacles: {walls: [[3, 3, 3, 3]]}": "obstacles: wall 0 begins and ends at",
    "geofence: [[0, 0], [2, 2], [2, 0], [0, 2]]": "geofence: sides 0 and 2 of the geofence meet",
    "ends_when: waypoints_reached": "ends_when: no robot has waypoints",
    "ends_when: {metric: minimum_separation}": "line 1: ends_when: a metric and a bound go together",
    "population: [nobody.yaml]": r"population\[0\]: there is no file nobody.yaml",
    f"population: [{PARAMETERS}]": "population: .*no standard deviations",
    "process_noise: true": "line 1: process_noise: .*robot_0.yaml does not say how far robots deviate",
    "lcm_url: 'udpm://10.0.0.1:7667'": "lcm_url: .*not a multicast address",
}


@pytest.mark.parametrize("line", ROOM)
def test_what_does_not_fit_the_room_is_refused(line: str) -> None:
    with pytest.raises(ScenarioError, match=ROOM[line]):
        parse(f"{line}\n{TEXT}")


def test_only_robots_with_a_driver_have_to_start_within_the_geofence() -> None:
    fence = "geofence: [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]\n"
    assert len(parse(fence + TEXT).robots) == 5
    start = "port: /dev/ttyUSB0}\n    start: [2, 0]"
    with pytest.raises(ScenarioError, match=r"robot 0 at \(2, 0\) is outside the geofence"):
        parse(fence + TEXT.replace("port: /dev/ttyUSB0, invert_left: true, battery_stop: 10.5}", start))


@pytest.mark.parametrize("kind", ["virtual", "emulated"])
def test_every_robot_needs_parameters(kind: str) -> None:
    with pytest.raises(ScenarioError, match="has no parameters"):
        parse(f"duration: 1\nrobots: [{{id: 0, kind: {kind}}}]")


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_scenarios_are_sound_and_say_what_they_are(path: Path) -> None:
    scenario = load(path)
    assert scenario.name == path.stem
    assert scenario.about
    assert any(robot.kind != "virtual" for robot in scenario.robots)
    assert all(robot.kind != "real" for robot in scenario.robots), "it must run without hardware"


def test_a_file_that_is_missing_or_no_text_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.yaml", tmp_path):
        with pytest.raises(ScenarioError, match=str(path)):
            load(path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(ScenarioError, match=r"binary\.yaml.*not UTF-8"):
        load(tmp_path / "binary.yaml")


# Whatever the text


NUMBERS = st.one_of(st.integers(-3, 40), st.floats(allow_nan=True), st.sampled_from([0.5, 1.0, 2**70]))
WORDS = st.sampled_from(
    ["virtual", "emulated", "real", "line", "grid", "circle", "follow", "follow,leader=10", "figure_eight", "previous"]
)
SCALARS = st.one_of(st.none(), st.booleans(), NUMBERS, WORDS, st.text(max_size=8))
KEYS_OF_ALL = st.sampled_from(
    [*KEYS, *ROBOT_KEYS, "rule", "spacing", "x", "y", "name", "discs", "port", "metric", "above"]
)
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS_OF_ALL, inner, max_size=4), max_leaves=12
)
ROBOTS = st.lists(st.dictionaries(st.sampled_from(ROBOT_KEYS), VALUES, max_size=6), max_size=3)


def is_refused_or_sound(text: str) -> None:
    refusals: list[str] = []
    try:
        scenario = parse(text)
    except ScenarioError as error:
        refusals.append(str(error))
    else:
        assert parse(to_yaml(scenario)) == scenario
    assert all(refusal.startswith("scenario.yaml: line ") for refusal in refusals)


@pytest.mark.slow
@given(st.text())
@example("[" * 10_000)
@example("a: &a [*a]")
@example("? [1]: 2")
@example("a: \x00")
@example("a: 1\n---\nb: 2")
@example("duration: !!python/object/apply:os.system ['true']")
@example("robots: [{id: 1, kind: virtual, behaviour: '.a:b'}]\nduration: 1")
def test_no_text_ever_gives_another_exception(text: str) -> None:
    is_refused_or_sound(text)


@pytest.mark.slow
@settings(max_examples=200)
@given(st.dictionaries(st.sampled_from(KEYS), VALUES), ROBOTS)
def test_no_scenario_ever_gives_another_exception(content: dict[str, Any], robots: list[dict[str, Any]]) -> None:
    is_refused_or_sound(yaml.safe_dump({"duration": 5, "parameters": str(PARAMETERS), **content, "robots": robots}))


@settings(max_examples=100)
@given(st.data())
def test_a_damaged_scenario_never_gives_another_exception(data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(TEXT)))
    until = data.draw(st.integers(at, min(at + 20, len(TEXT))))
    is_refused_or_sound(TEXT[:at] + data.draw(st.text(max_size=5)) + TEXT[until:])


COORDINATES = st.floats(-50.0, 50.0)
GROUPS = st.tuples(
    st.sampled_from(["line", "grid", "circle"]), st.integers(1, 30), st.floats(0.3, 3.0), st.floats(-4.0, 4.0)
)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A parameter file as cmr-diagnose writes it."""
    path = tmp_path_factory.mktemp("diagnosed") / "robot_0.yaml"
    replace(load_parameters(PARAMETERS), provenance={"method": "diagnosis", "held_out_path_rmse_m": 0.02}).save(path)
    return path


@settings(max_examples=30)
@given(
    group=GROUPS,
    waypoints=st.lists(st.tuples(COORDINATES, COORDINATES), max_size=4),
    seed=st.integers(0, 2**63 - 1),
    noise=st.booleans(),
)
def test_what_is_written_reads_back_the_same(
    diagnosed: Path,
    group: tuple[str, int, float, float],
    waypoints: list[tuple[float, float]],
    seed: int,
    noise: bool,
) -> None:
    rule, count, spacing, theta = group
    start = {"rule": rule, "spacing": spacing, "x": 1000.0, "theta": theta}
    many = {"count": count, "first_id": 20, "kind": "virtual", "behaviour": "follow,leader=previous", "start": start}
    lead = {"id": 19, "kind": "virtual", "start": [0, 5], "waypoints": [list(point) for point in waypoints]}
    content = yaml.safe_load(TEXT)
    content |= {"seed": seed, "process_noise": noise, "reaction": 0.03, "host": "lab-pc"}
    content["parameters"] = str(diagnosed)
    content["obstacles"] = {"discs": [[80, 0, 1]], "walls": [[70, 0, 70, 1]]}
    spins = {"id": 18, "kind": "virtual", "start": [0, 9], "behaviour": "manoeuvre,name=spins,speed=0.5"}
    content["robots"] += [spins, lead, many]
    scenario = parse(yaml.safe_dump(content), "a.yaml")
    assert len(scenario.robots) == 7 + count
    assert parse(to_yaml(scenario), "b.yaml") == scenario


def test_a_list_that_is_too_short_is_told_by_its_length() -> None:
    with pytest.raises(ScenarioError, match=r"must be a list of 2 numbers, \[x, y\], not a list of 1"):
        parse(TEXT.replace("kind: virtual\n", "kind: virtual\n    start: [1]\n", 1))


def test_a_shipped_scenario_is_known_by_its_name_and_a_file_by_its_path(tmp_path: Path) -> None:
    assert path_of("line") == SHIPPED / "line.yaml"
    assert path_of(str(tmp_path)) == tmp_path
    with pytest.raises(ScenarioError, match=r"neither a file nor a shipped scenario 'lin\.yaml'.*formation, line"):
        path_of("lin.yaml")


def test_a_folder_of_a_scenarios_name_does_not_hide_the_shipped_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "swarm").mkdir()
    monkeypatch.chdir(tmp_path)
    assert path_of("swarm").is_file()
