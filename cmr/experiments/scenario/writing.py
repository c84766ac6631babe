"""Write a scenario as YAML that reads back as the same scenario, without rules or default files."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from cmr.experiments.team.plan import BehaviourPlan, RobotPlan, Scenario

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # in C where it is installed


def to_yaml(scenario: Scenario) -> str:
    """Return the text of a file; paths are unchanged, so relative ones refer to the working folder."""
    content = _without_defaults(scenario, {"robots", "discs", "walls"})
    obstacles = {name: _plain(getattr(scenario, name)) for name in ("discs", "walls") if getattr(scenario, name)}
    if obstacles:
        content["obstacles"] = obstacles
    content["robots"] = [_entry(alike) for alike in _alike(scenario.robots)]
    return str(yaml.dump(content, Dumper=DUMPER, sort_keys=False, width=120, allow_unicode=True))


def _alike(robots: Sequence[RobotPlan]) -> Iterator[list[RobotPlan]]:
    """Yield runs of virtual robots with consecutive ids that differ only in their start; all others alone."""
    run: list[RobotPlan] = []
    for robot in robots:
        if run and not _follows(run[-1], robot):
            yield run
            run = []
        run.append(robot)
    yield run


def _follows(one: RobotPlan, other: RobotPlan) -> bool:
    return one.kind == "virtual" and replace(one, robot_id=one.robot_id + 1, start=other.start) == other


def _entry(alike: list[RobotPlan]) -> dict[str, object]:
    """Return one entry of the list of robots."""
    first = alike[0]
    if len(alike) == 1:
        return {"id": first.robot_id, **_without_defaults(first, {"robot_id"})}
    entry = {"first_id": first.robot_id, "count": len(alike), **_without_defaults(first, {"robot_id", "start"})}
    return {**entry, "start": [_plain(robot.start) for robot in alike]}


def _without_defaults(plan: "DataclassInstance", without: set[str]) -> dict[str, object]:
    """Return the fields of a dataclass that differ from their defaults."""
    values = {entry.name: (getattr(plan, entry.name), entry.default) for entry in fields(plan)}
    return {
        name: _plain(value)
        for name, (value, default) in values.items()
        if name not in without and (value != default or name == "metrics")
    }


def _plain(value: object) -> object:
    """Return a value as YAML has it."""
    if isinstance(value, BehaviourPlan):
        return value.mapping
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, tuple):
        return [_plain(element) for element in value]
    if is_dataclass(value) and not isinstance(value, type):
        return _without_defaults(value, set())
    return value
