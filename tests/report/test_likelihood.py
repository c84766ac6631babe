"""How likely something is, in words and as the length of a bar."""

import pytest

from cmr.report.likelihood import LEAST, length, odds


def test_a_bar_is_as_long_as_the_logarithm_and_says_its_number() -> None:
    """Every tenfold is a third of the track, from one in a thousand to certainty."""
    assert [length(p) for p in (LEAST, 0.01, 0.1, 1.0, 0.0)] == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0, 0.0])
    assert [odds(p) for p in (0.56, 0.01, 0.004, 0.0)] == ["56 %", "1 %", "1 : 250", "gone"]


def test_what_is_nearly_sure_is_said_by_its_odds() -> None:
    """A name takes 1000 : 1: what has less must not read as certain."""
    assert [odds(p) for p in (0.99, 0.996, 0.999, 1.0)] == ["99 %", "249 : 1", "999 : 1", "over 10000 : 1"]
