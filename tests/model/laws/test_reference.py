"""The reference page of laws has every variable, function and place with its meaning."""

from cmr.model.laws.places import PLACES
from cmr.model.laws.words import FUNCTIONS, VARIABLES
from tests.support.project import PROJECT

PAGE = (PROJECT / "docs/reference/laws.md").read_text(encoding="utf-8")


def test_the_page_has_all_variables_with_their_units() -> None:
    rows = [f"| `{name}` | {variable.unit} | {variable.meaning} |" for name, variable in VARIABLES.items()]

    assert [row for row in rows if row not in PAGE] == []


def test_the_page_has_all_functions() -> None:
    rows = [
        f"| `{name}({', '.join('abc'[: function.arguments])})` | {function.meaning} |"
        for name, function in FUNCTIONS.items()
    ]

    assert [row for row in rows if row not in PAGE] == []


def test_the_page_has_all_places_and_what_they_read() -> None:
    rows = [
        f"| `{name}` | {place.words} | {place.unit} | {', '.join(f'`{one}`' for one in place.variables)} |"
        for name, place in PLACES.items()
    ]

    assert [row for row in rows if row not in PAGE] == []
