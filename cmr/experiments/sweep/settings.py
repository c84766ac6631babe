"""Varied settings of a scenario: keys by dotted path, with the values that each takes."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import yaml

from cmr.experiments.team.plan import BehaviourPlan

Value: TypeAlias = float | int | str | bool | list[object] | dict[str, object] | None
SEED = "seed"  # of the scenario; varied separately
NOTHING = ("null", "~")  # in YAML: the scenario without this key


class SettingError(Exception):
    """A setting cannot be used; the text names its key and says what is allowed."""


@dataclass(frozen=True)
class Setting:
    """A key of the scenario, such as robots.10.behaviour.gap, and its values."""

    path: str
    values: tuple[Value, ...]


def setting_of(text: str) -> Setting:
    """Parse a setting from `path=value,value,...`; commas inside brackets or braces do not separate values.

    Raises SettingError if the form is wrong, or a value is repeated.
    """
    path, equals, listed = text.partition("=")
    path = path.strip()
    if not equals or not path or not all(path.split(".")):
        raise SettingError(f"{text!r} is not of the form key=value,value,...; robots.10.behaviour.gap=0.3,0.5 is")
    if path == SEED:
        raise SettingError(f"{SEED}: is varied by --seeds, from the scenario's own on")
    values = tuple(_value(path, part.strip()) for part in _parts(listed))
    if len({repr(value) for value in values}) < len(values):
        raise SettingError(f"{path}: a value comes twice in {listed!r}")
    return Setting(path, values)


def _parts(listed: str) -> list[str]:
    """Split at commas outside brackets and braces."""
    parts, depth = [""], 0
    for character in listed:
        depth += (character in "[{") - (character in "]}")
        if character == "," and depth <= 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def _value(path: str, text: str) -> Value:
    """Parse a value as YAML; 1e-3, which YAML 1.1 reads as text, becomes a number."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    try:
        value: Value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise SettingError(f"{path}: {text!r} is no value that YAML can read") from error
    if value is None and text not in NOTHING:
        raise SettingError(f"{path}: there is a comma too many, or no value")
    return value


def combinations(settings: Sequence[Setting]) -> list[dict[str, Value]]:
    """Return every combination of the values, by path; the last setting varies fastest.

    Raises SettingError for a key that is set twice.
    """
    paths = [setting.path for setting in settings]
    for path in paths:
        if paths.count(path) > 1:
            raise SettingError(f"{path}: is set twice; give all its values at once, {path}=first,second")
    return [dict(zip(paths, values, strict=True)) for values in product(*(setting.values for setting in settings))]


def with_settings(document: Mapping[str, object], values: Mapping[str, Value]) -> dict[str, Any]:
    """Return a scenario, as read from YAML, with changed values at some paths.

    Raises SettingError naming the missing part of a path, and what exists.
    """
    changed = deepcopy(dict(document))
    for path, value in values.items():
        *way, last = path.split(".")
        place: object = changed
        for depth, part in enumerate(way):
            place = _inside(place, part, path, ".".join(way[:depth]))
        _put(place, last, value, path, ".".join(way))
    return changed


def _inside(place: object, part: str, path: str, where: str) -> object:
    """Return the value at a part of a path; a behaviour given as text is parsed for it."""
    key = _key(place, part, path, where)
    assert isinstance(place, dict | list), "nothing else has keys"
    if isinstance(place[key], str) and part == "behaviour":
        place[key] = _taken_apart(place[key])
    return place[key]


def _put(place: object, last: str, value: Value, path: str, where: str) -> None:
    if isinstance(place, dict):
        place[last] = value  # a new key; reading the scenario checks whether it exists
    else:
        index = _key(place, last, path, where)
        assert isinstance(place, list), "nothing else has keys"
        place[index] = value


def _key(place: object, part: str, path: str, where: str) -> Any:
    """Return the key or index for a part of a path; robots are identified by their ids."""
    there: dict[str, object] = {}
    if isinstance(place, dict):
        there = {str(key): key for key in place}
    elif isinstance(place, list):
        there = {str(_name(entry, index)): index for index, entry in enumerate(place)}
    if part not in there:
        inside = f"in {where}" if where else "in the scenario"
        known = f"there are {', '.join(there)}" if there else "it holds nothing that could be set one by one"
        raise SettingError(f"{path}: there is no {part!r} {inside}; {known}")
    return there[part]


def _name(entry: object, index: int) -> object:
    """Return the name of a list entry: a robot's id, a group's first id, otherwise its index."""
    return entry.get("id", entry.get("first_id", index)) if isinstance(entry, dict) else index


def _taken_apart(behaviour: str) -> dict[str, object]:
    """Parse `name,key=value,...` to a mapping."""
    name, *pairs = behaviour.split(",")
    settings = {key.strip(): value.strip() for key, _, value in (pair.partition("=") for pair in pairs)}
    return BehaviourPlan(name.strip(), settings).mapping
