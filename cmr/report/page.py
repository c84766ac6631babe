"""A report as one page of HTML: head, contents and sections. It loads no other files and runs only `readings.js`."""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path

from cmr.report.markup import Html, joined, tag
from cmr.report.section import Section
from cmr.report.style import style_sheet

MOST_WITHOUT_CONTENTS = 3  # sections; with so few, no contents are needed


def page_of(title: str, header: Html, lead: Html, sections: Iterable[Section]) -> str:
    """Return a self-contained page: header, lead, contents and non-empty sections.

    Its content security policy allows only the embedded script, whatever names occur in the data.
    """
    shown = [one for one in sections if one.content]
    script = Path(__file__).with_name("readings.js").read_text(encoding="utf-8")
    digest = b64encode(sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(style_sheet())),
    )
    content = tag("main", lead, _contents(shown), *(one.html for one in shown))
    body = tag("body", header, content, tag("script", Html(script)))
    return f"<!DOCTYPE html>\n{tag('html', head, body, lang='en')}\n"


def _contents(sections: Sequence[Section]) -> Html:
    """Return links to the sections; empty for only a few."""
    if len(sections) <= MOST_WITHOUT_CONTENTS:
        return Html("")
    links = joined(*(tag("li", tag("a", one.heading, href=f"#{one.anchor}")) for one in sections))
    return tag("nav", tag("ul", links), aria_label="Contents")
