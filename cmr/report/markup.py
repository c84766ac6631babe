"""Build HTML and SVG from text segments, escaping text from outside."""

import html

VOID = frozenset({"meta", "br", "wbr", "img"})  # elements without content and end


class Html(str):
    """Text that is already markup. Any other text is escaped when added to an element."""

    __slots__ = ()


def joined(*parts: str) -> Html:
    """Concatenate the parts, escaping those that are not markup."""
    return Html("".join(part if isinstance(part, Html) else html.escape(part) for part in parts))


def tag(name: str, /, *content: str, **attributes: str | float | None) -> Html:
    """Return an element with this content and these attributes, all escaped unless markup.

    Attributes are written as Python allows: `class_`, `stroke_width`; None omits one.
    """
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(str(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    end = "" if name in VOID else f"{joined(*content)}</{name}>"
    return Html(f"<{name}{written}>{end}")
