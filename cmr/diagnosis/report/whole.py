"""What every page has: its head, and that nothing may be loaded and nothing may run."""

from cmr.diagnosis.report.markup import Html, tag
from cmr.diagnosis.report.style import STYLE

POLICY = "default-src 'none'; style-src 'unsafe-inline'"  # whatever a name in the data says


def whole_page(title: str, *body: Html) -> str:
    """Return a page of HTML that needs no network, no other file and no script."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(STYLE)),
    )
    page = tag("html", head, tag("body", *body), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"
