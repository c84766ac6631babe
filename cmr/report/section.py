"""A section of the page with its heading; omitted if empty."""

import re
from typing import NamedTuple

from cmr.report.markup import Html, joined, tag


class Section(NamedTuple):
    """A heading and its content; empty if there is nothing to report."""

    heading: str
    content: Html

    @property
    def anchor(self) -> str:
        """The section's link target."""
        return re.sub(r"[^a-z0-9]+", "-", self.heading.lower()).strip("-")

    @property
    def html(self) -> Html:
        """The section as HTML."""
        return tag("section", tag("h2", self.heading, id=self.anchor), self.content)


def section(heading: str, *content: Html) -> Section:
    """Return a section with this content."""
    return Section(heading, joined(*content))


def paragraph(*content: str) -> Html:
    """Return a paragraph."""
    return tag("p", *content)


def quiet(*content: str) -> Html:
    """Return a paragraph of explanation, in small print."""
    return tag("p", *content, class_="quiet")


def bullets(items: list[str]) -> Html:
    """Return a list; empty without items."""
    return tag("ul", *(tag("li", item) for item in items)) if items else Html("")


def folded(summary: str, *content: str) -> Html:
    """Return collapsed content that a reader can open; it is expanded on paper."""
    return tag("details", tag("summary", summary), *content)


def code(text: str) -> Html:
    """Return an identifier as code; lines may break after its underscores."""
    first, *others = text.split("_")
    return tag("code", first, *(joined("_", tag("wbr"), other) for other in others))


def codes(names: tuple[str, ...]) -> Html:
    """Return identifiers as code, separated by commas."""
    listed = [part for name in names for part in (code(name), ", ")]
    return joined(*listed[:-1])
