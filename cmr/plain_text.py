"""Sanitise untrusted text, from the bus or a file, for terminals and tables."""

CUT = "..."
LINES = "\n\t"  # allowed in texts of several lines
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # first characters that make a spreadsheet treat a cell as a formula


def plain(text: str, longest: int | None = None, kept: str = "") -> str:
    """Return a text without characters that move the cursor, change colours or reverse letters, truncated if too long.

    White space becomes a space and other unprintable characters become a question mark, except those in `kept`.
    """
    if longest is not None and len(text) > longest:
        text = text[:longest] + CUT
    if text.isprintable():
        return text
    return "".join(letter if letter in kept else _shown(letter) for letter in text)


def cell(text: str) -> str:
    """Return a text as a CSV cell; an apostrophe is prepended if a spreadsheet would take it for a formula.

    Control characters are removed as well, except line feeds; CSV writers do not quote a carriage return, which would
    start a row.
    """
    shown = plain(text, kept=LINES)
    return f"'{shown}" if text.startswith(FORMULA) or shown.lstrip().startswith(FORMULA) else shown


def _shown(letter: str) -> str:
    if letter.isprintable():
        return letter
    return " " if letter.isspace() else "?"
