"""Conditions that end a run before its duration is over: `ends_when`."""

from cmr.documents.document import Item, Section
from cmr.experiments.team.metrics import UNITS
from cmr.experiments.team.plan import Ending, Scenario
from cmr.experiments.team.scoring import bonds_of, ways_of

EXAMPLE = "{metric: formation_error, above: 0.5}"
LONGEST_WAIT = 604_800.0  # s; a week
# Since the start these only fall, or only grow: the other bound would end a run at once, or never.
ONLY_BOUND = {"minimum_separation": "below", "distance_driven": "above", "time_to_goal": "above"}
OF_A_MOMENT = ("formation_error",)  # can be evaluated over a few seconds alone
# Exceeds any bound at the start of a run, with the reason.
OFF_AT_FIRST = {"path_spread": "at the start nobody stands on the path of a leader that has not driven yet"}
NEEDED = {
    "formation_error": "a robot that keeps a distance to a leader",
    "time_to_goal": "a robot with waypoints",
    "minimum_separation": "two robots",
    "path_spread": "a robot that follows another on its path",
}


def read_ending(item: Item | None) -> Ending:
    """Return the condition that ends a run early: `waypoints_reached`, or a metric with `below` or `above`.

    Raises ScenarioError naming line and key.
    """
    if item is None:
        return Ending()
    if not item.is_mapping:
        item.word(("waypoints_reached",))
        return Ending(waypoints_reached=True)
    section = item.section(("waypoints_reached", "metric", "below", "above", "after", "over"))
    reached, metric = section.get("waypoints_reached"), section.get("metric")
    below, above, after, over = (section.get(key) for key in ("below", "above", "after", "over"))
    name = metric.word(tuple(UNITS)) if metric else None
    if (name is None) != (below is None and above is None):
        raise section.place.error(f"a metric and a bound go together: {EXAMPLE}. Metrics are {', '.join(UNITS)}")
    _check_bounds(section, name)
    wait = after.number(0.0, LONGEST_WAIT) if after else 0.0
    if above is not None and not wait and name in OFF_AT_FIRST:
        raise above.place.error(f"{OFF_AT_FIRST[name]}: say by after: 10 (s) from when on it counts")
    return Ending(
        waypoints_reached=bool(reached and reached.flag()),
        metric=name,
        below=below.number() if below else None,
        above=above.number() if above else None,
        after=wait,
        over=over.number(0.2, LONGEST_WAIT) if over else None,
    )


def why_only_live(ending: Ending) -> str:
    """Return why a run without the bus, faster than real time, does not support this ending; empty if it does."""
    if ending.metric is None:
        return ""
    return f"only cmr-run ends a run by {ending.metric}. Here ends_when is waypoints_reached, or left out"


def _check_bounds(section: Section, metric: str | None) -> None:
    """Raise ScenarioError for a key that does not apply to this metric, None without a metric."""
    for key in ("after", "over"):
        item = section.get(key)
        if metric is None and item is not None:
            raise item.place.error(f"goes with a metric and its bound: {EXAMPLE}")
    over = section.get("over")
    if over is not None and metric not in OF_A_MOMENT:
        raise over.place.error(f"is for {', '.join(OF_A_MOMENT)}; {metric} counts from the start of the run on")
    only = ONLY_BOUND.get(metric or "")
    for key in ("below", "above"):
        item = section.get(key)
        if item is not None and only not in (None, key):
            way = "falls" if only == "below" else "grows"
            raise item.place.error(f"{metric} only {way} while a team drives, and so can end a run by {only} alone")


def check_ending(scenario: Scenario, item: Item | None) -> None:
    """Raise ScenarioError, at `ends_when`, if the condition does not apply to this team."""
    ending = scenario.ends_when
    if item is None:
        return
    if ending.waypoints_reached and not any(robot.waypoints for robot in scenario.robots):
        raise item.place.error("no robot has waypoints that could be reached")
    if ending.metric is not None and not _is_measured(scenario, ending.metric):
        others = [name for name in UNITS if _is_measured(scenario, name)]
        raise item.place.error(f"{ending.metric} needs {NEEDED[ending.metric]}. This team has {', '.join(others)}")


def _is_measured(scenario: Scenario, metric: str) -> bool:
    """Return whether a metric is defined for this team."""
    columns = {robot.robot_id: column for column, robot in enumerate(scenario.robots)}
    if metric == "time_to_goal":
        return bool(ways_of(scenario, columns))
    if metric in ("formation_error", "path_spread"):
        return any(bond.follows or metric == "formation_error" for bond in bonds_of(scenario, columns))
    return metric == "distance_driven" or len(columns) > 1
