"""Texts that a user sees are in natural technical English: words and sentences that were replaced do not come back."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.project import PROJECT

SOURCES = ("cmr", "robot_driver", "tools", "scripts")
REPLACED = re.compile(  # "cannot tell, because" is how bring-up says that a step stays open
    r"\b((?<!cannot )tells?|told|telling|foretells?|foretold|speaks? for|spoke for|in service|late turns?|rooms?"
    r"|pictures a second|takes nothing but|well above it|to hear of zero|ended when it was asked|chance alone makes"
    r"|when the battery is below|that cmr-view printed|kind; else|is not started again)\b",
    re.IGNORECASE,
)


def texts() -> Iterator[tuple[str, str]]:
    """Yield pages, messages in programs, and comments of message types, each with the name of its file."""
    pages = [path for path in sorted(PROJECT.glob("docs/**/*.md")) if not {"_build", "generated"} & {*path.parts}]
    for path in [*sorted(PROJECT.glob("*.md")), *pages, *sorted(PROJECT.glob("lcmtypes/*.lcm"))]:
        yield path.relative_to(PROJECT).as_posix(), path.read_text("utf-8")
    for folder in SOURCES:
        for path in sorted((PROJECT / folder).rglob("*.py")):
            yield from ((path.relative_to(PROJECT).as_posix(), text) for text in shown(path))


def shown(path: Path) -> Iterator[str]:
    """Yield the texts in a program that are no docstrings."""
    tree = ast.parse(path.read_text("utf-8"))
    documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
            yield node.value


@pytest.mark.slow
def test_words_that_were_replaced_stay_replaced() -> None:
    found = [f"{name}: {' '.join(word[0].split())}" for name, text in texts() for word in REPLACED.finditer(text)]
    assert not found
