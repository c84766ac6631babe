"""Limits on the size of a YAML text, checked on its events before any values are created.

A few hundred bytes with aliases can expand to billions of values, and deep nesting exhausts the loader's stack. An
alias counts as its full content each time.
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
    """The limits of a kind of document: bytes of its file, and number of values, including repetitions by aliases.

    Documents that only programs write have no aliases and no tags: `is_simple`.
    """

    size: int = 4_000_000
    values: int = 300_000
    is_simple: bool = False


class Exceeded(Exception):  # noqa: N818 - a finding, which the document's own error says
    """A text exceeds a limit or contains something forbidden; `line` counts from 1."""

    def __init__(self, line: int, words: str) -> None:
        super().__init__(words)
        self.line = line


class _Content(NamedTuple):
    """The content of an alias: its number of values, and its nesting depth."""

    values: int
    height: int


class _Open:
    """An open mapping or list: its anchor, the number of values before it, and the largest depth in it so far."""

    def __init__(self, anchor: str | None, before: int) -> None:
        self.anchor, self.before, self.height = anchor, before, 0


def check(text: str, bounds: Bounds) -> bool:
    """Check the limits; return whether a text has any content. Raises Exceeded, or yaml.YAMLError if it is not YAML.

    Reading stops at the first excess: for more than a thousand brackets the C loader fails, and the Python loader takes
    a minute.
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
    """Record the content of the mapping or list that ends here, for aliases."""
    ended = opened.pop()
    if ended.anchor is not None:
        known[ended.anchor] = _Content(values - ended.before, ended.height + 1)
    if opened:
        opened[-1].height = max(opened[-1].height, ended.height + 1)


def _content_of(event: yaml.NodeEvent, known: dict[str, _Content], follows_merge: bool) -> _Content:
    """Return how much a value or an alias adds. Raises Exceeded for an alias inside its own content."""
    one, name = _Content(1, 0), event.anchor or ""
    if isinstance(event, yaml.AliasEvent):
        if name not in known and not follows_merge:  # after <<, a later check gives a better error
            raise Exceeded(_line(event), "an alias (*) stands for what it is inside of, or for nothing")
        return known.get(name, one)
    if isinstance(event, yaml.ScalarEvent) and name:
        known[name] = one
    elif isinstance(event, yaml.CollectionStartEvent):
        known.pop(name, None)  # an earlier anchor of this name
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
