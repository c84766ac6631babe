"""Team experiments as a file: which robots, what they do, where, and for how long; and how one is run.

`scenario` reads and checks the file, by `document` (values with their lines) and `robots`; `plan` holds what it says.
"""

from cmr.scenario.errors import ScenarioError
from cmr.scenario.plan import BehaviourPlan, RobotPlan
from cmr.scenario.scenario import Scenario, load, parse

__all__ = ["BehaviourPlan", "RobotPlan", "Scenario", "ScenarioError", "load", "parse"]
