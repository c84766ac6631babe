"""Text of strangers, from the bus or a file, as a terminal or a table shows it, to which it is no command."""

CUT = "..."
LINES = "\n\t"  # of texts that may have several lines
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # with which a cell begins that a spreadsheet computes


def plain(text: str, longest: int | None = None, kept: str = "") -> str:
    """Return a text without what moves a cursor, changes colours or turns letters round; cut where it is too long.

    All kinds of space become a space and other characters that are not printed a question mark, but those in `kept`.
    """
    if longest is not None and len(text) > longest:
        text = text[:longest] + CUT
    if text.isprintable():
        return text
    return "".join(letter if letter in kept else _shown(letter) for letter in text)


def cell(text: str) -> str:
    """Return a text as a cell of a CSV file that no spreadsheet takes for a formula: after an apostrophe.

    It is plain, too, but for its lines: a carriage return would begin a row, which no writer of CSV looks after.
    """
    shown = plain(text, kept=LINES)
    return f"'{shown}" if text.startswith(FORMULA) or shown.lstrip().startswith(FORMULA) else shown


def _shown(letter: str) -> str:
    if letter.isprintable():
        return letter
    return " " if letter.isspace() else "?"
