"""Team experiments as a file: which robots, what they do, where, and for how long.

`plan` holds what the file says; `reading` reads and checks it, `robots` its robots, `writing` writes it.
"""

from cmr.experiments.scenario.plan import BehaviourPlan, RobotPlan, Scenario, ScenarioError
from cmr.experiments.scenario.reading import load, parse

__all__ = ["BehaviourPlan", "RobotPlan", "Scenario", "ScenarioError", "load", "parse"]
