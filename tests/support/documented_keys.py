"""The keys that docs/reference/json.md documents."""

import re

from tests.support.project import PROJECT

PAGE = PROJECT / "docs/reference/json.md"


def documented(command: str) -> list[set[str]]:
    """Return the keys of each table in the section of a command."""
    section = PAGE.read_text(encoding="utf-8").split(f"## {command}\n")[1].split("\n## ")[0]
    tables = section.split("| key | meaning |")[1:]
    rows = [re.findall(r"^\| (`.*?) \|", table.split("\n\n")[0], re.MULTILINE) for table in tables]
    return [{key for row in table for key in re.findall(r"`(\w+)`", row)} for table in rows]
