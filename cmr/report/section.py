"""A part of the page with its heading; nothing at all where there is nothing to say."""

import re
from typing import NamedTuple

from cmr.report.markup import Html, joined, tag


class Section(NamedTuple):
    """A heading, and the content below it; empty where nothing is to be said."""

    heading: str
    content: Html

    @property
    def anchor(self) -> str:
        """The name by which a link leads to the section."""
        return re.sub(r"[^a-z0-9]+", "-", self.heading.lower()).strip("-")

    @property
    def html(self) -> Html:
        """The section as it stands on the page."""
        return tag("section", tag("h2", self.heading, id=self.anchor), self.content)


def section(heading: str, *content: Html) -> Section:
    """Return a section with this content."""
    return Section(heading, joined(*content))


def paragraph(*content: str) -> Html:
    """Return a paragraph."""
    return tag("p", *content)


def quiet(*content: str) -> Html:
    """Return a paragraph of explanation, set smaller."""
    return tag("p", *content, class_="quiet")


def bullets(items: list[str]) -> Html:
    """Return a list; empty without items."""
    return tag("ul", *(tag("li", item) for item in items)) if items else Html("")


def folded(summary: str, *content: str) -> Html:
    """Return content that is hidden until a reader opens it; on paper it is there."""
    return tag("details", tag("summary", summary), *content)


def code(text: str) -> Html:
    """Return a name as it is written in files; a line may break behind its underscores."""
    first, *others = text.split("_")
    return tag("code", first, *(joined("_", tag("wbr"), other) for other in others))


def codes(names: tuple[str, ...]) -> Html:
    """Return names as they are written in files, with commas."""
    listed = [part for name in names for part in (code(name), ", ")]
    return joined(*listed[:-1])
