"""Capture the parsers of the commands at the moment at which they would parse arguments, so that nothing runs."""

import argparse
import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from setuptools.config.pyprojecttoml import read_configuration

PROJECT = Path(__file__).resolve().parents[2]
CATALOGUE = "cmr.commands.catalogue"  # subcommands of the command cmr
SEPARATE_PARSERS = {"cmr-camera": ("calibrate", "board", "tags")}  # subcommands with parsers of their own


class _Captured(Exception):  # noqa: N818 - it is not an error
    """Raised when a command would parse its arguments; its first argument is the parser."""


@cache  # called for each command line of the documentation
def modules() -> Mapping[str, str]:
    """Return the module with the `main` of each command: entry points of pyproject.toml, and subcommands of `cmr`."""
    scripts: dict[str, str] = read_configuration(PROJECT / "pyproject.toml", expand=False)["project"]["scripts"]
    result = {command: _module_of(entry_point) for command, entry_point in scripts.items()}
    if "cmr" in result and find_spec(CATALOGUE):
        catalogue = import_module(CATALOGUE)
        result |= {f"cmr {name}": catalogue.COMMANDS[name][0] for name in catalogue.UMBRELLA_ONLY}
    return dict(sorted(result.items()))


def _module_of(entry_point: str) -> str:
    """Return the module that an entry point such as `cmr.commands:sim` passes to `run`.

    The source is read, not executed: importing cmr.commands.sim would hide the function of that name.
    """
    module, function = entry_point.split(":")
    tree = ast.parse(Path(str(import_module(module).__file__)).read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name == function:
            return next(str(part.value) for part in ast.walk(node) if isinstance(part, ast.Constant) and _dotted(part))
    raise ValueError(f"{entry_point} is not defined")


def _dotted(constant: ast.Constant) -> bool:
    return isinstance(constant.value, str) and "." in constant.value and " " not in constant.value


def main_of(command: str) -> Callable[[list[str]], int]:
    """Return the `main` of a command."""
    main: Callable[[list[str]], int] = import_module(modules()[command]).main
    return main


def parsers_of(command: str) -> list[argparse.ArgumentParser]:
    """Return the parser of a command, and the separate parsers of its subcommands.

    The command `cmr` has no parser: it passes its arguments on.
    """

    def capture(parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        raise _Captured(parser)

    main = main_of(command)
    lines = [[], *([name] for name in SEPARATE_PARSERS.get(command, ()))]
    return [] if command == "cmr" else [_captured(capture, main, line) for line in lines]


def parse(command: str, arguments: list[str]) -> None:
    """Parse a command line with the command's parser, without running the command. Raises SystemExit if it is wrong."""
    usual = argparse.ArgumentParser.parse_args

    def parse_only(parser: argparse.ArgumentParser, args: Sequence[str] | None = None, *_: object) -> NoReturn:
        usual(parser, args)
        raise _Captured(parser)

    _captured(parse_only, main_of(command), arguments)


def _captured(
    parse_args: Callable[..., NoReturn], main: Callable[[list[str]], int], line: list[str]
) -> argparse.ArgumentParser:
    """Return the parser that `main` would use for a command line."""
    with _parsing_by(parse_args):
        try:
            main(line)
        except _Captured as captured:
            parser: argparse.ArgumentParser = captured.args[0]
            return parser
    raise ValueError(f"{main.__module__} runs without parsing its arguments")


@contextmanager
def _parsing_by(parse_args: Callable[..., NoReturn]) -> Iterator[None]:
    parser = argparse.ArgumentParser
    usual = parser.parse_args, parser.parse_intermixed_args
    parser.parse_args = parser.parse_intermixed_args = parse_args  # type: ignore[method-assign]
    try:
        yield
    finally:
        parser.parse_args, parser.parse_intermixed_args = usual  # type: ignore[method-assign]
