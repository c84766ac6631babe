"""Which files of tests have a part in a lane (CONTRIBUTING.md, Test)."""

from pathlib import Path
from typing import Any

import pytest
from _pytest.mark.structures import ParameterSet

LANES = ("further", "hidden_effects", "real_time", "waits")  # those that few files have tests of


def has_none_of(wanted: str, path: Path) -> bool:
    """Return whether a file of tests has none of a lane, alone or without a part of it; `wanted` is pytest's -m.

    False of any other expression: pytest finds out by itself.
    """
    lane, _, rest = wanted.partition(" and not ")
    known = lane in LANES and (not rest or rest in LANES)
    return known and path.name.startswith("test_") and not _names(path.read_text("utf-8"), lane)


def _names(text: str, lane: str) -> bool:
    return f"pytest.mark.{lane}" in text or f"{lane}(" in text


def further(*values: Any) -> list[ParameterSet]:
    """Return values of a parametrised test that CI leaves out: others show the same. A tuple is of several ones."""
    several = [value if isinstance(value, tuple) else (value,) for value in values]
    return [pytest.param(*each, marks=pytest.mark.further) for each in several]
