"""Read and replace the measurements in the pages of docs/measurements.

A measurement is a block between the lines `<!-- measurement NAME: COMMAND -->` and `<!-- end of NAME -->`. It contains
the output of the command, with the date and the machine.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "measurements"
BLOCK = re.compile(
    r"^<!-- measurement (?P<name>[a-z0-9_]+): (?P<command>.+) -->$(?P<text>.*?)^<!-- end of (?P=name) -->$",
    re.MULTILINE | re.DOTALL,
)


class Measurement(NamedTuple):
    """A block of a page: its name, its command as typed in the checkout, and its last output."""

    page: Path
    name: str
    command: str
    text: str


def measurements() -> Iterator[Measurement]:
    """Yield the blocks of all pages."""
    for page in sorted(PAGES.glob("*.md")):
        for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
            yield Measurement(page, *block.group("name", "command", "text"))


def in_page(output: str, command: str, stamp: str) -> str:
    """Return a command's output formatted for a page: tables unchanged, other text in a code block."""
    output = output.strip()
    is_markdown = re.search(r"^\|[-|: ]+\|$", output, re.MULTILINE)
    shown = output if is_markdown else f"```text\n{output}\n```"
    return f"\n\n{shown}\n\n*{stamp}* `{command}`\n\n"


def replace(page: str, name: str, text: str) -> str:
    """Return the page with `text` as the content of the block `name`, which must exist."""
    return BLOCK.sub(lambda block: _with(block, text) if block["name"] == name else block[0], page)


def _with(block: re.Match[str], text: str) -> str:
    begin, end = block.span("text")
    return block[0][: begin - block.start()] + text + block[0][end - block.start() :]
