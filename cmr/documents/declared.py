"""How a dataclass declares its fields: for files, and as command-line options."""

from collections.abc import Callable, Sequence
from dataclasses import Field, dataclass, fields, is_dataclass
from typing import Annotated, get_args, get_origin, get_type_hints


@dataclass(frozen=True)
class Between:
    """The bounds of a number in a file, both allowed; on the command line it is greater than 0."""

    least: float
    most: float


@dataclass(frozen=True)
class Word:
    """One of a set of words, which is looked up when needed."""

    allowed: Callable[[], Sequence[str]]


@dataclass(frozen=True)
class Option:
    """A field's help text as a command-line option, and how to `read` it; by default a number greater than 0."""

    help: str
    metavar: str | None = None
    read: Callable[[str], object] | None = None


def help_of(made: type[object]) -> dict[str, str]:
    """Return the help of each field that has one."""
    return {entry.name: rule.help for entry, _, rules in declared(made) for rule in rules if isinstance(rule, Option)}


def fields_of(made: type[object]) -> "tuple[Field[object], ...]":
    """Return the fields of a dataclass."""
    assert is_dataclass(made), f"{made} is no dataclass"
    return fields(made)


def declared(made: type[object]) -> list[tuple[Field[object], object, list[object]]]:
    """Return each field of a dataclass with its type, and what is annotated to it."""
    hints = get_type_hints(made, include_extras=True)
    return [(entry, *_taken_apart(hints[entry.name])) for entry in fields_of(made)]


def _taken_apart(hint: object) -> tuple[object, list[object]]:
    """Return the type of an optional field without None, and its annotations."""
    if get_origin(hint) is Annotated:
        inner, *rules = get_args(hint)
        kind, others = _taken_apart(inner)
        return kind, rules + others
    alternatives = [one for one in get_args(hint) if one is not type(None)]
    return _taken_apart(alternatives[0]) if alternatives else (hint, [])
