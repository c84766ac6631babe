"""Tables that stack on a narrow screen."""

from collections.abc import Sequence

from cmr.report.markup import Html, tag

NUMBER = "number"  # class of cells that hold numbers


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: Sequence[int] = ()) -> Html:
    """Return a table; the first cell of a row is a heading, `numbers` are the columns that hold numbers.

    On a narrow screen each row becomes a block, with each cell after its column's heading.
    """
    head = tag("thead", tag("tr", *(tag("th", heading, scope="col") for heading in headings)))
    body = tag("tbody", *(_row(headings, row, numbers) for row in rows))
    return tag("table", head, body, class_="stacks")


def _row(headings: Sequence[str], row: Sequence[str], numbers: Sequence[int]) -> Html:
    cells = [
        tag("td", cell, data_label=heading, class_=_class(cell, column in numbers))
        for column, (heading, cell) in enumerate(zip(headings, row, strict=True))
        if column
    ]
    return tag("tr", tag("th", row[0], scope="row"), *cells)


def _class(cell: str, is_number: bool) -> str | None:
    return " ".join(name for name, holds in ((NUMBER, is_number), ("blank", not cell)) if holds) or None
