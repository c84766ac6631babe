"""Work around viser's stubs, which mark input values read-only, and its encoder, which sends only plain texts."""

from typing import Any

from cmr.report.markup import Html


def write(handle: Any, value: object) -> None:
    """Put a value into an input of a page."""
    handle.value = value


def plain(html: Html) -> str:
    """Return markup as a text that can be sent to a browser: viser's encoder takes `str`, but no class made of it."""
    return str(html)
