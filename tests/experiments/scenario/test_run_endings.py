"""Any metric of a team ends a run, by the same measure as in its report; what could end no run is refused on load."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from cmr.commands.scenarios import parse
from cmr.experiments.live.measuring import EndingMetric
from cmr.experiments.live.watch import TeamWatch
from cmr.experiments.scenario import ScenarioError
from cmr.experiments.scenario.writing import to_yaml
from cmr.experiments.team.metrics import UNITS
from cmr.experiments.team.plan import Ending
from cmr.model.motion import RobotState
from cmr.world.view import VIRTUAL, Robot, world_messages
from tests.experiments.scenario.test_scenario import PARAMETERS
from tests.experiments.scenario.test_scenario_scores import EPOCH, STEP, team

pytestmark = pytest.mark.waits

SPEED = 0.5  # m/s of the leader, along x
LONGEST = 10.0  # s


def ended(ending: Ending, gap: Callable[[float], float]) -> tuple[float, str]:
    """When and why a run ends in which a robot drives `gap(time)` [m] behind its leader, 0.5 m being wanted."""
    scenario = replace(team(), ends_when=ending)
    watch = TeamWatch(scenario)
    metric = EndingMetric(scenario, watch)
    for k in range(round(LONGEST / (STEP * 1e-6))):
        seconds = k * STEP * 1e-6
        x = SPEED * min(seconds, 2.2)
        poses = {5: x, 2: x - gap(seconds)}
        robots = [Robot(EPOCH + k * STEP, n, VIRTUAL, RobotState(x, *[0.0] * 6)) for n, x in poses.items()]
        for message in world_messages(EPOCH + k * STEP, robots):
            watch.handle(EPOCH + k * STEP, "WORLD_STATE", message)
        if k == 0:
            watch.begin()
        if reason := metric.reason(seconds):
            return seconds, reason
    return LONGEST, ""


def closing_up(seconds: float) -> float:
    return max(1.5 - 0.2 * seconds, 0.5)


BOUNDS = {
    "formation error": (Ending(metric="formation_error", above=0.8), 0.1, "m, above 0.8"),
    "later": (Ending(metric="formation_error", above=0.4, after=4.0), 4.0, "above 0.4"),
    "formed": (Ending(metric="formation_error", below=0.05, over=1.0), 5.6, "below 0.05"),
    "never formed": (Ending(metric="formation_error", below=0.05), LONGEST, ""),
    "in time": (Ending(metric="time_to_goal", above=3.0), LONGEST, ""),
    "too late": (Ending(metric="time_to_goal", above=1.5), 1.6, "s, above 1.5"),
    "near": (Ending(metric="minimum_separation", below=0.75), 3.8, "the minimum separation is 0.74 m, below 0.75"),
    "far enough": (Ending(metric="distance_driven", above=1.0), 1.7, "the distance driven is 1.0"),
    "on the path": (Ending(metric="path_spread", below=0.5), 6.8, "the path spread is 0.49"),
}


@pytest.mark.parametrize("bound", BOUNDS)
def test_a_run_ends_when_its_metric_is_beyond_the_bound(bound: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "cmr.experiments.live.measuring.SHARE", math.inf
    )  # on a busy machine, too, look at every moment
    ending, seconds, words = BOUNDS[bound]
    found = ended(ending, closing_up)
    assert found[0] == pytest.approx(seconds, abs=0.25), found
    assert words in found[1]


def test_all_metrics_of_a_team_can_end_its_run() -> None:
    assert {ending.metric for ending, *_ in BOUNDS.values()} == set(UNITS)


TEAM = f"""duration: 60
parameters: {PARAMETERS}
ends_when:
  metric: formation_error
  above: 0.5
robots:
  - id: 10
    kind: virtual
    behaviour: waypoints
    waypoints: [[1, 0]]
  - id: 11
    kind: virtual
    start: [-1, 0]
    behaviour: follow,leader=10
"""
WRONG = {
    "metric: formation_error\n  above: 0.5": {
        "metric: formation_eror\n  above: 1": (4, "ends_when.metric", "one of formation_error, time_to_goal, minimum_"),
        "metric: formation_error": (3, "ends_when", "a metric and a bound go together: {metric: formation_error, a"),
        "metric: distance_driven\n  below: 1": (5, "ends_when.below", "distance_driven only grows .* by above alone"),
        "metric: minimum_separation\n  above: 1": (5, "ends_when.above", "minimum_separation only falls .* by below"),
        "metric: path_spread\n  over: 5\n  below: 1": (
            5,
            "ends_when.over",
            "is for formation_error; path_spread counts",
        ),
        "metric: path_spread\n  above: 1": (5, "ends_when.above", "at the start nobody stands .* say by after: 10"),
        "metric: path_spread\n  above: 1\n  after: 0": (5, "ends_when.above", "at the start nobody stands"),
        "metric: formation_error\n  over: 0\n  below: 1": (5, "ends_when.over", "a number from 0.2"),
        "waypoints_reached: yes\n  after: 5": (5, "ends_when.after", "goes with a metric and its bound"),
        "metric: formation_error\n  over_: 3": (
            5,
            "ends_when.over_",
            "Known are: waypoints_reached, metric, below, above",
        ),
    },
    "behaviour: follow,leader=10": {
        "behaviour: waypoints": (
            *(3, "ends_when"),
            "formation_error needs a robot that keeps a distance to a leader. This team has time_to_goal, minimum_sep",
        ),
    },
}


@pytest.mark.parametrize(("right", "wrong"), [(right, wrong) for right in WRONG for wrong in WRONG[right]])
def test_what_could_end_no_run_is_refused_with_its_line_and_key(right: str, wrong: str) -> None:
    line, key, words = WRONG[right][wrong]
    with pytest.raises(ScenarioError, match=f"^lab.yaml: line {line}: {key}: .*{words}"):
        parse(TEAM.replace(right, wrong), "lab.yaml")


def test_an_ending_is_written_as_it_is_read() -> None:
    text = TEAM.replace("above: 0.5", "above: 0.5\n  below: 0.1\n  over: 3\n  after: 5\n  waypoints_reached: true")
    scenario = parse(text, "lab.yaml")
    assert scenario.ends_when == Ending(True, "formation_error", 0.1, 0.5, 5.0, 3.0)
    assert parse(to_yaml(scenario), "lab.yaml") == scenario
