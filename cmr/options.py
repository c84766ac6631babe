"""A dataclass that is a command line: each field is an option of the same name, with its help and bounds.

The same dataclass is what a file may say (`cmr.structure`), so an option is declared once.
"""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Sequence
from dataclasses import MISSING, Field, dataclass, fields
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

Made = TypeVar("Made")


@dataclass(frozen=True)
class Between:
    """The bounds of a number in a file, both allowed; on the command line it is greater than 0."""

    least: float
    most: float


@dataclass(frozen=True)
class Word:
    """One of some words, which are looked up when they are needed."""

    allowed: Callable[[], Sequence[str]]


@dataclass(frozen=True)
class Option:
    """What the help of the command says of a field."""

    help: str
    metavar: str | None = None


def add_options(parser: ArgumentParser, made: type[Any]) -> None:
    """Add an option for each field of a dataclass that is an `Option`; without a default it is None if not given."""
    for entry, kind, rules in _declared(made):
        option = next((rule for rule in rules if isinstance(rule, Option)), None)
        if option is None:
            continue
        name, default = f"--{entry.name.replace('_', '-')}", None if entry.default is MISSING else entry.default
        words = next((rule.allowed() for rule in rules if isinstance(rule, Word)), None)
        if kind is bool:
            parser.add_argument(name, action="store_true", help=option.help)
        elif words is not None:
            parser.add_argument(name, choices=words, default=default, help=option.help)
        else:
            read = PARSED.get(kind, kind)
            parser.add_argument(name, type=read, default=default, metavar=option.metavar, help=option.help)


def help_of(made: type[Any]) -> dict[str, str]:
    """Return the help of each field that has one."""
    return {entry.name: rule.help for entry, _, rules in _declared(made) for rule in rules if isinstance(rule, Option)}


def made_of(made: type[Made], options: Namespace) -> Made:
    """Return the dataclass whose fields are options.

    Raises what the dataclass raises for options that contradict each other.
    """
    return made(**{entry.name: getattr(options, entry.name) for entry in fields(made)})  # type: ignore[arg-type]


def arguments_of(made: Any) -> list[str]:
    """Return the options that make this dataclass; those that have their default are left out."""
    options: list[str] = []
    for entry in fields(made):
        value = getattr(made, entry.name)
        if value is True:
            options.append(f"--{entry.name.replace('_', '-')}")
        elif value != entry.default:
            options += [f"--{entry.name.replace('_', '-')}", str(value)]
    return options


def _declared(made: type[Any]) -> list[tuple[Field[Any], Any, list[Any]]]:
    """Return each field of a dataclass with its type, and what is annotated to it."""
    hints = get_type_hints(made, include_extras=True)
    return [(entry, *_taken_apart(hints[entry.name])) for entry in fields(made)]


def _taken_apart(hint: Any) -> tuple[Any, list[Any]]:
    """Return the type of a field that may be None, and what is annotated to it."""
    if get_origin(hint) is Annotated:
        inner, *rules = get_args(hint)
        kind, others = _taken_apart(inner)
        return kind, rules + others
    alternatives = [one for one in get_args(hint) if one is not type(None)]
    return _taken_apart(alternatives[0]) if alternatives else (hint, [])


def _positive(text: str) -> int:
    if not (text.strip().isascii() and text.strip().lstrip("+-").isdecimal()):
        raise ArgumentTypeError(f"{text!r} is not a whole number")
    if int(text) <= 0:
        raise ArgumentTypeError(f"{int(text)} must be greater than 0")
    return int(text)


def _positive_number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0.0 < value < float("inf"):
        raise ArgumentTypeError(f"{value} must be greater than 0")
    return value


PARSED: dict[Any, Callable[[str], Any]] = {int: _positive, float: _positive_number}
