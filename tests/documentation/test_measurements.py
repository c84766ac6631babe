"""What stands in docs/measurements between marks is what a command prints: scripts/write_measurements puts it there."""

import shlex
import sys
from collections import Counter

import pytest

from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.measurements import PAGES, in_page, measurements, replace

from cmr.commands.catalogue import COMMANDS, name_of

STAMP = "26 November 2026, a processor, 2 cores, idle."
TABLE = "A sentence.\n\n| what | how much |\n|---|---|\n| this | 3 |"


def test_each_block_has_a_name_of_its_own() -> None:
    counts = Counter(one.name for one in measurements())
    assert counts
    assert set(counts.values()) == {1}


def test_each_mark_belongs_to_a_block() -> None:
    marks = sum(page.read_text(encoding="utf-8").count("<!--") for page in PAGES.glob("*.md"))
    assert marks == 2 * len(list(measurements()))


def test_each_block_is_measured_by_what_is_there() -> None:
    ours = {name_of(name) for name in COMMANDS}
    for one in measurements():
        words = shlex.split(one.command)
        scripts = [word for word in words if word.startswith("scripts/")]
        scripts += [word.replace(".", "/") + ".py" for word in words if word.startswith("scripts.")]
        assert words[0] in ours or scripts, one.command
        assert all((PROJECT / script).is_file() for script in scripts), one.command


def test_each_block_shows_its_command_to_who_reads_the_page() -> None:
    assert [one.name for one in measurements() if f"`{one.command}`" not in one.text] == []


@pytest.mark.parametrize(("output", "shown"), [(TABLE, TABLE), ("3 of 3\n", "```text\n3 of 3\n```")])
def test_an_output_replaces_its_block_alone(output: str, shown: str) -> None:
    page = "Before.\n\n<!-- measurement one: a -->\n\nold\n\n<!-- end of one -->\n\n"
    other = "<!-- measurement two: b -->\n\nkept\n\n<!-- end of two -->\n"
    changed = replace(page + other, "one", in_page(output, "scripts/a", STAMP))
    assert changed == page.replace("old", f"{shown}\n\n*{STAMP}* `scripts/a`") + other
