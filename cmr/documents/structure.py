"""Make dataclasses from document values: the fields that a dataclass declares are what its file may contain.

    @dataclass(frozen=True)
    class Sensor:
        enabled: bool
        rate: Annotated[float, Between(1.0, 100.0)] = 50.0
        kind: Annotated[str, Word(kinds)] | None = None

Unknown keys, values of other types, and missing fields without a default are refused. If the dataclass itself raises
the document's error with the keys of a value, it is located as well.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, is_dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, TypeVar, cast, get_args, get_origin

from cattrs import Converter
from cattrs.gen import make_dict_structure_fn

from cmr.documents.declared import Between, Word, fields_of, help_of
from cmr.documents.document import DocumentError, Item, Number, is_finite, quoted

Made = TypeVar("Made")


@dataclass(frozen=True)
class Names:
    """The names that the numbers of a dictionary may have."""

    known: Sequence[str]


def structured(item: Item, made: type[Made]) -> Made:
    """Return the dataclass described by a mapping.

    Raises the document's error, with file, line and key, for anything the dataclass does not allow.
    """
    return _converter().structure(item, made)


@cache
def _converter() -> Converter:
    converter = Converter(detailed_validation=False)
    converter.register_structure_hook_factory(is_dataclass, lambda made: _dataclass_hook(made, converter))
    converter.register_structure_hook_func(_is_annotated, _annotated)
    converter.register_structure_hook(str, lambda item, _: _text(item))
    converter.register_structure_hook(Path, lambda item, _: Path(_text(item)))
    converter.register_structure_hook(bool, lambda item, _: _flag(item))
    converter.register_structure_hook(int, lambda item, _: _number(item, int))
    converter.register_structure_hook(float, lambda item, _: _number(item, float))
    return converter


def _dataclass_hook(made: type[Made], converter: Converter) -> Callable[[Item, object], Made]:
    make = make_dict_structure_fn(made, converter, _cattrs_detailed_validation=False)
    known = [field.name for field in fields_of(made) if field.init]
    needed = [field.name for field in fields_of(made) if field.default is MISSING and field.default_factory is MISSING]
    why = help_of(made)

    def hook(item: Item, _: object) -> Made:
        section = item.section(known)
        for name in needed:
            if name not in set(section):
                section.need(name, why.get(name, ""))
        try:
            return make(cast(Mapping[str, object], section), made)  # as far as cattrs needs one
        except DocumentError as error:
            raise error.placed(item) from error.__cause__
        except ValueError as error:  # raised by the dataclass itself
            raise item.place.error(str(error)) from error

    return hook


def _is_annotated(kind: object) -> bool:
    return get_origin(kind) is Annotated


def _annotated(item: Item, kind: object) -> object:
    """Return a number within its bounds, one of some words, or numbers by names that are known."""
    plain, *rules = get_args(kind)
    for rule in rules:
        if isinstance(rule, Word):
            return item.word(rule.allowed())
        if isinstance(rule, Names):
            return _numbers(item, rule.known)
        if isinstance(rule, Between):
            return item.whole(int(rule.least), int(rule.most)) if plain is int else item.number(rule.least, rule.most)
    return _converter().structure(item, plain)


def _text(item: Item) -> str:
    if item.is_absent:
        raise item.place.error("is missing")
    return item.text()


def _flag(item: Item) -> bool:
    value = item.value
    if not isinstance(value, bool):
        raise item.place.error(f"must be true or false, not {quoted(value)}")
    return value


def _number(item: Item, kind: type[Number]) -> Number:
    value = item.value
    accepted = int if kind is int else (int, float)
    if isinstance(value, bool) or not isinstance(value, accepted) or not is_finite(value):
        raise item.place.error(f"must be a {'whole' if kind is int else 'finite'} number, not {quoted(value)}")
    return kind(value)


def _numbers(item: Item, known: Sequence[str]) -> dict[str, float]:
    """Return numbers by name; infinity is allowed, as the neutral value of some."""
    section, numbers = item.section(known), {}
    for name in section:
        value = section[name].value
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise section[name].place.error(f"must be a number, not {quoted(value)}")
        numbers[name] = float(value)
    return numbers
