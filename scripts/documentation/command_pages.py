"""Generate a reference page for each command from its parser, in MyST Markdown."""

import argparse
import re
from collections.abc import Iterator, Sequence

SPECIAL = re.compile(r"([\\`*_\[\]<>|$#~{}])")  # special characters of Markdown


def page(parsers: Sequence[argparse.ArgumentParser]) -> str:
    """Return the page of a command and its subcommands; the command's parser is the first."""
    return "\n".join(line for number, parser in enumerate(parsers) for line in _section(parser, min(number + 1, 2)))


def summary(parser: argparse.ArgumentParser) -> str:
    """Return the first sentence of a command's description."""
    return re.split(r"(?<=[.])\s", " ".join((parser.description or "").split()), maxsplit=1)[0]


def options_of(parsers: Sequence[argparse.ArgumentParser]) -> list[str]:
    """Return the first long name of each option of a command and its subcommands, without repetitions."""
    every = list(parsers)
    for parser in every:
        every.extend(_subcommands(parser))
    named = [action.option_strings for parser in every for action in parser._actions]
    return list(dict.fromkeys(next(name for name in names if name.startswith("--")) for names in named if names))


def _section(parser: argparse.ArgumentParser, level: int) -> Iterator[str]:
    yield f"{'#' * level} {parser.prog}\n"
    for paragraph in (parser.description or "").split("\n\n"):
        yield escaped(paragraph) + "\n"
    yield f"```text\n{parser.format_usage().strip()}\n```\n"
    subcommands = list(_subcommands(parser))
    for group in parser._action_groups:  # argparse has no public list of groups
        actions = [action for action in group._group_actions if action.help != argparse.SUPPRESS]
        actions = [action for action in actions if not isinstance(action, argparse._SubParsersAction)]
        if actions:
            yield f"**{escaped((group.title or 'options').capitalize())}**\n"
            yield from (_option(parser, action) for action in actions)
    if parser.epilog:
        yield f"```text\n{parser.epilog.strip()}\n```\n"
    for subcommand in subcommands:
        yield from _section(subcommand, level + 1)


def _subcommands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from dict.fromkeys(action.choices.values())


def _option(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    formatter = parser._get_formatter()
    name = formatter._format_action_invocation(action)
    help_text = formatter._expand_help(action) if action.help else "."
    return f"`{name}`\n: {escaped(help_text)}\n"


def escaped(text: str) -> str:
    """Return plain text as Markdown that shows it unchanged, on one line."""
    return SPECIAL.sub(r"\\\1", " ".join(text.split()))
