"""Team experiments as files: robots, their behaviours, surroundings, and duration.

`plan` holds the contents of the file; `reading` reads and checks it, `robots` reads its robots, `writing` writes it.
"""

from cmr.experiments.scenario.plan import BehaviourPlan, RobotPlan, Scenario, ScenarioError
from cmr.experiments.scenario.reading import load, parse

__all__ = ["BehaviourPlan", "RobotPlan", "Scenario", "ScenarioError", "load", "parse"]
