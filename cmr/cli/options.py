"""Dataclasses as command lines: each field is an option of the same name, with its help and bounds.

The same dataclass defines the contents of files (`cmr.documents.structure`), so an option is declared once, by the
rules of `cmr.documents.declared`.
"""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable
from dataclasses import MISSING
from typing import TypeVar

from cmr.documents.declared import Option, Word, declared, fields_of

Made = TypeVar("Made")


def add_options(parser: ArgumentParser, made: type[object]) -> None:
    """Add an option for each `Option` field of a dataclass; without a default it is None if not given."""
    for entry, kind, rules in declared(made):
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
            assert callable(kind), f"{name} is of a type that reads it"
            read = option.read or PARSED.get(kind, kind)
            parser.add_argument(name, type=read, default=default, metavar=option.metavar, help=option.help)


def made_of(made: type[Made], options: Namespace) -> Made:
    """Return the dataclass made from parsed options.

    Raises the dataclass's errors for contradictory options.
    """
    return made(**{entry.name: getattr(options, entry.name) for entry in fields_of(made)})


def arguments_of(made: object) -> list[str]:
    """Return the options that make this dataclass, without those at their defaults."""
    options: list[str] = []
    for entry in fields_of(type(made)):
        value = getattr(made, entry.name)
        if value is True:
            options.append(f"--{entry.name.replace('_', '-')}")
        elif value != entry.default:
            options += [f"--{entry.name.replace('_', '-')}", str(value)]
    return options


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


PARSED: dict[object, Callable[[str], object]] = {int: _positive, float: _positive_number}
