"""A part of the page with its heading; nothing at all where there is nothing to tell."""

from cmr.diagnosis.report.markup import Html, joined, tag


def section(heading: str, *content: Html) -> Html:
    """Return a section; empty if all its content is."""
    return tag("section", tag("h2", heading), *content) if any(content) else Html("")


def paragraph(*content: str) -> Html:
    """Return a paragraph."""
    return tag("p", *content)


def quiet(*content: str) -> Html:
    """Return a paragraph of explanation, set smaller."""
    return tag("p", *content, class_="quiet")


def bullets(items: list[str]) -> Html:
    """Return a list; empty without items."""
    return tag("ul", *(tag("li", item) for item in items)) if items else Html("")


def code(text: str) -> Html:
    """Return a name as it is written in files; a line may break behind its underscores."""
    first, *others = text.split("_")
    return tag("code", first, *(joined("_", tag("wbr"), other) for other in others))


def codes(names: tuple[str, ...]) -> Html:
    """Return names as they are written in files, with commas."""
    listed = [part for name in names for part in (code(name), ", ")]
    return joined(*listed[:-1])
