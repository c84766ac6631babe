"""The document of effects says what the catalogue says."""

import re

import pytest

from cmr.model.catalogue import CATALOGUE
from cmr.model.effects_document import document
from cmr.model.showcase import showcase
from tests.support.project import PROJECT

DOCUMENT = PROJECT / "docs" / "effects.md"
EXAMPLE = PROJECT / "docs" / "effect_of_your_own.py"


@pytest.mark.slow
def test_the_committed_document_is_what_the_catalogue_gives() -> None:
    # If not: .venv/bin/python scripts/write_effects_document
    showcases = {name: showcase(effect) for name, effect in CATALOGUE.items()}
    assert DOCUMENT.read_text("utf-8") == document(showcases, EXAMPLE.read_text("utf-8"))


def test_every_effect_has_its_picture() -> None:
    pictures = {path.stem for path in (PROJECT / "docs" / "effects").glob("*.png")}
    assert pictures == set(CATALOGUE)


def test_every_link_in_the_document_leads_somewhere() -> None:
    text = DOCUMENT.read_text("utf-8")
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    anchors = {heading.lower().replace(" ", "-") for heading in headings}
    assert set(re.findall(r"\]\(#([^)]*)\)", text)) <= anchors
    for target in re.findall(r"\]\((effects/[^)]*)\)", text):
        assert (DOCUMENT.parent / target).is_file()
