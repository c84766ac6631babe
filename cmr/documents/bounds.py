"""How much a YAML text may hold, seen from its events, before anything is made of them.

A few hundred bytes with aliases stand for billions of values, and brackets inside one another take the loader's stack.
What an alias stands for counts each time.
"""

from collections.abc import Iterator
from typing import NamedTuple

import yaml

# The loader in C, where it is installed, takes a tenth of the time; on deep nesting it would overrun its stack.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
DEEPEST = 50  # mappings and lists inside one another
TOO_DEEP_FOR_C = "exceeded maximum nesting depth"
MERGE_KEY = "<<"


class Bounds(NamedTuple):
    """The most that a kind of document may hold: bytes of its file, and values, those that aliases repeat among them.

    Where a document is only written by programs it has no aliases and no tags: `is_simple`.
    """

    size: int = 4_000_000
    values: int = 300_000
    is_simple: bool = False


class Exceeded(Exception):  # noqa: N818 - a finding, which the document's own error says
    """A text holds more than it may, or what it may not; `line` counts from 1."""

    def __init__(self, line: int, words: str) -> None:
        super().__init__(words)
        self.line = line


class _Content(NamedTuple):
    """What an alias stands for: how many values, and how many mappings and lists are inside one another."""

    values: int
    height: int


class _Open:
    """A mapping or list that has not ended: its anchor, the values before it, and the highest content in it so far."""

    def __init__(self, anchor: str | None, before: int) -> None:
        self.anchor, self.before, self.height = anchor, before, 0


def check(text: str, bounds: Bounds) -> bool:
    """Return whether a text says anything at all. Raises Exceeded, or yaml.YAMLError where it is not YAML.

    Of more than a thousand brackets the loader in C says that they are too many, and the one in Python nothing for a
    minute: what is too much is not read to its end.
    """
    if len(text.encode(errors="replace")) > bounds.size:
        raise Exceeded(1, f"is larger than {bounds.size / 1e6:g} MB, which is the most that is read")
    try:
        return _check_events(yaml.parse(text, Loader=LOADER), bounds)
    except yaml.MarkedYAMLError as error:
        if error.problem != TOO_DEEP_FOR_C:
            raise
        raise Exceeded(1, _too_deep()) from None


def _check_events(events: Iterator[yaml.Event], bounds: Bounds) -> bool:
    opened: list[_Open] = []
    known: dict[str, _Content] = {}
    values = 0
    follows_merge = False
    for event in events:
        if isinstance(event, yaml.CollectionEndEvent):
            _close(opened, known, values)
        elif isinstance(event, yaml.NodeEvent):
            content = _content_of(event, known, follows_merge)
            values += content.values
            if isinstance(event, yaml.CollectionStartEvent):
                opened.append(_Open(event.anchor, values - 1))
            elif opened:
                opened[-1].height = max(opened[-1].height, content.height)
            _check_one(event, bounds, values, len(opened) + content.height)
            follows_merge = isinstance(event, yaml.ScalarEvent) and event.value == MERGE_KEY
    return values > 0


def _close(opened: list[_Open], known: dict[str, _Content], values: int) -> None:
    """Note what an alias of the mapping or list that ends here stands for."""
    ended = opened.pop()
    if ended.anchor is not None:
        known[ended.anchor] = _Content(values - ended.before, ended.height + 1)
    if opened:
        opened[-1].height = max(opened[-1].height, ended.height + 1)


def _content_of(event: yaml.NodeEvent, known: dict[str, _Content], follows_merge: bool) -> _Content:
    """Return how much a value or an alias adds. Raises Exceeded for an alias inside of what it stands for."""
    one, name = _Content(1, 0), event.anchor or ""
    if isinstance(event, yaml.AliasEvent):
        if name not in known and not follows_merge:  # after << the error says more where it is taken in
            raise Exceeded(_line(event), "an alias (*) stands for what it is inside of, or for nothing")
        return known.get(name, one)
    if isinstance(event, yaml.ScalarEvent) and name:
        known[name] = one
    elif isinstance(event, yaml.CollectionStartEvent):
        known.pop(name, None)  # of a former one of this name
    return one


def _check_one(event: yaml.NodeEvent, bounds: Bounds, values: int, depth: int) -> None:
    is_plain = isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent) and event.tag is None
    if bounds.is_simple and not is_plain:
        raise Exceeded(_line(event), "aliases (*name) and tags (!name) are not read here: write the value itself")
    if depth > DEEPEST:
        raise Exceeded(1, _too_deep())
    if values > bounds.values:
        raise Exceeded(_line(event), f"holds more than {bounds.values} values, which is the most that is read")


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark is not None else 1


def _too_deep() -> str:
    return f"nested too deeply, more than {DEEPEST} mappings and lists"
