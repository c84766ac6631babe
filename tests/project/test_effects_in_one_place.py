"""An effect in one place: its entry says all that is special about it, and the page on entries explains each field."""

import ast
from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import Path

import pytest

from cmr.model.catalogue import CATALOGUE
from cmr.model.effect import Effect
from cmr.model.parameters import KINDS, ParameterDefinition
from tests.support.project import PROJECT

PACKAGES = ("cmr/estimation", "cmr/diagnosis", "cmr/investigation")
NAMES = {*CATALOGUE, *(parameter.name for effect in CATALOGUE.values() for parameter in effect.all_parameters)}
# Modules that name effects all the same, and why a property of the entry would not do.
NAMING = {
    "cmr/estimation/search/command_timing.py": (
        {"command_delay", "electrical_lag", "command_jitter", "command_loss"},
        "distributions of the delays of single commands: each of these effects has another one",
    ),
    "cmr/estimation/search/chance.py": ({"encoder_quantisation"}, "reads this effect off the ticks"),
    "cmr/estimation/search/late_wheels.py": ({"wheel_speed_latency"}, "reads this effect off gyro and wheels"),
    "cmr/estimation/search/leap.py": (
        {"slew_limit", "current_limit"},
        "converts one of these limits to the other, with some delay one way: a formula of both and of the motor",
    ),
    "cmr/diagnosis/live/causes.py": (
        {
            *("motor_gain_asymmetry", "battery_drift", "motor_heating", "surface_change", "payload_change"),
            *("lateral_skid", "gyro_bias", "gyro_scale", "pose_latency", "wheel_radius_scale"),
        },
        "a table of causes of changes during a drive, each with what to do and the effect that models it",
    ),
    "cmr/investigation/choosing.py": ({"motor_gain_asymmetry"}, "robots that pull to one side must stay on the floor"),
    "cmr/investigation/prediction.py": (
        {"battery_drift", "motor_heating"},
        "formulas that begin a prediction with the battery and the motors as they are now",
    ),
}


def named_in(path: Path) -> set[str]:
    """Return the names of effects and of their parameters that a module has as strings."""
    nodes = ast.walk(ast.parse(path.read_text("utf-8")))
    return {node.value for node in nodes if isinstance(node, ast.Constant) and node.value in NAMES}


def test_no_other_module_of_the_diagnosis_names_an_effect() -> None:
    modules = (path for package in PACKAGES for path in (PROJECT / package).rglob("*.py"))
    found = {path.relative_to(PROJECT).as_posix(): names for path in modules if (names := named_in(path))}
    assert found == {path: names for path, (names, _) in NAMING.items()}


def optional(kind: type[Effect] | type[ParameterDefinition]) -> Iterator[str]:
    """Yield the fields that an entry may leave out."""
    for field in fields(kind):
        if field.default is not MISSING or field.default_factory is not MISSING:
            yield field.name


@pytest.mark.parametrize("name", [*KINDS, *optional(Effect), *optional(ParameterDefinition)])
def test_the_page_on_entries_explains_every_field_and_every_kind_of_parameter(name: str) -> None:
    page = (PROJECT / "docs" / "how_to" / "add_an_effect.md").read_text("utf-8")
    assert f"`{name}`" in page or f"{name}=" in page


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=lambda effect: effect.name)
def test_relations_of_an_entry_are_to_others_that_are_there(effect: Effect) -> None:
    latencies = {one.name for other in CATALOGUE.values() for one in other.parameters if one.kind == "delay"}
    assert {*effect.seems_like} <= latencies
    assert {*effect.on_average} <= NAMES
    assert {*effect.same_without} <= {*CATALOGUE, "wheel_radius"}
    assert not effect.on_average or effect.by_chance
