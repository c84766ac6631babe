"""YAML values with their positions, so that every error names file, line and key.

It reads all files written by people: scenarios, settings of the emulated robot, parameter files, mappings, camera files
and the configuration. Each has a subclass of `DocumentError`. `cmr.documents.structure` makes dataclasses from its
values.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple, TypeVar

import yaml
from yaml.constructor import ConstructorError, SafeConstructor

from cmr.documents import bounds
from cmr.documents.bounds import Bounds, Exceeded
from cmr.files import read_text
from cmr.plain_text import plain

Number = TypeVar("Number", int, float)

LARGEST = 1e6  # metres, seconds; larger than any laboratory
LONGEST_QUOTE = 60  # characters of an invalid value quoted in an error
LONGEST_KEYS = 200  # characters of keys that an error names
LONGEST_NUMBER = 1000  # characters; parsing some YAML 1.1 numbers takes quadratic time
MOST_NUMBER_KEYS = 200  # of a mapping; colliding numbers would take quadratic time
# The Python loader takes a second for ten times as many characters, and for each bracket it scans all open ones.
LONGEST_IN_PLAIN_WORDS, MOST_BRACKETS = 5_000, 200
KINDS = {yaml.MappingNode: "a mapping", yaml.SequenceNode: "a list", yaml.ScalarNode: "a single value"}
NULL, BOOL, MERGE = "tag:yaml.org,2002:null", "tag:yaml.org,2002:bool", "tag:yaml.org,2002:merge"
NUMBERS = frozenset({"tag:yaml.org,2002:int", "tag:yaml.org,2002:float"})
TRUE = frozenset({"true", "yes", "on"})  # the words of YAML 1.1, in any case
# PyYAML's errors for a value that contradicts its tag or form: `!!int no`, `2026-13-31T12:00:00Z`.
UNREADABLE = (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError)


def is_finite(value: float) -> bool:
    """Return whether a number fits in a float; `math.isfinite` raises for large integers."""
    return abs(value) <= sys.float_info.max


def quoted(value: object) -> str:
    """Return an invalid value as quoted in an error."""
    return plain(repr(value), LONGEST_QUOTE)


class _Constructor(SafeConstructor):
    """Constructs values from nodes; refuses long numbers, because some take quadratic time."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> object:
        if node.tag in NUMBERS and len(node.value) > LONGEST_NUMBER:
            raise ConstructorError(None, None, f"a number of {len(node.value)} characters", node.start_mark)
        if isinstance(node, yaml.MappingNode) and len(node.value) > MOST_NUMBER_KEYS and _has_number_keys(node):
            raise ConstructorError(None, None, f"more than {MOST_NUMBER_KEYS} numbers as keys", node.start_mark)
        return super().construct_object(node, deep)


def _has_number_keys(node: yaml.MappingNode) -> bool:
    return sum(key.tag in NUMBERS for key, _ in node.value) > MOST_NUMBER_KEYS


class DocumentError(Exception):
    """A file cannot be used; the text names file, line and key, and says what is allowed.

    Code that validates values without their file sets the `keys` that lead to the value, and `placed` adds the rest;
    the line is that of the keys `inside` of it, which the message names itself.
    """

    between: ClassVar[str] = "."  # keys
    after: ClassVar[str] = ": "  # keys, before the words
    unknown: ClassVar[str] = "is not known here. Known are: {known}"
    section: ClassVar[str] = "mapping"  # what a mapping inside the file is called
    not_yaml: ClassVar[str] = "is not YAML"
    empty: ClassVar[str] = "is empty"
    bounds: ClassVar[Bounds] = Bounds()

    def __init__(self, words: str, *keys: str, inside: tuple[str, ...] = ()) -> None:
        super().__init__(_said(self, "", keys, words))
        self.words = words
        self.keys = keys
        self.inside = inside
        self.is_placed = False

    def placed(self, root: "Item") -> "DocumentError":
        """Return the error with file and line of its keys in the document; unchanged if it has them."""
        if self.is_placed:
            return self
        line = root.found((*self.keys, *self.inside)).line
        return root.found(self.keys)._replace(line=line).error(self.words)


class Place(NamedTuple):
    """The position of a value: file, line (from 1), and full key, such as `robots[2].start`."""

    source: str
    line: int
    key: str
    kind: type[DocumentError] = DocumentError

    def error(self, words: str) -> DocumentError:
        """Return an error of the document's kind at this place."""
        error = self.kind(
            _said(self.kind, f"{self.source}: line {self.line}: ", (self.key,) if self.key else (), words)
        )
        error.is_placed = True
        return error


def _said(kind: type[DocumentError] | DocumentError, where: str, keys: Sequence[str], words: str) -> str:
    named = plain(kind.between.join(keys), LONGEST_KEYS)
    return f"{where}{named}{kind.after if keys else ''}{words}"


class Item:
    """One value of the document; each method returns it as one type, or raises the document's error.

    `below` is the fallback for missing keys of a mapping, possibly from another file.
    """

    def __init__(self, node: yaml.Node, place: Place, below: "Item | None" = None) -> None:
        self._node = node
        self._below = below
        self.place = place

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
        """Whether it is null, which is the same as a missing value."""
        return bool(self._node.tag == NULL)

    @property
    def value(self) -> object:
        """The value as YAML represents it, with all its content."""
        try:
            return _Constructor().construct_document(self._node)
        except UNREADABLE as error:
            mark = error.problem_mark if isinstance(error, yaml.MarkedYAMLError) else None
            place = self.place._replace(line=mark.line + 1) if mark else self.place
            words = error.problem if isinstance(error, yaml.MarkedYAMLError) else str(error)
            raise place.error(f"cannot be read: {plain(' '.join(str(words).split()), LONGEST_KEYS)}") from error

    def over(self, below: "Item") -> "Item":
        """Return the mapping with another one as fallback for missing keys."""
        return Item(self._node, self.place, below)

    def section(self, known: Sequence[str]) -> "Section":
        """Return a mapping with no keys other than these."""
        return Section(self, known)

    def entries(self) -> "list[tuple[str, Item]]":
        """Return a mapping's keys, whatever they are, with their values."""
        if not isinstance(self._node, yaml.MappingNode):
            raise self._unlike("a mapping of names to values")
        entries = dict(self._below.entries()) if self._below is not None and self._below.is_mapping else {}
        for name, item in _entries(self._node, self.place).items():
            entries[name] = item.over(entries[name]) if name in entries else item
        return list(entries.items())

    def check_keys(self) -> None:
        """Raise the document's error if a mapping has a duplicate key, at any depth; `value` takes the last of them."""
        items = self.items() if self.is_list else [item for _, item in self.entries()] if self.is_mapping else []
        for item in items:
            item.check_keys()

    def items(self) -> "list[Item]":
        """Return the elements of a list."""
        if not isinstance(self._node, yaml.SequenceNode):
            raise self._unlike("a list")
        return [
            Item(node, _place(node, self.place, f"{self.place.key}[{k}]")) for k, node in enumerate(self._node.value)
        ]

    def found(self, keys: Sequence[str]) -> Place:
        """Return the place that keys lead to, as far as they exist; the key is named in full."""
        item: Item | None = self
        place = self.place
        for key in keys:
            item = dict(item.entries()).get(key) if item is not None and item.is_mapping else None
            place = item.place if item is not None else place._replace(key=_joined(place, key))
        return place

    def numbers(self, names: str) -> list[float]:
        """Return a list with one number per name, as in "x y"."""
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
        """Return a number within these inclusive bounds."""
        value = self._as(float)
        if value is None or not least <= value <= most:
            raise self._unlike(f"a number from {least:g} to {most:g}")
        return value

    def whole(self, least: int, most: int) -> int:
        """Return a whole number within these inclusive bounds."""
        value = self._as(int)
        if value is None or not least <= value <= most:
            raise self._unlike(f"a whole number from {least} to {most}")
        return value

    def _as(self, kind: Callable[[str], Number]) -> Number | None:
        try:
            return kind(self._node.value) if isinstance(self._node, yaml.ScalarNode) else None
        except ValueError:
            return None

    def _unlike(self, expected: str) -> DocumentError:
        is_scalar = isinstance(self._node, yaml.ScalarNode)
        found = quoted(self._node.value) if is_scalar else KINDS.get(type(self._node), "something else")
        if self.is_list:
            found += f" of {len(self._node.value)}"
        return self.place.error(f"must be {expected}, not {found}")


class Section:
    """A mapping with known keys.

    Raises the document's error on construction if it is not a mapping, or has an unknown or duplicate key.
    """

    def __init__(self, item: Item, known: Sequence[str]) -> None:
        self.place = item.place
        if not item.is_mapping:
            kind = self.place.kind.section if self.place.key else "mapping"
            raise self.place.error(f"must be a {kind} with some of: {', '.join(known)}")
        self._items = dict(item.entries())
        for key, value in self._items.items():
            if key not in known:
                raise value.place.error(self.place.kind.unknown.format(known=", ".join(known)))

    def __contains__(self, key: str) -> bool:
        return self.get(key) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __getitem__(self, key: str) -> Item:
        return self._items[key] if key in self._items else self.need(key)

    def get(self, key: str) -> Item | None:
        """Return the value of a key; None if it is missing or null."""
        item = self._items.get(key)
        return None if item is None or item.is_absent else item

    def need(self, key: str, why: str = "") -> Item:
        """Return the value of a required key."""
        item = self.get(key)
        if item is None:
            raise self.place.error(f"{key} is missing{': ' + why if why else ''}")
        return item


def read_file(path: Path, kind: type[DocumentError], *, may_be_empty: bool = False) -> Item:
    """Return the document of a YAML file; an empty one is an empty mapping if `may_be_empty`.

    Raises the error of this kind when it cannot be read or is not YAML, or empty.
    """
    try:
        text = read_text(path, kind.bounds.size)
    except OSError as error:
        raise kind(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise kind(f"{path}: cannot be read: it is not UTF-8 text") from error
    return read(text, str(path), kind, may_be_empty=may_be_empty)


def read(text: str, source: str, kind: type[DocumentError], *, may_be_empty: bool = False) -> Item:
    """Return the document of a YAML text; `source` names it in errors.

    Raises the error of this kind when it is not YAML, or empty.
    """
    place = Place(source, 1, "", kind)
    try:
        says_something = bounds.check(text, kind.bounds)
        node = yaml.compose(text, Loader=bounds.LOADER)
    except Exceeded as exceeded:
        raise place._replace(line=exceeded.line).error(f"{kind.not_yaml}: {exceeded}") from None
    except yaml.MarkedYAMLError as error:
        plainer = _in_plain_words(text) or error
        mark = plainer.problem_mark or plainer.context_mark
        at = place._replace(line=mark.line + 1 if mark else 1)
        raise at.error(f"{kind.not_yaml}: {plain(str(plainer.problem or plainer.context), LONGEST_KEYS)}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise place.error(f"{kind.not_yaml}: {plain(' '.join(str(error).split()), LONGEST_KEYS)}") from error
    if may_be_empty and (node.tag == NULL if node is not None else not says_something):
        node = yaml.MappingNode("tag:yaml.org,2002:map", [], yaml.Mark(source, 0, 0, 0, "", 0))
    if node is None:
        raise place.error(kind.empty)
    return Item(node, _place(node, place, ""))


def _in_plain_words(text: str) -> yaml.MarkedYAMLError | None:
    """Return the Python loader's explanation of an error; it names the character and what it expected."""
    if len(text) > LONGEST_IN_PLAIN_WORDS or text.count("[") + text.count("{") > MOST_BRACKETS:
        return None
    try:
        for _ in yaml.parse(text, Loader=yaml.SafeLoader):
            pass
    except yaml.MarkedYAMLError as error:
        return error
    except yaml.YAMLError:
        pass
    return None


def _place(node: yaml.Node, above: Place, key: str) -> Place:
    return above._replace(line=node.start_mark.line + 1, key=key)


def _joined(above: Place, key: str) -> str:
    return f"{above.key}{above.kind.between}{key}" if above.key else key


def _entries(node: yaml.MappingNode, place: Place) -> dict[str, Item]:
    """Return the keys and values of a mapping, in order; those merged by `<<` come first."""
    entries: dict[str, Item] = {}
    taken_in: dict[str, Item] = {}
    for key_node, value_node in node.value:
        at = _place(key_node, place, place.key)
        if not isinstance(key_node, yaml.ScalarNode):
            raise at.error("a key must be a single word")
        if key_node.tag == MERGE:
            taken_in |= _taken_in(value_node, at)
            continue
        name = str(key_node.value)
        item = Item(value_node, at._replace(key=_joined(place, name)))
        if name in entries:
            raise item.place.error("is there twice")
        entries[name] = item
    return taken_in | entries


def _taken_in(node: yaml.Node, place: Place) -> dict[str, Item]:
    """Return the entries of the mappings after `<<`; the first occurrence of a key counts."""
    taken_in: dict[str, Item] = {}
    for one in reversed(node.value) if isinstance(node, yaml.SequenceNode) else [node]:
        if not isinstance(one, yaml.MappingNode):
            raise place.error("<< must name a mapping")
        try:
            taken_in |= _entries(one, place)
        except RecursionError:
            raise place.error("<< names a mapping that takes in itself") from None
    return taken_in
