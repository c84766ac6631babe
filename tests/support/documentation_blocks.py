"""The code blocks of README and of the pages in docs/, and the command lines in them."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent
from typing import NamedTuple

from tests.support.project import PROJECT

DOCS = PROJECT / "docs"


class Block(NamedTuple):
    """A block of code: its page, its line there, its language and what it says."""

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def pages() -> list[Path]:
    """Return README and every page of docs/ that somebody wrote, and the page beside the mappings."""
    written = [path for path in sorted(DOCS.rglob("*.md")) if not {"_build", "generated"} & {*path.parts}]
    return [PROJECT / "README.md", *written, PROJECT / "tools" / "cmr_tools" / "importing" / "mappings" / "README.md"]


def blocks(*languages: str) -> list[Block]:
    """Return the blocks of all pages in some languages."""
    return [block for page in pages() for block in blocks_of(page) if block.language in languages]


def blocks_of(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page; those of Sphinx, as {toctree}, too."""
    opened: tuple[str, str, int] | None = None
    lines: list[str] = []
    for number, line in enumerate(page.read_text("utf-8").splitlines(), start=1):
        fence = re.match(r" *(`{3,})(\S*)$", line)
        if opened is None and fence:
            opened, lines = (fence[1], fence[2], number), []
        elif opened and fence and fence[1] == opened[0] and not fence[2]:
            name = page.relative_to(PROJECT).as_posix()
            yield Block(name, opened[2], opened[1], dedent("\n".join(lines)) + "\n")
            opened = None
        else:
            lines.append(line)


class Line(NamedTuple):
    """A command line: its block, and what it says without its comment."""

    block: Block
    text: str

    @property
    def words(self) -> list[str]:
        """The command and its arguments."""
        return shlex.split(self.text)

    def __str__(self) -> str:
        return f"{self.block}: {self.text}"


def command_lines() -> list[Line]:
    """Return each command line of all sh blocks."""
    commands = [
        Line(block, command.split(" # ")[0].strip().removesuffix(" &"))
        for block in blocks("sh")
        for line in block.text.splitlines()
        for command in line.split(" && ")
    ]
    return [line for line in commands if line.text]
