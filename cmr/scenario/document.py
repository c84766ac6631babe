"""YAML as values that know where they stand, so that every error names file, line and key."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import yaml

Number = TypeVar("Number", int, float)

# The loader in C, where it is installed, takes a tenth of the time; on deep nesting it would overrun its stack.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
DEEPEST = 50  # mappings and lists inside one another

LARGEST = 1e6  # metres, seconds; larger than any laboratory
LONGEST_QUOTE = 60  # characters of a wrong value that an error repeats
KINDS = {yaml.MappingNode: "a mapping", yaml.SequenceNode: "a list", yaml.ScalarNode: "a single value"}
NULL, BOOL = "tag:yaml.org,2002:null", "tag:yaml.org,2002:bool"
TRUE = frozenset({"true", "yes", "on"})  # the words of YAML 1.1, in any case


class ScenarioError(Exception):
    """A scenario cannot be used; the text names file, line and key, and says what is allowed."""


class Place(NamedTuple):
    """Where a value stands: the file, its line from 1 on, and the key with those above it, as `robots[2].start`."""

    source: str
    line: int
    key: str

    def error(self, words: str) -> ScenarioError:
        """Return the error that something is wrong here."""
        return ScenarioError(f"{self.source}: line {self.line}: {self.key + ': ' if self.key else ''}{words}")


class Item:
    """One value of the document; each method returns it as one type, or raises ScenarioError if it is none."""

    def __init__(self, node: yaml.Node, source: str, key: str) -> None:
        self._node = node
        self.place = Place(source, node.start_mark.line + 1, key)

    @property
    def is_mapping(self) -> bool:
        """Whether it is a mapping of keys to values."""
        return isinstance(self._node, yaml.MappingNode)

    @property
    def is_list(self) -> bool:
        """Whether it is a list."""
        return isinstance(self._node, yaml.SequenceNode)

    @property
    def is_absent(self) -> bool:
        """Whether it is null, which is the same as no value at all."""
        return self._node.tag == NULL

    def section(self, known: Sequence[str]) -> "Section":
        """Return a mapping that has these keys at most."""
        return Section(self._node, self.place, known)

    def entries(self) -> "list[tuple[str, Item]]":
        """Return a mapping's keys, whatever they are, with their values."""
        if not isinstance(self._node, yaml.MappingNode):
            raise self._unlike("a mapping of names to values")
        return _entries(self._node, self.place)

    def items(self) -> "list[Item]":
        """Return the elements of a list."""
        if not isinstance(self._node, yaml.SequenceNode):
            raise self._unlike("a list")
        return [Item(node, self.place.source, f"{self.place.key}[{k}]") for k, node in enumerate(self._node.value)]

    def numbers(self, names: str) -> list[float]:
        """Return a list of as many numbers as are named, as in "x y"."""
        expected = names.split()
        values = self.items() if self.is_list else []
        if len(values) != len(expected):
            raise self._unlike(f"a list of {len(expected)} numbers, [{', '.join(expected)}]")
        return [value.number() for value in values]

    def text(self) -> str:
        """Return a text that is not empty."""
        if not isinstance(self._node, yaml.ScalarNode) or not self._node.value.strip():
            raise self._unlike("a text")
        return str(self._node.value).strip()

    def word(self, allowed: Sequence[str]) -> str:
        """Return one of these words."""
        if not isinstance(self._node, yaml.ScalarNode) or self._node.value not in allowed:
            raise self._unlike(f"one of {', '.join(allowed)}")
        return str(self._node.value)

    def flag(self) -> bool:
        """Return true or false."""
        if not isinstance(self._node, yaml.ScalarNode) or self._node.tag != BOOL:
            raise self._unlike("true or false")
        return self._node.value.lower() in TRUE

    def number(self, least: float = -LARGEST, most: float = LARGEST) -> float:
        """Return a number within these bounds, both allowed."""
        value = self._as(float)
        if value is None or not least <= value <= most:
            raise self._unlike(f"a number from {least:g} to {most:g}")
        return value

    def whole(self, least: int, most: int) -> int:
        """Return a whole number within these bounds, both allowed."""
        value = self._as(int)
        if value is None or not least <= value <= most:
            raise self._unlike(f"a whole number from {least} to {most}")
        return value

    def _as(self, kind: Callable[[str], Number]) -> Number | None:
        try:
            return kind(self._node.value) if isinstance(self._node, yaml.ScalarNode) else None
        except ValueError:
            return None

    def _unlike(self, expected: str) -> ScenarioError:
        is_scalar = isinstance(self._node, yaml.ScalarNode)
        found = repr(self._node.value) if is_scalar else KINDS.get(type(self._node), "something else")
        if self.is_list:
            found += f" of {len(self._node.value)}"
        shown = found if len(found) <= LONGEST_QUOTE else f"{found[:LONGEST_QUOTE]}..."
        return self.place.error(f"must be {expected}, not {shown}")


class Section:
    """A mapping whose keys are known.

    Raises ScenarioError on construction when it is no mapping, or has another key or one twice.
    """

    def __init__(self, node: yaml.Node, place: Place, known: Sequence[str]) -> None:
        self.place = place
        if not isinstance(node, yaml.MappingNode):
            raise place.error(f"must be a mapping with some of: {', '.join(known)}")
        self._items = dict(_entries(node, place))
        for key, item in self._items.items():
            if key not in known:
                raise item.place.error(f"is not known here. Known are: {', '.join(known)}")

    def __contains__(self, key: str) -> bool:
        return self.get(key) is not None

    def get(self, key: str) -> Item | None:
        """Return the value of a key; None where it is absent or null."""
        item = self._items.get(key)
        return None if item is None or item.is_absent else item

    def need(self, key: str, why: str = "") -> Item:
        """Return the value of a key that has to be there."""
        item = self.get(key)
        if item is None:
            raise self.place.error(f"{key} is missing{': ' + why if why else ''}")
        return item


def read(text: str, source: str) -> Item:
    """Return the document of a YAML text; `source` names it in errors.

    Raises ScenarioError when it is not YAML, or empty.
    """
    try:
        node = yaml.compose(text, Loader=LOADER) if _depth(text) <= DEEPEST else None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise Place(source, line, "").error(f"is not YAML: {error.problem or error.context}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise Place(source, 1, "").error(f"is not YAML: {' '.join(str(error).split())}") from error
    if node is None:
        raise Place(source, 1, "").error("is empty, or nested too deeply")
    return Item(node, source, "")


def _depth(text: str) -> int:
    """Return how many mappings and lists are inside one another at most."""
    depth = deepest = 0
    for event in yaml.parse(text, Loader=LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        deepest = max(deepest, depth)
    return deepest


def _entries(node: yaml.MappingNode, place: Place) -> list[tuple[str, Item]]:
    """Return the keys and values of a mapping, in order."""
    entries: dict[str, Item] = {}
    for key_node, value_node in node.value:
        at = place._replace(line=key_node.start_mark.line + 1)
        if not isinstance(key_node, yaml.ScalarNode):
            raise at.error("a key must be a single word")
        name = str(key_node.value)
        item = Item(value_node, place.source, f"{place.key}.{name}" if place.key else name)
        item.place = item.place._replace(line=at.line)
        if name in entries:
            raise item.place.error("is there twice")
        entries[name] = item
    return list(entries.items())
