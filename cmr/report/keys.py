"""Legends of figures: samples of lines and marks with their meanings."""

from cmr.report.markup import Html, tag
from cmr.report.style import AFTER, BEFORE, FOUND, PAPER, REAL, REAL_OUTLINE, SAMPLE

DASHES = "5 3"
LINE = "M2 7H38"


def keys(*entries: Html) -> Html:
    """Return a row of legend entries."""
    return tag("div", *entries, class_="keys")


def real_key(words: str = "real robot") -> Html:
    """Return the entry of the real path."""
    return _entry(words, _line(REAL_OUTLINE, 5.4), _line(REAL, 4.0))


def simulated_key(words: str = "simulated robot") -> Html:
    """Return the entry of simulated paths."""
    return _entry(words, _line(AFTER, 1.8))


def before_key(words: str, *, marked: bool = False) -> Html:
    """Return the entry of the paper's model; `marked` with the mark of a bin's mean."""
    mark = tag("path", d="M17 4h6v6h-6z", stroke=BEFORE, stroke_width=1.4, fill=PAPER)
    return _entry(words, _line(BEFORE, 1.8, DASHES), *([mark] if marked else []))


def after_key(words: str, *, marked: bool = False) -> Html:
    """Return the entry of the extended model."""
    mark = tag("circle", cx=20, cy=7, r=3.4, fill=AFTER)
    return _entry(words, _line(AFTER, 1.8), *([mark] if marked else []))


def found_key(words: str) -> Html:
    """Return the entry of the interval in which the models differ most."""
    return _entry(words, _line(FOUND, 9.0))


def sample_key(words: str) -> Html:
    """Return the entry of the scatter of samples."""
    places = "M5 9h0M12 4h0M19 8h0M27 5h0M34 10h0"
    return _entry(words, tag("path", d=places, stroke=SAMPLE, stroke_width=3.2, stroke_linecap="round"))


def area_key(words: str, colour: str) -> Html:
    """Return the entry of areas of a colour."""
    return _entry(words, tag("rect", x=6, y=0, width=28, height=14, fill=colour))


def _entry(words: str, *drawn: Html) -> Html:
    return tag("span", tag("svg", *drawn, viewBox="0 0 40 14", aria_hidden="true"), words)


def _line(colour: str, width: float, dashes: str | None = None) -> Html:
    return tag("path", d=LINE, stroke=colour, stroke_width=width, stroke_dasharray=dashes)
