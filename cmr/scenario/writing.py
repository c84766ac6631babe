"""A scenario as YAML that reads back as the same scenario: every robot by itself, nothing left to a rule."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from cmr.scenario.plan import BehaviourPlan, RobotPlan
from cmr.scenario.scenario import Scenario


def to_yaml(scenario: Scenario) -> str:
    """Return the text of a file; paths are written as they are, so relative ones hold from the working folder."""
    content = _without_defaults(scenario, {"robots", "discs", "walls"})
    obstacles = {name: _plain(getattr(scenario, name)) for name in ("discs", "walls") if getattr(scenario, name)}
    if obstacles:
        content["obstacles"] = obstacles
    content["robots"] = [_robot(robot) for robot in scenario.robots]
    return yaml.safe_dump(content, sort_keys=False, width=120, allow_unicode=True)


def _robot(robot: RobotPlan) -> dict[str, Any]:
    return {"id": robot.robot_id, **_without_defaults(robot, {"robot_id"})}


def _without_defaults(plan: Any, without: set[str]) -> dict[str, Any]:
    """Return the fields of a dataclass whose values are not what they would be anyway."""
    values = {entry.name: (getattr(plan, entry.name), entry.default) for entry in fields(plan)}
    return {
        name: _plain(value)
        for name, (value, default) in values.items()
        if name not in without and (value != default or name == "metrics")
    }


def _plain(value: Any) -> Any:
    """Return a value as YAML has it."""
    if isinstance(value, BehaviourPlan):
        return {"name": value.name, **value.settings}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, tuple):
        return [_plain(element) for element in value]
    if hasattr(value, "__dataclass_fields__"):
        return _without_defaults(value, set())
    return value
