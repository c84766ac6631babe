"""Team experiments as files: robots, their behaviours, surroundings, and duration.

`reading` reads and checks a file, `robots` reads its robots, `writing` writes it; `cmr.experiments.team.plan` holds its
contents.
"""

from cmr.experiments.scenario.reading import ScenarioError, load, parse
from cmr.experiments.team.plan import BehaviourPlan, RobotPlan, Scenario

__all__ = ["BehaviourPlan", "RobotPlan", "Scenario", "ScenarioError", "load", "parse"]
